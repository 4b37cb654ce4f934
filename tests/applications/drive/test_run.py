"""Driven runs with scripted commands: goals, limits, obstacles and refusals; and the lines of their status."""

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from driven_bases import drafted_file, tricycle
from drives import Watcher, point_of, pose_of, prepared, reduced_of
from rnc_pin.applications.drive.commands import FrameGoal, initial_goals
from rnc_pin.applications.drive.controls import DriveControls, DrivenBase
from rnc_pin.applications.drive.run import CommandQueue, DriveStatus, drive, goal_distances
from rnc_pin.motion.whole_body import LimitReport
from urdf_parts import BOX, joint, link, robot, wheel, write

DT = 0.02


def manipulator(commands=(), **options):
    return prepared("mobile-manipulator", commands, simulation__dt=DT, **options)


def driven(run, samples, **options):
    """(The driven run, its motion)."""
    return run, drive(run, samples=samples, **options).trajectory


def goal(x, y, z=0.48):
    return {"kind": "frame_goal", "frame": "tip", "position": [x, y, z]}


def test_a_frame_reaches_its_goal_and_the_record_has_it():
    run = manipulator([(5, goal(2.0, 0.6))])
    result = drive(run, samples=400)
    np.testing.assert_allclose(point_of(run, result.trajectory.q[-1], "tip")[:2], [2.0, 0.6], atol=2e-3)
    np.testing.assert_allclose(result.trajectory.x1_desired[-1, :2], [2.0, 0.6])
    np.testing.assert_array_equal(result.trajectory.x1_desired[:5], result.trajectory.x1[:5])  # no goal before
    assert result.trajectory.outcome is rnc.Outcome.COMPLETED
    assert result.trajectory.constraint_residual.max() < 1e-9


def test_the_speed_of_a_frame_stays_at_its_setting():
    slow = {"kind": "gain", "gain": "frame speed", "value": 0.1}
    run, trajectory = driven(manipulator([(0, slow), (0, goal(3.0, 0.6))]), 150)
    points = np.array([point_of(run, q, "tip")[:2] for q in trajectory.q])
    assert (np.linalg.norm(np.diff(points, axis=0), axis=1) / DT)[60:].max() == pytest.approx(0.1, rel=0.02)


def test_the_base_drives_to_a_point():
    target = (-0.8, 0.5)
    _, trajectory = driven(manipulator([(2, {"kind": "base_goal", "x": target[0], "y": target[1]})]), 600)
    np.testing.assert_allclose(trajectory.q[-1, :2], target, atol=0.04)
    assert np.abs(trajectory.v2[-1]).max() < 1e-2
    assert np.abs(trajectory.q[:, 4:] - trajectory.q[0, 4:]).max() < 0.02  # the arm keeps its posture


def test_a_steered_car_drives_to_a_point_and_keeps_its_wheel_angle_within_its_range():
    run = prepared("car", [(0, {"kind": "base_goal", "x": 3.0, "y": 1.5})], simulation__dt=DT)
    base = run.controls.base
    assert (base.steering, base.turns, base.slides) == ("front_steering", False, False)
    trajectory = drive(run, samples=600).trajectory
    np.testing.assert_allclose(point_of(run, trajectory.q[-1], base.frame)[:2], [3.0, 1.5], atol=0.05)
    model = reduced_of(run).robot.model
    joint = model.joints[model.getJointId("front_steering")]
    angle = trajectory.q[:, joint.idx_q]
    low, high = (limit[joint.idx_q] for limit in (model.lowerPositionLimit, model.upperPositionLimit))
    assert low - 1e-6 <= angle.min() < angle.max() - 0.1 <= high + 1e-6 - 0.1


def tilting(rake, back=-1.2, front=1.2):
    """Two bodies with an upright joint between them, or a fork that leans back by an angle [rad] and has one wheel."""
    places = [("left", 0.5), ("right", -0.5)]
    rear = [wheel(f"rear_{side}", "base", (back, y, 0), 0.2) for side, y in places]
    at = (front - 0.05, 0, 0.2) if rake else (0, 0, 0)
    turn = joint("bend", "base", "fore", at, "0 0 1", "revolute", 90.0, (-0.7, 0.7), rpy=f"0 {-rake} 0")
    if rake:
        fore = [wheel("front", "fore", (0.02, 0, -0.2 / np.cos(rake)), 0.2, effort=0.0)]
    else:
        fore = [wheel(f"front_{side}", "fore", (front, y, 0), 0.2, effort=0.0) for side, y in places]
    return robot(link("base", 100.0, BOX), link("fore", 50.0), turn, *rear, *fore)


BENDING = """
robot: {{urdf: bending.urdf, base: planar}}
constraints:
  - rolling_wheel: {{frame: rear_left, radius: 0.2}}
  - rolling_wheel: {{frame: rear_right, radius: 0.2, lateral: false}}
  - rolling_wheel: {{frame: {front}, radius: 0.2, vertical: false}}
actuators: [rear_left_joint, rear_right_joint, bend]
outputs: {{reducing: [{{frame_speed: {{frame: base}}}}, {{joint: bend}}]}}
controller: {{type: reducing_outputs}}
simulation: {{duration: 1, dt: 0.02}}
"""


def bending(folder, rake=0.0, commands=()):
    """Driven run of an articulated vehicle, or of one with a raked fork."""
    (folder / "bending.urdf").write_text(tilting(rake))
    text = BENDING.format(front="front" if rake else "front_left")
    if not rake:
        free = "  - rolling_wheel: {frame: front_right, radius: 0.2, lateral: false}\nactuators"
        text = text.replace("actuators", free)
    return prepared(str(write(folder / "bending.yaml", text)), commands, simulation__dt=DT)


def pressed(forward, turn, samples):
    """A key held for some samples."""
    return [(k, {"kind": "base_velocity", "forward": forward, "turn": turn}) for k in range(0, samples, 10)]


@pytest.mark.parametrize("rake", [0.0, 0.3])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_left_and_right_bend_the_path_to_their_sides(rake, side, tmp_path):
    run, trajectory = driven(bending(tmp_path, rake, pressed(1.0, side, 200)), 200)
    # At first, it folds.
    assert (side * np.diff([pose_of(run, q)[2] for q in trajectory.q[150:]])).min() > 0
    assert trajectory.v2[-1, 0] == pytest.approx(0.5, rel=0.05)  # the joint is at its limit


def test_a_single_pivot_that_turns_round_is_aimed_and_the_base_turns_on_the_spot(tmp_path, brief):
    file = drafted_file(tricycle(True), tmp_path)
    run, trajectory = driven(prepared(file, pressed(0.0, 1.0, 150), simulation__dt=DT), 150)
    assert trajectory.verdict.succeeded, trajectory.verdict
    assert pose_of(run, trajectory.q[-1])[2] > 0.5
    assert abs(reduced_of(run).robot.joint_values(trajectory.q[-1])["turn_front_joint"]) == pytest.approx(np.pi / 2)


def test_a_raked_fork_that_turns_does_not_drive_the_base(tmp_path):
    run, trajectory = driven(bending(tmp_path, 0.3, pressed(0.0, 1.0, 150)), 150)
    poses = np.array([pose_of(run, q) for q in trajectory.q])
    assert np.abs(trajectory.v2[:, 0]).max() < 1e-4
    assert np.abs(poses[-1, 2] - poses[0, 2]) < 0.1
    assert abs(reduced_of(run).robot.joint_values(trajectory.q[-1])["bend"]) > 0.6


def test_two_keys_and_joints_keep_the_efforts_of_a_draft_and_its_links_apart():
    """4 rad/s^2 and m/s^2 once took more than the wheels of TIAGo have; UR5 drove its arm 3 mm into its base."""
    arm = [(0, {"kind": "joint_goal", "joint": f"arm_{k}_joint", "position": at}) for k, at in ((1, 1.5), (4, 1.8))]
    program = {"type": "qp", "tracker": "computed_torque", "tasks": [{"damping": {}}]}  # a scenario's own
    for given in ({}, {"controller": program}):
        result = drive(prepared("tiago", arm + pressed(1.0, 1.0, 200), simulation__dt=DT, **given), samples=250)
        assert (result.trajectory.verdict.succeeded, result.limits.worst("effort").excess < -0.1) == (True, True)
    run = prepared("ur5_robot", [(5, {"kind": "joint_goal", "joint": "shoulder_lift_joint", "position": 2.5})])
    stopped = drive(run, samples=400)
    assert not stopped.limits.collisions
    assert "avoidance holds the robot back" in stopped.trajectory.verdict.findings[-1].message


@pytest.mark.parametrize("target", [(5.0, 3.0), (4.0, -0.5), (2.0, 0.0)])
def test_an_articulated_vehicle_drives_to_a_point(target, tmp_path):
    run, trajectory = driven(bending(tmp_path, 0.0, [(0, {"kind": "base_goal", "x": target[0], "y": target[1]})]), 900)
    np.testing.assert_allclose(pose_of(run, trajectory.q[-1])[:2], target, atol=0.03)


def test_an_articulated_vehicle_that_stays_does_not_fold(tmp_path):
    commands = [(0, {"kind": "hold_base", "on": True}), (1, {"kind": "joint_goal", "joint": "bend", "position": 0.5})]
    run, trajectory = driven(bending(tmp_path, 0.0, commands), 100)
    np.testing.assert_allclose(pose_of(run, trajectory.q[-1]), pose_of(run, trajectory.q[0]), atol=1e-3)


def test_a_key_moves_the_base_until_half_a_second_after_the_last_command():
    _, trajectory = driven(manipulator([(10, {"kind": "base_velocity", "forward": 1.0, "turn": 0.0})]), 150)
    speed = trajectory.v2[:, 0]
    assert speed[10] == pytest.approx(0.0, abs=1e-9)
    assert speed[34] == pytest.approx(0.5, rel=0.02)  # "base speed", before 0.2 s + 0.5 s
    assert np.abs(speed[60:]).max() < 1e-2
    assert 0.15 < trajectory.q[-1, 0] < 0.3


def test_stop_holds_the_configuration():
    _, trajectory = driven(manipulator([(5, goal(4.0, 1.0)), (100, {"kind": "stop"})]), 250)
    assert np.abs(trajectory.v2[95]).max() > 0.1
    assert np.abs(trajectory.v2[-50:]).max() < 1e-3
    assert np.abs(trajectory.q[-1] - trajectory.q[-50]).max() < 1e-3


def test_hold_base_keeps_the_base_and_the_unreachable_goal_is_reported():
    watcher = Watcher()
    commands = [(0, {"kind": "hold_base", "on": True}), (1, goal(4.0, 0.0))]
    run, trajectory = driven(manipulator(commands), 400, watcher=watcher)
    np.testing.assert_allclose(trajectory.q[:, :4], np.tile(trajectory.q[0, :4], (400, 1)), atol=1e-3)
    reach = np.linalg.norm(point_of(run, trajectory.q[-1], "tip")[:2] - [4.0, 0.0])
    assert watcher.statuses[0].distances == {}
    assert watcher.statuses[-1].distances["tip"] == pytest.approx(reach, abs=0.01)
    assert f"tip: {reach:.2f} m from its goal" in watcher.statuses[-1].messages


def test_limits_of_the_file_hold_and_are_named():
    """A slider asks for more than the velocity limit; the file's numbers are read by Pinocchio alone."""
    watcher = Watcher()
    gains, goals = {"joint speed": 3.0, "posture gain": 5.0}, {"torso_lift_joint": 0.34, "arm_1_joint": 2.6}
    commands = [(0, {"kind": "gain", "gain": name, "value": value}) for name, value in gains.items()]
    commands += [(5, {"kind": "joint_goal", "joint": name, "position": place}) for name, place in goals.items()]
    run, trajectory = driven(prepared("tiago", commands, simulation__dt=DT), 150, watcher=watcher)
    model = reduced_of(run).robot.model
    joint = model.joints[model.getJointId("torso_lift_joint")]
    speed, limit = np.abs(trajectory.v[:, joint.idx_v]), model.upperVelocityLimit[joint.idx_v]
    assert 0.95 * limit < speed.max() < 1.02 * limit
    assert "torso_lift_joint velocity" in watcher.active
    bounded = [each for each in model.joints[2:] if each.nq == 1]
    q = trajectory.q[:, [each.idx_q for each in bounded]]
    assert (q <= model.upperPositionLimit[[each.idx_q for each in bounded]] + 1e-6).all()


SCENARIO = """
robot: {urdf: arm.urdf}
obstacles:
  - sphere:
      {name: ball, radius: 0.1, position: [0.9, 0.7, 0], motion: {minimum_jerk: {by: [0, -0.65, 0, 0], duration: 4}}}
actuators: [joint_1, joint_2, joint_3]
outputs: {reducing: [{joint: joint_1}, {joint: joint_2}, {joint: joint_3}], vertical: [{frame_position: {frame: tip}}]}
controller: {type: reducing_outputs}
simulation: {duration: 1, dt: 0.02}
"""


def test_an_obstacle_that_moves_into_the_arm_is_avoided(tmp_path):
    """The distance is measured by coal on the recorded motion; a planar arm of three links at rest would be hit."""
    beam, turns = '<box size="0.4 0.06 0.06"/>', ("0 0 1", "revolute", 100, (-2.5, 2.5))
    parts = [link("link_0"), link("tip", 0.1), joint("hand", "link_3", "tip", (0.5, 0, 0), kind="fixed")]
    for k in (1, 2, 3):
        parts.append(link(f"link_{k}", 1, beam, at="0.25 0 0", moment=0.03))
        parts.append(joint(f"joint_{k}", f"link_{k - 1}", f"link_{k}", (0.5 * (k > 1), 0, 0), *turns, speed=2))
    write(tmp_path / "arm.urdf", robot(*parts))
    watcher = Watcher()
    file = str(write(tmp_path / "arm.yaml", SCENARIO))
    run, trajectory = driven(prepared(file, simulation__dt=DT), 250, watcher=watcher)
    (obstacle,) = run.scenario.experiment.obstacles
    still = distance_to(run, np.tile(trajectory.q[0], (250, 1)), obstacle, trajectory.time)
    moved = distance_to(run, trajectory.q, obstacle, trajectory.time)
    assert still.min() < -0.02
    assert moved.min() > 0.01  # of the clearance, 0.02 m
    assert {"link_2 / ball distance"} <= watcher.active


def distance_to(run, configurations, obstacle, times):
    model, geometry = reduced_of(run).robot.model, reduced_of(run).robot.collision_model
    data, placed = model.createData(), geometry.createData()
    found = []
    for q, t in list(zip(configurations, times, strict=True))[::5]:
        pin.updateGeometryPlacements(model, data, geometry, placed, q)
        pose = obstacle.placement(float(t))
        ball = coal.Transform3s(pose.rotation, pose.translation)
        for shape, place in zip(geometry.geometryObjects, placed.oMg, strict=True):
            own = coal.Transform3s(place.rotation, place.translation)
            result = coal.DistanceResult()
            found.append(coal.distance(shape.geometry, own, obstacle.shape, ball, coal.DistanceRequest(), result))
    return np.array(found)


def test_commands_of_a_queue_are_logged_at_their_sample_and_give_the_same_motion_again():
    live = manipulator()
    queue = CommandQueue(live.controls)
    commands = {10: {"kind": "base_goal", "x": 0.5, "y": 0.2}, 90: {"kind": "end"}}

    def show(sample, status):
        if command := commands.get(round(sample.time / DT)):
            assert queue.put(command)

    result = drive(live, queue, watcher=show)
    assert [each.sample for each in live.log] == [11, 91]
    assert result.trajectory.outcome is rnc.Outcome.COMPLETED
    assert len(result.trajectory.time) == 92
    again = manipulator()
    again.log[:] = live.log
    repeated = drive(again, samples=92).trajectory
    assert np.array_equal(result.trajectory.q, repeated.q)
    assert np.array_equal(result.trajectory.T, repeated.T)


REFUSED = {
    "mobile-manipulator": (["joint_1", "joint_2"], "move only 2 of them (none moves base_speed_x, base_yaw)"),
    "snakeboard": (["rotor", "front_steering", "back_steering"],
        "4 independent velocities, but its actuators move only 3"),
}  # fmt: skip


@pytest.mark.parametrize("source", REFUSED)
def test_a_robot_whose_actuators_move_less_is_refused_in_one_line(source):
    actuators, words = REFUSED[source]
    with pytest.raises(rnc.ConfigurationError, match=f"{source}: cannot be driven by velocities") as refusal:
        prepared(source, actuators=actuators)
    assert "\n" not in str(refusal.value)
    assert words in str(refusal.value)


CONTROLS = DriveControls(frames={"tip": (True, True, False)}, joints={}, base=DrivenBase("base", True, False))
GOALS = initial_goals(CONTROLS)


def test_a_bare_robot_is_drafted_and_driven(brief):
    run = prepared("differential_drive.urdf", [(0, {"kind": "base_goal", "x": 0.5, "y": 0.3})])
    assert run.controls.base is not None
    assert (run.controls.base.turns, run.controls.base.slides) == (True, False)
    assert run.scenario.experiment.simulation.dt == 0.01
    trajectory = drive(run, samples=500).trajectory
    np.testing.assert_allclose(point_of(run, trajectory.q[-1], run.controls.base.frame)[:2], [0.5, 0.3], atol=0.03)


def test_limits_that_gave_way_come_first_and_accelerations_are_counted():
    report = LimitReport(("a velocity", "b / c distance", "a acceleration"), {"b / c distance": 0.0123}, {})
    status = DriveStatus(1.0, GOALS, report, {"tip": 0.5}, "no frame 'x'", {})
    assert status.limits == ["b / c distance: exceeded by 0.012", "a velocity", "acceleration of 1 motion"]
    assert status.messages == ["tip: 0.50 m from its goal", "refused: no frame 'x'"]
    assert status._replace(report=LimitReport((), {}, {}), distances={}, refused="").messages == []


def test_distances_count_the_axes_along_which_a_frame_moves():
    wanted = GOALS._replace(frames={"tip": FrameGoal(frame="tip", position=(1.0, 0.0, 9.0))}, base_goal=(5.0, 0.0))
    points = {"tip": np.array([0.5, 0.0, 0.0]), "base": np.array([0.0, 0.0, 0.3])}
    assert goal_distances(CONTROLS, wanted, points) == {"tip": 0.5, "base": 5.0}
    assert goal_distances(CONTROLS, wanted, {**points, "tip": np.array([0.995, 0.0, 0.0])}) == {"base": 5.0}
    assert goal_distances(CONTROLS, GOALS, points) == {}
