"""A light wrist on a slow cart: the factor per sample in closed form, with and without the damping."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.control import VelocityQP, limits, tasks
from rnc_pin.motion.planning import Hold
from rnc_pin.motion.whole_body import ControlSample, InverseDynamicsQP, task_hierarchy
from rnc_pin.motion.whole_body.limit_stack import ProgramBounds
from rnc_pin.motion.whole_body.task_hierarchy import MotionMetric, SampledDamping, TaskLevels, solve_cascade
from systems import free_flying_panda, random_states, space_robot, tiago
from urdf_parts import joint, link, read

LEVER, GAIN, FAR, SLOW, DT = 0.1, 5.0, 3.0, 0.1, 0.025
"""[m], [1/s], [m] of the goal ahead, [m/s] of the cart, [s]"""


@pytest.fixture(scope="module")
def reduced(tmp_path_factory):
    parts = [link("world"), link("cart", 20), link("hand", 0.1, moment=0.001), '<link name="tip"/>']
    parts += [joint("slide", "world", "cart", axis="1 0 0", kind="prismatic", effort=500, limits=(-9, 9), speed=SLOW)]
    parts += [joint("wrist", "cart", "hand", axis="0 0 1", kind="revolute", effort=50, limits=(-3, 3), speed=9)]
    parts += [joint("grip", "hand", "tip", (LEVER, 0, 0), kind="fixed")]
    robot = read(tmp_path_factory.mktemp("cart") / "cart.urdf", *parts)
    return rnc.NonholonomicSystem(robot, [], ["slide", "wrist"]).reduce()


REACH = tasks.OutputTask(rnc.FramePosition("tip", "xy"), Hold([FAR, 0.0]), gain=GAIN)
SPEED = limits.JointVelocityLimit(margin=0.0)


def slope(residual, share):
    """Velocity of the wrist per angle, negative: least squares over (y, damping), linear in the angle."""
    return (residual * LEVER + GAIN * LEVER**2) / (LEVER**2 + share * DT * residual * LEVER)


@pytest.mark.parametrize("share", [0.0, 2.0])
def test_the_wrist_follows_its_sampled_loop(reduced, share, monkeypatch):
    """``v+ = -a (angle + h v)``, ``angle+ = angle + h (v + v+) / 2``."""
    monkeypatch.setattr(task_hierarchy, "_SAMPLED_DAMPING", share)
    program = VelocityQP(reduced, [REACH], [SPEED], dt=DT)
    q, v = np.array([0.0, 1e-9]), np.array([SLOW, 0.0])
    angles, expected = [q[1]], [q[1]]
    angle, speed = q[1], 0.0
    for _ in range(8):
        found = program.solve(ControlSample(reduced, 0.0, q, v, DT)).v2
        residual = GAIN * (FAR - (q[0] + DT * v[0]) - LEVER) - SLOW
        faster = -slope(residual, share) * (angle + DT * speed)
        angle, speed = angle + DT * (speed + faster) / 2, faster
        q, v = q + DT * (v + found) / 2, found
        angles.append(q[1])
        expected.append(angle)
    np.testing.assert_allclose(angles, expected, rtol=1e-4)
    u = DT * slope(GAIN * (FAR - LEVER) - SLOW, share)
    factors = np.abs(np.roots([1.0, 1.5 * u - 1.0, -u / 2.0]))
    assert (factors.max() > 4.5) if share == 0.0 else (factors.max() < 1.0)
    np.testing.assert_allclose(abs(angles[8] / angles[7]), factors.max(), rtol=0.02)


def test_a_light_joint_is_steady_at_acceleration_level(reduced):
    """The wrist needs no effort near its limit to reverse within a sample, and does not reverse."""
    program = InverseDynamicsQP(reduced, [REACH], [SPEED], dt=DT)
    start = reduced.robot.configuration({"wrist": 0.3})
    run = rnc.simulate(reduced, program, start, 2.5, DT)
    wrist = run.v[8:, 1]
    assert np.abs(run.v[:, 0]).max() <= SLOW * (1 + 1e-6)  # the goal is out of reach
    assert np.abs(np.diff(wrist, 2)).max() < 0.05
    assert abs(run.q[-1, 1]) < 0.01


@pytest.mark.parametrize(("system", "tip"), [
    (tiago, "arm_7_link"), (free_flying_panda, "panda_hand"), (space_robot, "tip"),
])  # fmt: skip
def test_the_turn_of_a_gradient_is_within_its_bound(system, tip):
    """Against accelerations of Pinocchio at constant rates of all joints; some need a good part of the bound."""
    reduced, generator, used = system(), np.random.default_rng(0), []
    model, data, axes = reduced.robot.model, reduced.robot.model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    metric, frame = MotionMetric(reduced), reduced.robot.frame_id(tip)
    for _ in range(500):
        q, n = reduced.random_configuration(generator), generator.normal(size=model.nv) ** 3
        pin.forwardKinematics(model, data, q, n, np.zeros(model.nv))
        turned = pin.getFrameClassicalAcceleration(model, data, frame, axes).linear
        J = pin.computeFrameJacobian(model, data, q, frame, axes)[:3]
        lever = np.sqrt((J**2).sum(axis=0) @ metric.curvature)
        used.append(np.linalg.norm(turned) / (lever * np.sum((metric.scales * n) ** 2)))
    assert 0.2 < max(used) < 1.0


@pytest.mark.parametrize("kind", [VelocityQP, InverseDynamicsQP])
def test_motions_do_not_depend_on_the_reduced_velocities(kind):
    """Wheel angles, or speed and yaw, while the residual of a goal out of reach damps: the same accelerations."""
    one = tiago()
    wheels, arm = ["wheel_left_joint", "wheel_right_joint"], list(one.reducing.names[2:])
    other = rnc.NonholonomicSystem(
        one.robot, [rnc.RollingWheel(f"wheel_{side}_link", 0.0985) for side in ("left", "right")], [*wheels, *arm]
    ).reduce([rnc.JointPosition(each) for each in (*wheels, *arm)])
    reach = tasks.OutputTask(rnc.FramePosition("arm_7_link"), Hold([9.0, 3.0, 2.0]), gain=3.0)
    wanted, dt = [reach, tasks.PostureTask(dict.fromkeys(arm, 0.2), priority=1)], 0.02
    for q, v2 in random_states(one, 4, seed=5):
        v, ends = 0.1 * one.at(q).R @ v2, []
        for reduced in (one, other):
            sample = ControlSample(reduced, 0.0, q, reduced.at(q, v=v).v2, dt)
            program = kind(reduced, wanted, dt=dt)
            by = (sample,) if kind is VelocityQP else (0.0, q, sample.start.v2)
            ends.append(sample.end.R @ program.solve(*by).v2)
            rows = reach.bind(reduced).rows(sample)
            assert np.linalg.norm(rows.jacobian @ ends[-1] - rows.rate) > 0.1
        accelerations = (np.array(ends) - v) / dt
        np.testing.assert_allclose(*accelerations, rtol=0, atol=1e-9 * np.abs(accelerations).max())


def reversing(values, largest):
    """Largest change, as a share of a limit, that takes part in three reversals in a row."""
    change = np.diff(values, axis=0) / largest
    signs = np.sign(change)
    least = np.min([np.abs(change[k : len(change) - 3 + k]) for k in range(4)], axis=0)
    turning = np.all([signs[k : len(signs) - 3 + k] * signs[k + 1 : len(signs) - 2 + k] < 0 for k in range(3)], axis=0)
    return float((least * turning).max(initial=0.0))


@pytest.mark.parametrize("beyond", [1.0, 0.01])
@pytest.mark.parametrize(("name", "shoulder", "reach"), [("panda", 0.333, 0.962), ("ur5_robot", 0.089, 0.95)])
def test_an_arm_stretches_towards_a_goal_out_of_reach_and_rests(name, shoulder, reach, beyond):
    """With a posture below, by both programs; nothing reverses by more than 5 % of its limit."""
    fingers = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02} if name == "panda" else {}
    robot = rnc.Robot.from_example(name, lock=fingers)
    arm = rnc.NonholonomicSystem(robot, [], list(robot.joint_names)).reduce()
    goal = np.array([0.0, 0.0, shoulder]) + (reach + beyond) * np.array([0.6, 0.48, 0.64])
    tip = rnc.FramePosition("panda_hand" if name == "panda" else "tool0")
    q0 = robot.configuration(dict(zip(robot.joint_names[1:4], (-0.6, 0.4, -1.2), strict=True)))
    posture = tasks.PostureTask(dict.fromkeys(robot.joint_names, -0.4), priority=1)
    wanted = [tasks.OutputTask(tip, Hold(goal), gain=3.0), posture]
    held = [limits.JointPositionLimit(), limits.JointVelocityLimit()]
    by_inputs = InverseDynamicsQP(arm, wanted, held, dt=0.01, braking_time=None)
    run = rnc.simulate(arm, by_inputs, q0, 4.0, 0.01)
    assert reversing(run.T[200:], arm.actuation.limits) < 0.05
    _, path = rnc.kinematic_rollout(arm, VelocityQP(arm, wanted, held, dt=0.01), q0, duration=4.0)
    fastest = robot.model.upperVelocityLimit
    for q in (run.q, path):
        assert reversing(np.diff(q[200:], axis=0) / 0.01, fastest) < 0.05
        assert np.abs(q[-1] - q[-2]).max() < 2e-3
        stretched = arm.at(q[-1]).position.placement(robot.frame_id(tip.frame)).translation
        assert np.linalg.norm(goal - stretched) < beyond + 0.15


def test_lower_levels_do_not_stop_where_a_limit_comes_to_touch():
    J, rate = np.array([[1.0, 0, 0], [0, 0.05, 0], [0, 1, 0], [0, 0, 1]]), np.array([1.0, 0.5, 5, 1])
    sampled = SampledDamping(0.01, np.array([2.0, 0.0]), np.array([1.0, 1.0, 0.0, 0.0]))
    bounds = ProgramBounds(np.eye(1, 3), np.array([-9.0]), np.array([9.0]), np.zeros(1, dtype=int), 1)
    levels = TaskLevels(J, rate, np.array([2, 4]))
    free = solve_cascade(levels, bounds, 0.0, sampled=sampled)
    touched = bounds._replace(upper=free.unknowns[:1] - 1e-7)
    touching = solve_cascade(levels, touched, 0.0, sampled=sampled)
    assert touching.multipliers[0] > 0.0
    np.testing.assert_allclose(touching.unknowns, free.unknowns, atol=1e-5)


def test_a_limit_that_only_touches_leaves_lower_levels_their_speed():
    """Along one row the slower direction is free, along both it is not; in between, the speed is between."""
    levels, bounds = np.diag([1.0, 0.1, 0.5]), ProgramBounds(np.eye(3)[:2], *np.zeros((2, 2)), np.arange(2), 2)
    free = task_hierarchy._FreeDirections(np.zeros(3), np.eye(3), np.zeros(3))
    level = task_hierarchy._Level(free, levels, np.ones(3), 1.0, 0.0, np.arange(3), 0.01)
    speeds = [level.largest_speed(bounds, np.array([1.0, push])) for push in (0.0, 1e-4, 0.01, 0.03, 0.2, 1.0)]
    assert speeds[0] == speeds[1] < speeds[2] < speeds[3] < speeds[4] == speeds[5]
