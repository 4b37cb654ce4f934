"""Whole-body control from a scenario file: references start at the initial values, limits of the file apply."""

import numpy as np
import pinocchio as pin
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from urdf_parts import joint, link, robot, write

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
simulation: {duration: 1.6, dt: 0.008}
"""


def written(folder, **controller):
    raw = yaml.safe_load(SCENARIO)
    raw["controller"] |= controller
    return str(write(folder / "reach.yaml", yaml.safe_dump(raw)))


def test_the_hand_follows_its_reference_within_the_limits(tmp_path):
    run = execute(Scenario.load(written(tmp_path)))
    trajectory = run.trajectory
    assert run.error is None
    start, goals = trajectory.x1[0], trajectory.x1_desired
    np.testing.assert_allclose(goals[0], start, atol=1e-12)
    np.testing.assert_allclose(goals[-1], start + np.array([0.4, 0.2]), atol=1e-12)
    assert np.abs(trajectory.x1[-1] - goals[-1]).max() < 0.01
    assert np.abs(trajectory.v[:, 3:]).max() <= 0.25
    assert trajectory.q[:, 0].max() <= 0.25 + 1e-3


REACHING = {
    "ur5_robot": ("tool0",
        {"shoulder_lift_joint": -1.2, "elbow_joint": 1.5, "wrist_1_joint": -0.5, "wrist_2_joint": 1}),
    "z1": ("link06", {"joint2": 1.2, "joint3": -1.2, "joint4": 0.3, "joint5": 0.4}),
    "panda": ("panda_hand", {"panda_joint2": 0.3, "panda_joint4": -1.8, "panda_joint6": 1.8}),
}  # fmt: skip
"""Arms of example-robot-data: the hand, and joints at the start."""


@pytest.mark.parametrize("name", REACHING)
def test_the_default_tracker_reaches_with_a_published_arm_at_100_hz(name, tmp_path):
    """No velocity gains suited any of them, and gravity pulled the arms that had gains. Both programs end alike."""
    (hand, start), by = REACHING[name], [0.1, 0.1, 0.05]
    lock = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02} if name == "panda" else {}
    joints = rnc.Robot.from_example(name, lock=lock).joint_names
    position = {"frame_position": {"frame": hand, "axes": "xyz"}}
    goal = {"output": position, "reference": {"minimum_jerk": {"by": by, "duration": 1.5}}, "weight": 100}
    raw = {
        "robot": {"example": name, "lock": lock}, "actuators": list(joints),
        "outputs": {"reducing": [{"joint": each} for each in joints], "vertical": [position]},
        "initial": {"q": start},
        "controller": {"type": "qp", "tasks": [{"output": goal}, {"damping": {"weight": 0.1}}]},
        "simulation": {"duration": 2.2, "dt": 0.01},
    }  # fmt: skip
    ends = {}
    for kind in ("qp", "inverse_dynamics"):
        raw["controller"]["type"] = kind
        run = Scenario.load(write(tmp_path / f"{kind}.yaml", yaml.safe_dump(raw))).run()
        ends[kind] = run.x1[-1] - run.x1[0]
    gains = Scenario.load(tmp_path / "qp.yaml").controller.gains
    assert gains.modes is not None
    assert gains.beta == pytest.approx(20.0 * gains.k)  # gravity loads the arm
    np.testing.assert_allclose(ends["qp"], by, atol=0.01)
    np.testing.assert_allclose(ends["qp"], ends["inverse_dynamics"], atol=0.01)


def test_gravity_is_compensated_from_the_start_unless_the_file_says_otherwise(tmp_path):
    """Without contact forces the arm at rest needs what Pinocchio computes; in motion nothing holds it."""
    robot = rnc.Robot.from_example("ur5_robot")
    joints = robot.joint_names
    raw = {
        "robot": {"example": "ur5_robot"}, "actuators": list(joints),
        "outputs": {"reducing": [{"joint": each} for each in joints]}, "initial": {"q": REACHING["ur5_robot"][1]},
        "controller": {"type": "reducing_outputs"}, "simulation": {"duration": 1, "dt": 0.01},
    }  # fmt: skip
    path = write(tmp_path / "ur5.yaml", yaml.safe_dump(raw))
    q0 = robot.configuration(raw["initial"]["q"])
    torque = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), q0)
    np.testing.assert_allclose(Scenario.load(path).controller.gravity_compensation, torque, atol=1e-12)
    for options in (
        {"controller.gravity_compensation": False}, {"initial.v2": {"elbow_joint": 0.1}},
        {"controller.preset": "paper"}, {"robot.gravity": [0, 0, 0]},
    ):  # fmt: skip
        assert Scenario.load(path, options).controller.gravity_compensation == 0.0


def test_every_task_and_limit_is_built(tmp_path):
    items = [
        {"posture": {"joints": {"joint_1": 0.1}}},
        {"base_pose": {"frame": "base", "gain": [1, 1, 2], "lateral_gain": 3, "priority": 2}},
        {"center_of_mass": {"axes": "xy", "reference": {"minimum_jerk": {"by": [0.1, 0.0], "duration": 1}}}},
        {"damping": {}}, {"singularity": {"gain": 0.1, "priority": 3}},
    ]  # fmt: skip
    limits = {
        "joint_position": None, "acceleration": {"limit": {"joint_1": 2.0, "joint_2": 4.0}},
        "base_speed": {"frame": "base", "limit": 0.05},
    }  # fmt: skip
    built = Scenario.load(written(tmp_path, tasks=items, limits=limits)).experiment.controller
    described = built.describe()["target"]
    names = [each["type"] for each in described["tasks"]]
    kinds = "Posture", "BasePose", "CenterOfMass", "Damping", "Singularity"
    assert names == [f"{each}Task" for each in kinds]
    kinds = "JointVelocity", "Acceleration", "BaseSpeed"
    assert [each["type"] for each in described["limits"]] == [f"{each}Limit" for each in kinds]
    _, by_name, speed = built.target.limits
    assert (by_name.limit, speed.limit) == ({"joint_1": 2.0, "joint_2": 4.0}, 0.05)
    assert described["tasks"][1]["gain"] == [1, 1, 2]


@pytest.mark.parametrize(("controller", "words"), [
    ({"tasks": []}, "controller.tasks"),
    ({"tasks": [{"damping": {"joints": ["joint_9"]}}]}, r"controller.tasks.0: no joint 'joint_9'"),
    ({"tasks": [{"posture": {"joints": {"joint_1": 0.1}, "gian": 2}}]}, "'gian' is not known; did you mean 'gain'"),
    ({"limits": {"regions": [{"frame": "tip"}]}}, "controller.limits: region of frame 'tip': give a box or a polygon"),
    ({"limits": {"speed": {}}}, "'speed' is not known"),
])  # fmt: skip
def test_mistakes_are_one_line_with_their_place(tmp_path, controller, words):
    with pytest.raises(rnc.RncError, match=words) as caught:
        Scenario.load(written(tmp_path, **controller)).build()
    assert "\n" not in str(caught.value)


SLIDES = (("x", "world", "slide", "1 0 0"), ("y", "slide", "ball", "0 1 0"))
POINT_URDF = robot(
    link("world"), link("slide", 1, moment=0.1), link("ball", 2, '<sphere radius="0.1"/>', moment=0.1),
    *(joint(*names, (0, 0, 0), axis, "prismatic", 60, (-3, 3)) for *names, axis in SLIDES), name="point",
).replace('velocity="20"', 'velocity="1.5"')  # fmt: skip
# A ball drives 1 m ahead. One obstacle stands beside its way; another crosses the way from the side.
POINT = """
robot: {urdf: point.urdf}
actuators: [x, y]
outputs: {reducing: [{joint: x}, {joint: y}]}
obstacles:
  - sphere: {name: post, radius: 0.2, position: [0.5, 0.12, 0]}
  - sphere:
      {name: walker, radius: 0.2, position: [1.15, -1.5, 0], motion: {minimum_jerk: {by: [0, 3, 0, 0], duration: 6}}}
controller:
  tasks:
    - output:
        {output: {frame_position: {frame: ball, axes: x}}, reference: {minimum_jerk: {by: [1.0], duration: 2}}, gain: 3}
    - posture: {joints: {y: 0}, gain: 2}
simulation: {duration: 7, dt: 0.02}
"""
PROGRAMS = [{"type": "qp", "tracker": "computed_torque", "k": 60}, {"type": "inverse_dynamics"}]


def point(folder, **changes):
    (folder / "point.urdf").write_text(POINT_URDF)
    raw = yaml.safe_load(POINT)
    raw["controller"] |= changes.pop("controller", {})
    return str(write(folder / "point.yaml", yaml.safe_dump(raw | changes)))


def gaps(trajectory):
    """Distances (N,) of the ball to the post and to the walker, by their motion in closed form."""
    s = np.clip(trajectory.time / 6, 0, 1)
    walker = np.stack([np.full_like(s, 1.15), -1.5 + 3 * (10 * s**3 - 15 * s**4 + 6 * s**5)], axis=1)
    return np.linalg.norm(trajectory.q - [0.5, 0.12], axis=1) - 0.3, np.linalg.norm(trajectory.q - walker, axis=1) - 0.3


@pytest.mark.parametrize("program", PROGRAMS, ids=["qp", "inverse_dynamics"])
def test_obstacles_of_the_scenario_are_avoided_at_rest_and_in_motion(tmp_path, program):
    run = execute(Scenario.load(point(tmp_path, controller=program)))
    assert run.error is None
    post, walker = gaps(run.trajectory)
    assert 0.015 < post.min() < 0.05
    assert 0.015 < walker.min() < 0.15
    np.testing.assert_allclose(run.trajectory.q[-1], [1.0, 0.0], atol=0.01)
    run.trajectory.save(tmp_path / "run.npz")
    kept = rnc.Trajectory.load(tmp_path / "run.npz").meta["controller"]
    assert kept.get("target", kept)["limits"][-1]["obstacles"] == ["post", "walker"]
    blind = {**program, "limits": {"collision": None}}
    blind = point(tmp_path, controller=blind, simulation={"duration": 2, "dt": 0.02})
    assert gaps(execute(Scenario.load(blind)).trajectory)[0].min() < -0.1


def test_preflight_asks_for_a_braking_motion_from_the_start(tmp_path):
    """A ball that flies towards a post faster than its efforts can stop it."""
    fast = {"controller": PROGRAMS[1], "initial": {"v2": {"x": 4.0}, "q": {"y": 0.12}}, "simulation": {"duration": 0.2}}
    (warning, *_) = Scenario.load(point(tmp_path, **fast)).experiment.warnings
    assert warning.startswith("no braking motion from the start keeps all limits: ")
    with pytest.raises(rnc.InfeasibleError, match="no braking motion from the start"):
        Scenario.load(point(tmp_path, preflight="refuse", **fast)).build()


@pytest.mark.parametrize("program", PROGRAMS, ids=["qp", "inverse_dynamics"])
def test_limits_that_gave_way_are_in_the_summary(tmp_path, program):
    """An obstacle of up to 7 m/s reaches a ball that may move at 1.5 m/s."""
    thrown = {"name": "stone", "radius": 0.2, "position": [1.5, 0, 0]}
    thrown["motion"] = {"minimum_jerk": {"by": [-3, 0, 0, 0], "duration": 0.8}}
    changes = {"obstacles": [{"sphere": thrown}], "simulation": {"duration": 0.8, "dt": 0.02}}
    gave_way = execute(Scenario.load(point(tmp_path, controller=program, **changes))).summary["limits_gave_way"]
    assert [name for name in gave_way if name.endswith("stone distance") and gave_way[name] > 1.0]
    calm = execute(Scenario.load(point(tmp_path, controller=program, **{**changes, "obstacles": []})))
    assert "limits_gave_way" not in calm.summary


@pytest.mark.parametrize("program", PROGRAMS, ids=["qp", "inverse_dynamics"])
def test_goals_that_a_run_misses_are_in_the_summary(tmp_path, program):
    """The joint locks at 0.5 s, which preflight cannot know."""
    changes = {"obstacles": [], "simulation": {"duration": 2.5, "dt": 0.02}, "preflight": "refuse"}
    stuck = {**changes, "faults": {"stuck": {"joint": "x", "time": 0.5}}}
    run = execute(Scenario.load(point(tmp_path, controller=program, **stuck)))
    missed = 1.0 - float(run.trajectory.q[-1, 0])
    assert missed > 0.5
    assert run.summary["goals_missed"] == run.summary["goal_error"] == {"ball_x": pytest.approx(missed, abs=1e-12)}
    assert run.summary["goal_tolerance"] == 0.02
    generous = execute(Scenario.load(point(tmp_path, controller=program, **stuck, goal_tolerance=missed + 1e-9)))
    assert "goals_missed" not in generous.summary
    assert generous.summary["goal_error"] == run.summary["goal_error"]
    assert "goals_missed" not in execute(Scenario.load(point(tmp_path, controller=program, **changes))).summary


def test_the_goal_of_a_speed_is_its_rate(tmp_path):
    """At half of the duration, a minimum-jerk motion has 15/8 of its mean speed; the joint may move at 1.5 m/s."""
    ahead = {"minimum_jerk": {"by": [2.0], "duration": 2}}
    speed = {"output": {"output": {"frame_speed": {"frame": "ball", "axis": "x"}}, "reference": ahead}}
    program = {**PROGRAMS[0], "tasks": [speed], "limits": {"joint_velocity": {"margin": 0.0}}}
    short = {"obstacles": [], "simulation": {"duration": 1.0, "dt": 0.02}}
    (error,) = execute(Scenario.load(point(tmp_path, controller=program, **short))).summary["goals_missed"].values()
    assert error == pytest.approx(15 / 8 - 1.5, abs=1e-9)
