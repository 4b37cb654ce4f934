"""Scenario files whose controllers drive to a goal at rest."""

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from urdf_parts import write

GOAL = {"sleigh_x": 0.0, "sleigh_y": 0.0, "sleigh_yaw": 0.0}
BOUNDS = {"input": {"force(sleigh.x)": [-5.0, 5.0], "torque(sleigh.z)": [-5.0, 5.0]}}
PLANNED = {"type": "set_point", "goal": GOAL, "duration": 5.0, "bounds": BOUNDS}
PREDICTIVE = {"type": "predictive", "goal": GOAL, "horizon": 3.0, "weight": 10.0, "velocity_weight": 0.1}


def scenario(folder, controller, **others):
    content = {
        "title": "Sleigh: parking",
        "robot": {"urdf": "chaplygin_sleigh.urdf", "base": "planar"},
        "constraints": [{"no_side_slip": {"frame": "sleigh"}}],
        "actuators": [{"force": {"frame": "sleigh", "axis": "x"}}, {"torque": {"frame": "sleigh", "axis": "z"}}],
        "outputs": {
            "reducing": [{"frame_speed": {"frame": "sleigh", "axis": "x"}}, {"frame_yaw": "sleigh"}],
            "vertical": [{"frame_position": {"frame": "sleigh", "axes": "xy"}}],
        },
        "initial": {"q": {"root_joint": [0.0, 0.3, 0.0]}},
        "controller": controller,
        "simulation": {"duration": 8.0, "dt": 0.05},
    }
    return rnc.Scenario.load(write(folder / "park.yaml", yaml.safe_dump({**content, **others})))


@pytest.mark.parametrize("controller", [PLANNED, {**PREDICTIVE, "bounds": BOUNDS}, {**PREDICTIVE, "equality": True}])
def test_arrives_where_quadratic_costs_stall(tmp_path, controller):
    run = scenario(tmp_path, controller).run()
    assert np.hypot(*run.q[-1, :2]) < 0.01
    assert run.verdict.succeeded
    if "bounds" in controller:
        assert np.abs(run.T).max() <= 5.0 * (1 + 1e-2)


def test_a_goal_that_is_missed_is_in_the_verdict(tmp_path):
    run = scenario(tmp_path, {**PLANNED, "duration": 0.2, "seeds": 0}, simulation={"duration": 0.5, "dt": 0.05}).run()
    assert (run.verdict.word, run.verdict.first.where) == ("failed", "sleigh_y")


def test_velocities_of_a_plant_with_servos(tmp_path):
    controller = {**PLANNED, "form": "acceleration", "velocities": True}
    controller["bounds"] = {"velocity": {"sleigh_speed_x": [-0.5, 0.5]}}
    run = scenario(tmp_path, controller, plant={"type": "reduced", "servo_time": 0.02}).run()
    assert np.hypot(*run.q[-1, :2]) < 0.01
    assert run.verdict.succeeded
    assert np.abs(run.v2[:, 0]).max() < 0.51


def test_a_post_between_start_and_goal_keeps_its_clearance(tmp_path):
    """The clearance of the controller is that of the verdict, as with a planner."""
    post = {"cylinder": {"name": "post", "radius": 0.1, "length": 1.0, "position": [0.0, 0.9, 0.0]}}
    controller = {**PLANNED, "duration": 10.0, "clearance": 0.1}
    made = scenario(
        tmp_path, controller, obstacles=[post], initial={"q": {"root_joint": [0.0, 1.8, 0.0]}},
        simulation={"duration": 14.0, "dt": 0.05},
    )  # fmt: skip
    run = made.run()
    assert np.hypot(*run.q[-1, :2]) < 0.01
    assert run.verdict.succeeded
    distances = rnc.collision.CollisionDistances(made.reduced.robot, made.experiment.obstacles)
    assert min(distances.at(q, within=0.2).distance.min(initial=1.0) for q in run.q) > 0.09


@pytest.mark.parametrize(("changes", "message"), [
    ({"goal": {}}, "goal"),
    ({"goal": {"sleigh_z": 0.0}}, "no output 'sleigh_z'"),
    ({"goal": {"sleigh_x": 0.0}}, "does not determine"),
    ({"bounds": {"output": {"wheel": [0, 1]}}}, "no output 'wheel'"),
    ({"velocities": True}, "expected the form 'acceleration'"),
    ({"horizon": 2.0}, "does not belong to type 'set_point'"),
    ({"bounds": {"velocity": {"sleigh_speed_x": [1, -1]}}}, "sleigh_speed_x: smallest value 1 is above largest"),
    ({"duration": [6, 3]}, "duration: expected 0 < shortest <= longest"),
])  # fmt: skip
def test_refusals_name_the_key(tmp_path, changes, message):
    with pytest.raises(rnc.RncError, match=message):
        _ = scenario(tmp_path, {**PLANNED, **changes}).experiment


@pytest.mark.parametrize("controller", [PLANNED, PREDICTIVE])
def test_a_goal_that_touches_an_obstacle_is_refused_before_any_search(tmp_path, controller):
    post = {"cylinder": {"name": "post", "radius": 0.1, "length": 1.0, "position": [0.0, 0.0, 0.0]}}
    with pytest.raises(rnc.InfeasibleError, match="goal: the distance of sleigh and post is"):
        _ = scenario(tmp_path, controller, obstacles=[post]).experiment
