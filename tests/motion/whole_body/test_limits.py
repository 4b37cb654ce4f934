"""Limits by replay in Pinocchio: an ideal robot moves as commanded, and the limits of its file are looked up again."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from driven import drive
from rnc_pin.control import InverseDynamicsQP, VelocityQP, limits, tasks
from rnc_pin.motion.planning import Hold
from rnc_pin.motion.whole_body.limit_stack import LimitStack
from rnc_pin.motion.whole_body.limits.control_limit import PlannedBraking, velocity_to_stop
from rnc_pin.robots.joint_values import limited_positions
from systems import floating_robot, in_joints, mecanum, space_robot_in_joints, tiago

RANGE = 1e-6  # of a limit's range
DT = 0.01


@cache
def manipulator_in_joints():
    """The mobile manipulator in velocities that are never dependent, wherever its arm is."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")])
    x2 = [rnc.FrameSpeed("base"), rnc.FrameYaw("base"), rnc.JointPosition("joint_1"), rnc.JointPosition("joint_2")]
    return system.reduce(x2)


@pytest.mark.parametrize("seed", range(2))
def test_random_goals_respect_the_limits_of_the_file(seed):
    """The file has limits for torso, arm, head and wheels. Goals change every half second, most are out of reach."""
    reduced = tiago()
    robot, generator = reduced.robot, np.random.default_rng(seed)
    model = robot.model
    names = [name for name in robot.joint_names[1:] if "wheel" not in name]
    places = [model.joints[robot.joint_id(name)].idx_q for name in names]
    columns = [robot.velocity_indices(name).start for name in names]
    low, high = model.lowerPositionLimit[places], model.upperPositionLimit[places]
    q0 = robot.configuration({n: float(generator.uniform(a, b)) for n, a, b in zip(names, low, high, strict=True)})
    goals = generator.uniform([-2, -2, -0.5], [2, 2, 2.5], (6, 3))
    jumping = SimpleNamespace(size=3, duration=np.inf, at=lambda t: Hold(goals[min(int(t / 0.5), 5)]).at(t))
    deceleration = 6.0
    wanted = [tasks.OutputTask(rnc.FramePosition("arm_7_link"), jumping, gain=4.0), tasks.DampingTask(weight=1e-3)]
    kept = [limits.JointPositionLimit(deceleration=deceleration, margin=0.0), limits.JointVelocityLimit()]
    program = VelocityQP(reduced, wanted, [*kept, limits.AccelerationLimit(deceleration)], dt=DT)
    run = drive(reduced, program, q0, 3.0, DT)
    q, v = run.q[:, places], run.v
    assert (q >= low - RANGE * (high - low)).all()
    assert (q <= high + RANGE * (high - low)).all()
    fastest = model.upperVelocityLimit
    limited = fastest < 1e10
    assert (np.abs(v[:, limited]) <= fastest[limited] * (1 + RANGE)).all()
    assert np.abs(v[:, limited]).max(axis=0).max() > 0.9 * fastest[limited].min()  # limits were reached
    change = np.abs(np.diff(run.v2, axis=0)) / DT
    assert (change <= deceleration * (1 + RANGE)).all()
    assert not program.report(run.states[-1]).worst
    assert np.abs(run.v[:, columns]).max() > 0.5


@pytest.mark.parametrize(("fastest", "deceleration"), [(0.8, 3.2), (0.0, 1.5), (np.inf, 1.5)])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_joint_stops_before_its_margin_at_its_own_deceleration(fastest, deceleration, way):
    """From the velocity limit in 0.25 s; without one, the range of 1.5 rad per second squared. A tenth stays unused."""
    model = space_robot_in_joints().robot.model.copy()
    joint = model.joints[model.getJointId("joint_1")]
    low, high = sorted((-0.5 * way, 1.0 * way))
    model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q] = low, high
    model.upperVelocityLimit[joint.idx_v] = fastest
    reduced = in_joints(floating_robot(model=model))
    to_limit = tasks.PostureTask({"joint_1": 3.0 * way}, gain=1.0)
    limit = limits.JointPositionLimit(joints=["joint_1"], margin=0.1)
    program = VelocityQP(reduced, [to_limit, tasks.DampingTask(weight=1e-6)], [limit], dt=DT)
    run = drive(reduced, program, reduced.robot.configuration(), 2.0, DT)
    q, v = way * run.q[:, joint.idx_q], way * run.v2[:, 0]
    assert q.max() <= 0.85 + 1e-12
    assert q[-1] == pytest.approx(0.85, abs=1e-4)
    slower = -np.diff(v) / DT
    middle = (v[:-1] < 0.8 * v.max()) & (v[:-1] > 0.2 * v.max())
    assert np.median(slower[middle]) == pytest.approx(deceleration, rel=1e-6)


def test_the_velocity_to_stop_solves_its_equation(generator):
    """Simulated stop: whole samples at full deceleration, the last one at what is left."""
    for room, a, dt in generator.uniform([0.0, 0.1, 0.001], [2.0, 20.0, 0.05], (200, 3)):
        v = float(velocity_to_stop(np.array([room]), np.array([a]), dt)[0])
        first = v
        passed = dt * v / 2
        while v > 0:
            slower = max(v - a * dt, 0.0)
            passed += dt * (v + slower) / 2
            v = slower
        # The order of full and partial samples changes the distance by less than the chord differs from the parabola.
        assert passed <= room + 1e-12 + a * dt**2 / 8
        assert passed >= room - a * dt**2
        assert first >= 0


def test_named_joints_change_their_velocity_no_faster_than_their_acceleration():
    """One of two joints is named: it uses its whole acceleration, the other exceeds it."""
    reduced = manipulator_in_joints()
    posture = tasks.PostureTask({"joint_1": 1.0, "joint_2": -1.5}, gain=4.0)
    program = VelocityQP(reduced, [posture], [limits.AccelerationLimit(2.0, joints=["joint_1"])], dt=DT)
    run = drive(reduced, program, reduced.robot.configuration({"joint_1": 0.2, "joint_2": -0.3}), 0.15, DT)
    slow, free = np.abs(np.diff(run.v[:, 3:5], axis=0)).max(axis=0) / DT
    np.testing.assert_allclose(slow, 2.0, rtol=1e-9)
    assert free > 20.0


def test_a_joint_beyond_its_limit_may_rest_or_return():
    room = np.array([-0.1, 0.0, 1e-9])
    found = velocity_to_stop(room, np.ones(3), 0.01)
    np.testing.assert_array_equal(found[:2], 0.0)
    np.testing.assert_allclose(found[2], 1e-9 / 0.01, rtol=1e-12)  # the chord of the first sample


def test_a_braking_motion_plans_with_the_room_that_is_left():
    """At a constant deceleration over the time h, the mean of both velocities is at most the room by h."""
    reduced, at, h, rate = manipulator_in_joints(), 0.4, 0.5, 1.5
    q0, end = reduced.robot.configuration({"joint_1": at}), reduced.robot.model.upperPositionLimit[-2]
    sample = rnc.control.ControlSample(reduced, 0.0, q0, np.array([0.0, 0.0, rate, 0.0]), h)
    bound = limits.JointPositionLimit(joints=["joint_1"], margin=0.0)
    rows = LimitStack([bound], reduced).rows(sample, braking=True)
    expected = [[2 * (end - at) / h - rate], [2 * (end + at) / h + rate]]
    np.testing.assert_allclose([rows.upper, -rows.lower], expected, rtol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_limits_that_exclude_each_other_give_way_in_order(side):
    """A region wants the base to leave at once, an acceleration limit forbids it, a velocity limit never gives way."""
    reduced = manipulator_in_joints()
    q0 = reduced.robot.configuration({"root_joint": [side, 0.0, 0.0], "joint_1": 0.4, "joint_2": 1.2})
    region = limits.RegionLimit("base", box={"x": sorted([-side * np.inf, 0.5 * side])}, gain=2.0)
    slow = limits.JointVelocityLimit(joints=["joint_1", "joint_2"], limit=0.3, margin=0.0)
    gentle = limits.AccelerationLimit(0.5)
    program = VelocityQP(reduced, [tasks.DampingTask()], [region, slow, gentle], dt=DT)
    run = drive(reduced, program, q0, 4.0, DT)
    first = program.report(run.states[0])
    # The acceleration gives way, the region does not: the base leaves at 1 m/s at the end of the sample.
    assert set(first.exceeded) == {"base_speed_x acceleration"}
    np.testing.assert_allclose(first.exceeded["base_speed_x acceleration"], 1.0 - 0.5 * DT, rtol=1e-6)
    assert np.abs(run.v[:, 3:]).max() <= 0.3 + 1e-9
    assert side * run.q[-1, 0] < 0.501
    assert not program.report(run.states[-1]).exceeded
    assert program.report(run.states[-1]).worst == first.exceeded


def test_opposite_soft_limits_share_the_excess_evenly():
    reduced = manipulator_in_joints()
    q0 = reduced.robot.configuration({"root_joint": [1.0, 0.0, 0.0], "joint_1": 0.4, "joint_2": 1.2})
    left = limits.RegionLimit("base", box={"x": (-np.inf, 0.8)}, gain=1.0, priority=0)
    right = limits.RegionLimit("base", box={"x": (1.4, np.inf)}, gain=1.0, priority=0)
    program = VelocityQP(reduced, [tasks.DampingTask()], [left, right], dt=DT)
    found = program.report(drive(reduced, program, q0, 2 * DT, DT).states[0]).exceeded
    # 0.2 inside one wants -0.2 m/s, 0.4 inside the other 0.4 m/s: 0.1 m/s exceeds both by 0.3.
    np.testing.assert_allclose(list(found.values()), [0.3, 0.3], rtol=1e-5)
    above = limits.RegionLimit("base", box={"x": (1.4, np.inf)}, gain=1.0, priority=1)
    strong = VelocityQP(reduced, [tasks.DampingTask()], [left, above], dt=DT)
    found = strong.report(drive(reduced, strong, q0, 2 * DT, DT).states[0]).exceeded
    np.testing.assert_allclose(list(found.values()), [0.6], rtol=1e-5)


def test_a_region_is_exceeded_by_the_distance_beyond_its_sides():
    reduced = manipulator_in_joints()
    outside = reduced.at(reduced.robot.configuration({"root_joint": [0.8, 3.0, 0.0]}), np.zeros(reduced.r))
    region = limits.RegionLimit("base", box={"x": (-1.0, 0.5)}).bind(reduced)
    np.testing.assert_allclose(np.sort(region.exceeded_by(outside, 0.0)), [-1.8, 0.3], atol=1e-12)


def test_the_description_of_a_program_has_the_settings_of_its_tasks_and_limits():
    reduced = manipulator_in_joints()
    given = [limits.RegionLimit("base", box={"x": (-1.0, 0.5)}, gain=3.0), limits.AccelerationLimit({"joint_1": 2.0})]
    region, slow = VelocityQP(reduced, [tasks.DampingTask()], given, dt=DT).describe()["limits"]
    assert (region["frame"], region["gain"], slow["limit"]) == ("base", 3.0, {"joint_1": 2.0})


def test_hard_limits_that_a_drift_violates_are_reported_and_raise_nothing():
    """With angular momentum some joint has to move: a platform and joints that may not move exclude each other."""
    from systems import spinning_space_robot

    reduced = spinning_space_robot()
    names = ["platform", "joint_1", "joint_2", "joint_3"]
    still = limits.JointVelocityLimit(joints=names, limit=0.01)
    program = VelocityQP(reduced, [tasks.DampingTask()], [still], dt=DT)
    q0 = reduced.robot.configuration({"joint_1": 0.3, "joint_2": 1.0, "joint_3": 0.5})
    run = drive(reduced, program, q0, 3 * DT, DT)
    assert program.report(run.states[-1]).exceeded


@pytest.mark.parametrize(("region", "corner"), [
    ({"box": {"x": (-0.5, 0.6), "y": (-0.4, 0.5)}}, [0.6, 0.5]),
    ({"polygon": [(-1.0, -1.0), (1.0, -1.0), (0.0, 1.0)]}, None),
    ({"polygon": [(0.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]}, None),
    ({"polygon": [(-0.5, -0.4), (0.6, -0.4), (0.6, 0.5), (-0.5, 0.5)]}, [0.6, 0.5]),
])  # fmt: skip
def test_a_frame_stays_in_its_region(region, corner):
    """The tip is drawn to a point outside; it ends at the nearest point of the region."""
    reduced = manipulator_in_joints()
    goal = np.array([2.0, 1.5])
    goals = [tasks.OutputTask(rnc.FramePosition("tip", "xy"), Hold(goal), gain=5.0), tasks.DampingTask(weight=1e-4)]
    program = VelocityQP(reduced, goals, [limits.RegionLimit("tip", **region, gain=8.0)], dt=DT)
    q0 = reduced.robot.configuration({"root_joint": [-1.4, -0.4, -0.2], "joint_1": 0.8, "joint_2": -1.0})
    run = drive(reduced, program, q0, 5.0, DT)
    frame = reduced.robot.frame_id("tip")
    path = np.array([reduced.at(q).position.placement(frame).translation[:2] for q in run.q])
    if corner is not None:
        sides, offsets = np.array([[1, 0], [-1, 0], [0, 1], [0, -1.0]]), np.array([0.6, 0.5, 0.5, 0.4])
        nearest = np.array(corner)
    else:
        root = np.sqrt(5.0)
        sides = np.array([[0, -1], [2 / root, 1 / root], [-2 / root, 1 / root]])
        offsets = np.array([1.0, 1 / root, 1 / root])
        nearest = goal - (goal @ sides[1] - offsets[1]) * sides[1]
        nearest = np.array([0.0, 1.0]) if nearest[1] > 1 else nearest
    assert (path @ sides.T <= offsets + 1e-6).all()
    np.testing.assert_allclose(path[-1], nearest, atol=2e-3)


def test_a_joint_has_ends_where_both_are_numbers_below_ten_billion_and_in_order():
    far = 1e10
    near, beyond = np.nextafter(far, 0.0), np.finfo(float).max
    ends = ((-near, near), (-near, 0.0), (0.0, near), (-3.0, -2.0), (2.0, 3.0))
    none = (
        (-far, 2.0), (-np.inf, 2.0), (-beyond, 2.0), (-2.0, far), (-2.0, np.inf), (-2.0, beyond), (2.0, 2.0), (3.0, 2.0)
    )  # fmt: skip
    model = pin.Model()
    for index, (low, high) in enumerate((*ends, *none)):
        bounds = [np.array([each]) for each in (1e3, 1e3, low, high)]
        joint = model.addJoint(model.njoints - 1, pin.JointModelPX(), pin.SE3.Identity(), f"j{index}", *bounds)
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    found = limited_positions(rnc.Robot(model), None)
    assert (found.q, found.v) == (list(range(5)),) * 2
    np.testing.assert_array_equal(np.transpose([found.lower, found.upper]), ends)
    with pytest.raises(rnc.ConfigurationError, match="joint 'j5' has no position limits"):
        limited_positions(rnc.Robot(model), ["j0", "j5"])


@pytest.mark.parametrize("program", [VelocityQP, InverseDynamicsQP])
def test_the_speed_of_a_base_stays_within_its_circle(program):
    """A Mecanum base turns on its way; velocities come from Pinocchio."""
    reduced, dt, fastest = mecanum(), 0.02, 0.4
    robot = reduced.robot
    frame = next(f.name for f in robot.model.frames if f.parentJoint == 1)
    run_of = drive if program is VelocityQP else rnc.simulate
    goals = tasks.BasePoseTask(frame, Hold([1.0, 0.7, 1.5]), gain=2.0)
    alone = {} if program is VelocityQP else {"braking_time": None}  # the rows hold the limit, and no braking motion
    controller = program(reduced, [goals], [limits.BaseSpeedLimit(frame, fastest)], dt=dt, **alone)
    run = run_of(reduced, controller, robot.configuration(), 2.5, dt)
    data, identity, world = robot.model.createData(), robot.frame_id(frame), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    speeds = []
    for q, v in zip(run.q, run.v, strict=True):
        pin.forwardKinematics(robot.model, data, q, v)
        pin.updateFramePlacements(robot.model, data)
        speeds.append(np.linalg.norm(pin.getFrameVelocity(robot.model, data, identity, world).linear[:2]))
    assert 0.998 * np.cos(np.pi / 16) * fastest < max(speeds) <= fastest * (1 + RANGE)
    bound = limits.BaseSpeedLimit(frame, fastest).bind(reduced)
    np.testing.assert_allclose(bound.exceeded_by(reduced.at(run.q[9], v=run.v[9]), 0.0), speeds[9] - fastest, atol=1e-9)
    assert bound.names[::4] == tuple(f"{frame} speed at {angle} deg" for angle in (0, 90, 180, 270))


def test_accelerations_of_joints_have_limits_by_name():
    reduced, given = tiago(), {"arm_1_joint": 1.0, "torso_lift_joint": 0.3}
    entries = limits.AccelerationLimit(given).entries(reduced)
    assert {each.name: (each.lower, each.upper) for each in entries} == {k: (-a, a) for k, a in given.items()}
    assert [each.column for each in entries] == [reduced.robot.velocity_indices(name).start for name in given]
    v2 = np.random.default_rng(3).normal(size=reduced.r)
    sample = rnc.control.ControlSample(reduced, 0.0, reduced.robot.configuration(), v2, dt=0.01)
    rows = limits.AccelerationLimit(given).bind(reduced).rows(sample)
    v, change = sample.start.v[[each.column for each in entries]], 0.01 * np.array([*given.values()])
    found = rows.jacobian @ sample.start.v, rows.lower, rows.upper
    np.testing.assert_allclose(found, [v, v - change, v + change], rtol=1e-12)


def test_braking_plans_half_of_the_efforts_less_the_load():
    """At least a tenth of that half; rows that nothing moves, or an actuator without a limit, brake at once."""
    effects = np.array([[2.0, -1.0, 0.0], [2.0, -1.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.0, 1.0], [0.0, 0.0, 0.0]])
    load = np.array([-3.0, 3.0, -9.0, 0.0, -1.0])
    state = SimpleNamespace(R=np.eye(5), input_accelerations=(effects, load))
    braking = PlannedBraking(SimpleNamespace(actuation=SimpleNamespace(limits=np.array([4.0, 6.0, np.inf]))))
    found = braking.decelerations(np.eye(5), state)
    np.testing.assert_allclose(found, [7.0 - 3.0, 7.0, 0.1 * 1.0, np.inf, np.inf])
    assert np.isinf(braking.decelerations(np.zeros((0, 5)), state)).all()
    free = PlannedBraking(SimpleNamespace(actuation=SimpleNamespace(limits=np.full(3, np.inf))))
    assert np.isinf(free.decelerations(np.eye(5), None)).all()  # no state is looked at
