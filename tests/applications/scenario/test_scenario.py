"""Scenarios in Python: their objects, runs, and files."""

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from urdf_parts import link, robot, write

SLEIGH = {
    "robot": {"urdf": "chaplygin_sleigh.urdf", "base": "planar"},
    "constraints": [{"no_side_slip": {"frame": "sleigh"}}],
    "actuators": [{"force": {"frame": "sleigh", "axis": "x"}}],
}


def written(folder, **more):
    return write(folder / "mine.yaml", yaml.safe_dump({**SLEIGH, **more}))


def test_a_file_of_the_dynamics_alone_has_a_model(tmp_path):
    """Reducing velocities are chosen as by ``reduce()``, and a run says what it lacks."""
    scenario = rnc.Scenario.load(written(tmp_path))
    assert (scenario.reduced.r, scenario.reduced.reducing.names) == (2, scenario.system.reduce().reducing.names)
    words = r"^mine.yaml: outputs: is missing, and so are controller and simulation"
    with pytest.raises(rnc.ConfigurationError, match=words):
        scenario.run()


def test_an_open_differential_turns_its_motor_at_the_mean_speed_and_shares_its_torque(tmp_path):
    wheels = ["left_wheel_joint", "right_wheel_joint"]
    drive = {"robot": {"urdf": "differential_drive.urdf", "base": "planar"}, "constraints": []}
    path = written(tmp_path, **drive, actuators=[{"differential": {"joints": wheels, "limit": 20.0}}])
    reduced = rnc.Scenario.load(path).reduced
    v, torque = np.arange(1.0, reduced.n + 1.0), 3.0
    places = [reduced.robot.velocity_indices(name).start for name in wheels]
    B = reduced.at(reduced.robot.configuration()).B
    np.testing.assert_allclose((B @ [torque])[places], torque / 2)
    np.testing.assert_allclose(B.T @ v, v[places].mean())
    assert reduced.actuation.stated_limits == {"differential(left_wheel_joint, right_wheel_joint)": 20.0}
    one = written(tmp_path, **drive, actuators=[{"differential": {"joints": wheels[:1]}}])
    with pytest.raises(rnc.RncError, match=r"a differential needs two joints or more, found \['left_wheel_joint'\]"):
        assert rnc.Scenario.load(one).reduced


def test_rotor_inertia_of_a_file_adds_to_the_inertia_of_its_joint(tmp_path):
    robot = {"urdf": "mobile_manipulator.urdf", "base": "planar"}
    robots = robot, {**robot, "armature": {"joint_2": 0.4}}
    bare = {"constraints": [], "actuators": []}
    plain, geared = (rnc.Scenario.load(written(tmp_path, robot=each, **bare)).reduced for each in robots)
    at = plain.at(plain.robot.configuration({"joint_2": 0.7}), v=np.arange(5.0))
    assert geared.energy(at.q, at.v2) - plain.energy(at.q, at.v2) == pytest.approx(0.4 * at.v[4] ** 2 / 2, rel=1e-9)
    with pytest.raises(rnc.ConfigurationError, match="armature: no joint 'joint2'; did you mean 'joint_2'"):
        assert rnc.Scenario.load(written(tmp_path, robot={**robot, "armature": {"joint2": 0.4}})).reduced


def test_a_run_needs_no_outputs(tmp_path):
    free = {"controller": {"type": "none"}, "simulation": {"duration": 0.5, "dt": 0.01}}
    run = rnc.Scenario.load(written(tmp_path, **free, initial={"q": {"root_joint": [0.0, 0.0, 0.3]}})).run()
    np.testing.assert_allclose(run.q[-1], run.q[0])
    assert len(run.time) == 51


def test_a_robot_and_a_table_beside_the_file_are_found_from_elsewhere(tmp_path):
    (tmp_path / "way.csv").write_text("time, x")
    write(tmp_path / "cart.urdf", robot(link("cart", 2), name="cart"))
    where, reference = {"urdf": "cart.urdf", "base": "planar"}, {"primary": {"csv": "way.csv"}}
    more = {"reference": reference, "constraints": [], "actuators": [], "comparisons": {"same": {}}}
    scenario = rnc.Scenario.load(written(tmp_path, robot=where, **more))
    (tmp_path / "elsewhere").mkdir()
    scenario.save(tmp_path / "elsewhere" / "saved.yaml")
    for each in (scenario, scenario.comparisons["same"], rnc.Scenario.load(tmp_path / "elsewhere" / "saved.yaml")):
        assert (each.robot.name, each.content.reference.primary.file) == ("cart", str(tmp_path / "way.csv"))


def test_a_gain_of_the_run_is_none_of_a_comparison_with_another_controller():
    scenario = rnc.Scenario.load("space-robot", {"controller.k3": 5.0, "plots": {}}).build()
    assert scenario.controller.target.describe()["k3"] == 5.0
    ((name, compared),) = scenario.comparisons.items()
    alone = rnc.Scenario.load("space-robot", {"variant": name})
    assert compared.content.controller == alone.content.controller
    assert alone.content.controller.type == "reducing_outputs"


@pytest.mark.parametrize("options", [
    {"constraints": [{"momentum": {"joint": "platform", "momentum": 3.0}}]},  # turns until the arm has to stretch
    {"preflight": "refuse", "reference.primary.minimum_jerk.to": [2.95, 0.4], "controller.tracker": "computed_torque"},
], ids=["gains", "preflight"])  # fmt: skip
def test_a_refused_motion_tells_where_which_rows_and_what_to_change(options):
    with pytest.raises(rnc.InfeasibleError) as caught:
        rnc.Scenario.load("space-robot", {**options, "comparisons": {}}).build()
    error, said = caught.value, str(caught.value)
    assert {"momentum(platform)", "tip_x"} <= set(error.rows)
    assert error.singular_value < 0.01
    assert f"at t = {error.time:.2f} s" in said
    assert "nearer goals, another start or path, or other outputs" in said
    assert len(said) < 400
