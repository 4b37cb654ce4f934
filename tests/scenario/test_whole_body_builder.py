"""Whole-body control from a scenario file: references start at the initial values, limits of the file apply."""

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.scenario.execution import execute, plan

SCENARIO = """
robot: {urdf: mobile_manipulator.urdf, base: planar}
constraints: [{no_side_slip: {frame: axle}}]
actuators: [{force: {frame: base, axis: x}}, {torque: {frame: base, axis: z}}, joint_1, joint_2]
outputs:
  reducing: [{frame_speed: {frame: base, axis: x}}, {frame_yaw: base}, {joint: joint_1}, {joint: joint_2}]
  vertical: [{frame_position: {frame: tip, axes: xy}}]
initial:
  q: {joint_1: 0.5, joint_2: -1.2}
controller:
  type: qp
  tracker: computed_torque
  k: 40
  tasks:
    - output:
        output: {frame_position: {frame: tip, axes: xy}}
        reference: {minimum_jerk: {by: [0.4, 0.2], duration: 0.6}}
        gain: 5
    - posture: {joints: {joint_1: 0.5, joint_2: -1.2}, weight: 0.1, priority: 1}
    - damping: {weight: 0.01, priority: 1}
  limits:
    joint_velocity: {joints: [joint_1, joint_2], limit: 0.25, margin: 0.02}
    acceleration: {limit: 10}
    regions: [{frame: base, box: {x: [-1, 0.25]}}]
simulation: {duration: 1.6, dt: 0.004}
"""


def written(folder, **controller):
    raw = yaml.safe_load(SCENARIO)
    raw["controller"] |= controller
    path = folder / "reach.yaml"
    path.write_text(yaml.safe_dump(raw))
    return str(path)


def test_the_hand_follows_its_reference_within_the_limits(tmp_path):
    run = execute(plan(written(tmp_path)))
    trajectory = run.trajectory
    assert run.error is None
    start, goals = trajectory.x1[0], trajectory.x1_desired
    np.testing.assert_allclose(goals[0], start, atol=1e-12)
    np.testing.assert_allclose(goals[-1], start + np.array([0.4, 0.2]), atol=1e-12)
    assert np.abs(trajectory.x1[-1] - goals[-1]).max() < 0.01
    assert np.abs(trajectory.v[:, 3:]).max() <= 0.25
    assert trajectory.q[:, 0].max() <= 0.25 + 1e-3


def test_every_task_and_limit_is_built(tmp_path):
    items = [
        {"posture": {"joints": {"joint_1": 0.1}}},
        {"base_pose": {"frame": "base", "gain": [1, 1, 2], "lateral_gain": 3, "priority": 2}},
        {"center_of_mass": {"axes": "xy", "reference": {"minimum_jerk": {"by": [0.1, 0.0], "duration": 1}}}},
        {"look_at": {"frame": "tip", "target": [3.0, 1.0, 0.0]}},
        {"damping": {}},
        {"manipulability": {"output": {"frame_position": {"frame": "tip", "axes": "xy"}}, "priority": 3}},
        {"singularity": {"gain": 0.1, "priority": 3}},
    ]
    built = plan(written(tmp_path, tasks=items, limits={"joint_position": None})).experiment.controller
    described = built.describe()["target"]
    names = [each["type"] for each in described["tasks"]]
    assert names == [
        "PostureTask",
        "BasePoseTask",
        "CenterOfMassTask",
        "LookAtTask",
        "DampingTask",
        "ManipulabilityTask",
        "SingularityTask",
    ]
    assert [each["type"] for each in described["limits"]] == ["JointVelocityLimit"]
    assert described["tasks"][1]["gain"] == [1, 1, 2]


@pytest.mark.parametrize(
    ("controller", "words"),
    [
        ({"tasks": []}, "controller.tasks"),
        ({"tasks": [{"damping": {"joints": ["joint_9"]}}]}, r"controller.tasks.0: no joint 'joint_9'"),
        ({"tasks": [{"posture": {"joints": {"joint_1": 0.1}, "gian": 2}}]}, "'gian' is not known; did you mean 'gain'"),
        ({"limits": {"wheel_speed": {"limit": 1.0}}}, "controller.limits: a wheel speed limit needs RollingWheel"),
        ({"limits": {"speed": {}}}, "'speed' is not known"),
        ({"solver": "dapq"}, "no installed solver 'dapq'"),
    ],
)
def test_mistakes_are_one_line_with_their_place(tmp_path, controller, words):
    with pytest.raises(rnc.RncError, match=words) as caught:
        plan(written(tmp_path, **controller))
    assert "\n" not in str(caught.value)
