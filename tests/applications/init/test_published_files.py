"""Drafts for what strangers publish: the kind of base, its freedoms, and what it doubts, without meshes."""

import numpy as np
import pytest

from places import DIRT
from rnc_pin.applications.init import DraftOptions, draft
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import read_yaml
from rnc_pin.applications.scenario.scenario import Scenario

pytestmark = [pytest.mark.filterwarnings("ignore::rnc_pin.ModelWarning"), pytest.mark.usefixtures("brief")]


def drafted(name, folder, **wishes):
    """(the scenario's content, its text, its path)."""
    path = folder / "draft.yaml"
    source = DIRT / f"{name}.urdf" if isinstance(name, str) else name
    path.write_text(draft(str(source), folder, DraftOptions(**wishes)))
    return read_yaml(path), path.read_text(), path


HURRIED = {"simulation.duration": 1.2, "simulation.dt": 0.01, "reference.primary.minimum_jerk.duration": 1.0}


def run(path, options):
    summary = execute(Scenario.load(str(path), options)).summary
    assert summary["outcome"] == "completed"
    return summary


def entries(content, kind):
    return [each[kind] for each in content["constraints"] if kind in each]


def freedoms(content):
    return sum(len(each) for each in (content["task"]["primary"], content["task"].get("redundant", [])))


KINDS = {  # base, constraints of each kind, freedoms, words of the kind
    "wide_wheels": ("planar", {"no_side_slip": 1, "rolling_wheel": 4}, 2, "skid-steered"),
    "skid_off_center": ("planar", {"no_side_slip": 1, "rolling_wheel": 4}, 2, "skid-steered"),
    "mecanum_named": ("planar", {"rolling_wheel": 4}, 3, "4 Mecanum wheels"),
    "mecanum_with_rollers": ("planar", {"rolling_wheel": 4}, 3, "4 Mecanum wheels"),
    "three_omni_wheels": ("planar", {"rolling_wheel": 3}, 3, "3 omni wheels"),
    "car_with_steering_wheel": ("planar", {"rolling_wheel": 4, "ackermann": 1}, 3, "steered like a car"),
    "truck_and_trailer": ("planar", {"rolling_wheel": 8}, 2, "with 1 trailer"),
    "raked_fork": ("free", {"rolling_wheel": 2}, 3, "a bicycle"),
    "balancer": ("free", {"rolling_wheel": 2}, 3, "balances"),
    "satellite": ("free", {"momentum": 1}, 3, "floats"),
    "flywheels": ("free", {"momentum": 1}, 3, "limbs"),
    "rigid_drone": ("free", {}, 6, "one rigid body"),
    "own_planar_base": ("fixed", {}, 4, "joints of the file"),
    "sliding_caster": ("planar", {"rolling_wheel": 2}, 2, "differential drive"),
    "floating_and_planar": ("free", {}, None, ""),
}


@pytest.mark.parametrize(("name", "expected"), KINDS.items(), ids=KINDS)
def test_geometry_and_kinematics_decide(name, expected, tmp_path):
    base, kinds, size, words = expected
    content, text, path = drafted(name, tmp_path)
    assert content["robot"]["base"] == base
    for kind, count in kinds.items():
        assert len(entries(content, kind)) == count, kind
    if size is not None:
        assert freedoms(content) == size
    assert words in next(line for line in text.splitlines() if line.startswith("# base"))
    run(path, {"simulation.duration": 0.05})


def test_a_skid_steered_base_turns_about_its_equivalent_axle(tmp_path):
    """Its origin is 0.3 m behind the middle, so that turning on the spot moves it sideways."""
    _, _, path = drafted("skid_off_center", tmp_path)
    prepared = Scenario.load(str(path), {**HURRIED, "reference.primary.minimum_jerk.by": [0.0, 0.4]}).build()
    trajectory = execute(prepared).trajectory
    heading = prepared.experiment.reduced.robot.joint_values(trajectory.q[-1])["root_joint"]
    x, y, yaw = heading
    middle = np.array([x + 0.3 * np.cos(yaw), y + 0.3 * np.sin(yaw)])
    assert yaw == pytest.approx(0.4, abs=0.02)
    np.testing.assert_allclose(middle, [0.3, 0.0], atol=0.01)


def test_mecanum_wheels_move_sideways(tmp_path):
    """The rates of the wheels are those of the textbook: +-(vx -+ vy) over the radius."""
    content, _, path = drafted("mecanum_with_rollers", tmp_path)
    prepared = Scenario.load(str(path), {**HURRIED, "reference.primary.minimum_jerk.by": [0.0, 0.3, 0.0]}).build()
    trajectory, robot = execute(prepared).trajectory, prepared.experiment.reduced.robot
    radius = entries(content, "rolling_wheel")[0]["radius"]
    v = trajectory.v[trajectory.v.shape[0] // 2]
    sideways = v[1]
    names = [name for name in robot.joint_names if name in content["actuators"]]
    rates = {name: float(v[robot.velocity_indices(name)][0]) for name in names}
    assert abs(sideways) > 0.05
    for name, rate in rates.items():
        expected = (-1 if ("left" in name) == ("front" in name) else 1) * sideways / radius
        assert rate == pytest.approx(expected, rel=1e-2)
    assert trajectory.x2[-1][1] == pytest.approx(0.3, abs=0.02)


def test_a_balancer_comes_upright_and_drives(tmp_path):
    content, _, path = drafted("balancer", tmp_path)
    assert (content["controller"]["type"], content["robot"]["lock"]) == ("state_feedback", {"neck": 0.0})
    result = execute(Scenario.load(str(path), {"simulation.duration": 10, "simulation.dt": 0.02}))
    tilt = result.trajectory.x2[:, 2]
    assert abs(tilt[0]) == pytest.approx(0.05, abs=1e-3)
    assert abs(tilt[-1]) < 2e-3
    assert result.summary["final_output"]["body_x"] == pytest.approx(0.5, abs=0.02)


def test_a_bicycle_stays_upright(tmp_path):
    content, text, path = drafted("raked_fork", tmp_path)
    assert "starts rolling" in text
    result = execute(Scenario.load(str(path), {"simulation.duration": 8, "simulation.dt": 0.005}))
    assert result.summary["outcome"] == "completed"
    tilt = result.trajectory.x2[:, content["task"]["primary"].index("frame_tilt_y")]
    assert np.abs(tilt).max() > 5e-3
    assert abs(tilt[-1]) < 1e-3
    assert result.summary["final_output"]["frame_x"] > 20


def test_joints_that_move_no_mass(tmp_path):
    content, text, path = drafted("nothing_has_a_mass", tmp_path)
    assert content["robot"]["masses"]
    assert "WEIGH them" in text
    run(path, {"simulation.duration": 0.05})


def test_packages_that_another_shell_would_not_find_are_recorded(tmp_path, call, monkeypatch):
    meshes = tmp_path / "packages/wheels_of_some/meshes"
    meshes.mkdir(parents=True)
    (meshes / "wedge.stl").write_bytes((DIRT / "wedge.stl").read_bytes())
    mesh = '<visual><geometry><mesh filename="package://wheels_of_some/meshes/wedge.stl"/></geometry></visual>'
    text = (DIRT / "wide_wheels.urdf").read_text().replace("<collision>", f"{mesh}<collision>", 1)
    (tmp_path / "cart.urdf").write_text(text)
    monkeypatch.chdir(tmp_path)
    assert call("init", "cart.urdf", "--package-dir", "packages", "--out", "a.yaml")[0] == 0
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "packages"))
    assert call("init", "cart.urdf", "--out", "b.yaml")[0] == 0
    assert read_yaml(tmp_path / "a.yaml")["robot"]["package_dirs"] == ["packages"]
    assert read_yaml(tmp_path / "b.yaml")["robot"]["package_dirs"] == ["packages/wheels_of_some"]
    status, _, error = call("init", "cart.urdf", "--lock", "front_left_joint=x", "--out", "c.yaml")
    assert status == 2
    assert "--lock front_left_joint=x: expected JOINT or JOINT=NUMBER" in error
