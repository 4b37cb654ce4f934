"""Velocity commands of a kinematic controller: exact, within limits, and safe after a fault."""

from itertools import pairwise

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from bodies import add_frame
from controlled_tasks import reaching
from simple_controllers import Memoryless

DT = 0.02


def differential_drive(speed=0.4, turn=0.3):
    reduced = systems.differential_drive()
    return reduced, rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([speed, turn]))


def constant(v2):
    """Return a target that does not change."""
    return Memoryless(lambda *_: rnc.control.VelocityTarget(np.array(v2, dtype=float), np.zeros(len(v2))))


def test_a_command_is_the_admissible_motion_of_the_target():
    reduced, target, q0 = reaching(4.0)
    v = reduced.at(q0, np.array([0.1, -0.2, 0.1, 0.2])).v
    loop = rnc.VelocityLoop(reduced, target, DT, limits=False)
    loop.step(0.0, q0, v)
    command = loop.step(1.0, q0, v)
    desired = target.step(1.0, reduced.at(q0, v=v).measure(np.zeros(4)), None)[0].v2
    state = reduced.at(q0, desired)
    assert np.abs(command.v).max() > 0.1
    assert command.v == pytest.approx(state.v, abs=1e-12)
    assert np.abs(state.A @ command.v).max() < 1e-12
    assert command.twist == pytest.approx((command.v[0], command.v[1], command.v[2]), abs=1e-14)
    assert (loop.joints, command.joints) == (("joint_1", "joint_2"), pytest.approx(command.v[3:]))
    assert command.u == pytest.approx(state.B.T @ command.v)  # forward, yaw, two joints
    assert command.u[:2] == pytest.approx([command.twist.forward, command.twist.yaw])


def test_the_twist_of_another_frame_includes_its_lever():
    reduced, _ = differential_drive()
    wheel = reduced.robot.model.jointPlacements[2].translation
    add_frame(reduced.robot.model, "sensor", 1, (0.4, 0.1, 0.3))
    loop = rnc.VelocityLoop(reduced, constant([0.5, 0.8]), DT, base="sensor", joints=["right_wheel_joint"])
    assert loop.step(0.0, None, None).twist == (0.0, 0.0, 0.0)  # nothing is known yet
    command = loop.step(DT, reduced.robot.configuration({"root_joint": [1.0, 2.0, 0.4]}), np.zeros(5))
    assert command.twist == pytest.approx((0.5 - 0.8 * 0.1, 0.8 * 0.4, 0.8))
    assert command.joints == pytest.approx([(0.5 + 0.8 * abs(wheel[1])) / 0.1])


def test_limits_scale_the_whole_motion():
    reduced, _ = differential_drive()
    free = rnc.VelocityLoop(reduced, constant([4.0, 2.0]), DT, limits=False)
    limited = rnc.VelocityLoop(reduced, constant([4.0, 2.0]), DT)  # the file allows 30 rad/s
    q, rest = reduced.robot.configuration(), np.zeros(5)
    wanted, given = free.step(0.0, q, rest), limited.step(0.0, q, rest)
    scale = 30.0 / np.abs(wanted.joints).max()
    assert scale < 1
    assert given.v == pytest.approx(scale * wanted.v)
    slow = rnc.VelocityLoop(reduced, constant([4.0, 2.0]), DT, limits=[1.0, np.inf, 0.1, np.inf, np.inf])
    assert slow.step(0.0, q, rest).twist == pytest.approx((0.2, 0.0, 0.1))
    assert limited.last.command.v2_desired == pytest.approx(scale * np.array([4.0, 2.0]))


def test_invalid_measurements_hold_the_command_and_then_stop():
    reduced, target = differential_drive()
    loop = rnc.VelocityLoop(reduced, target, DT, timeout=2 * DT)
    q, rest = reduced.robot.configuration(), np.zeros(5)
    assert not loop.command.v.any()
    first = loop.step(0.0, q, rest)
    assert loop.command.v == pytest.approx(first.v, abs=1e-12)
    held = loop.step(DT, np.full(6, np.nan), rest)
    assert (held.u, held.v) == (pytest.approx(first.u), pytest.approx(first.v))
    assert held.twist == pytest.approx(first.twist, abs=1e-12)
    loop.step(2 * DT, q, rest + 1e4)
    assert "v reaches 1e+04" in loop.state.fault
    for sample in range(3, 6):
        stopped = loop.step(sample * DT, q[:2], rest)
    assert not stopped.v.any()
    assert not any(stopped.twist)
    assert loop.step(6 * DT, q, rest).u == pytest.approx(first.u)
    assert loop.state.fault is None


def test_brake_lets_velocities_decay_within_the_constraints():
    reduced, target, q0 = reaching(4.0)
    loop = rnc.VelocityLoop(reduced, target, DT, fallback="brake", timeout=0.0, brake=5.0)
    v = reduced.at(q0, np.zeros(4)).v
    loop.step(0.0, q0, v)
    first = loop.step(1.0, q0, v)
    loop.step(1.0 + DT, None, v)
    second = loop.step(1.0 + 2 * DT, None, v)
    assert second.v == pytest.approx(np.exp(-5.0 * DT) * first.v, abs=1e-12)  # the first one is held
    assert np.abs(first.v).max() > 0.1


@pytest.mark.parametrize("wrong", [[np.nan, 0.0], [1.0, 0.0, 0.0]])
def test_an_unusable_target_stops_the_robot_for_good(wrong):
    reduced, _ = differential_drive()
    v2 = np.array([0.4, 0.0])
    target = Memoryless(lambda *_: rnc.control.VelocityTarget(v2, np.zeros(2)))
    loop = rnc.VelocityLoop(reduced, target, DT)
    q, rest = reduced.robot.configuration(), np.zeros(5)
    assert loop.step(0.0, q, rest).twist.forward == pytest.approx(0.4)
    v2 = np.array(wrong)
    assert not loop.step(DT, q, rest).v.any()
    assert "v2 of a target" in loop.state.fault
    v2 = np.array([0.4, 0.0])
    assert not loop.step(2 * DT, q, rest).v.any()
    strict = rnc.VelocityLoop(reduced, constant(wrong), DT, fallback="raise")
    with pytest.raises(rnc.RncError, match="v2 of a target"):
        strict.step(0.0, q, rest)


def test_a_force_controller_and_an_unknown_joint_are_refused():
    reduced, target = differential_drive()
    loop = rnc.VelocityLoop(reduced, rnc.control.VelocityTracker(target), DT, fallback="raise")
    with pytest.raises(rnc.InputError, match="gives forces, not velocities"):
        loop.step(0.0, reduced.robot.configuration(), np.zeros(5))
    with pytest.raises(rnc.ConfigurationError, match="did you mean 'left_wheel_joint'"):
        rnc.VelocityLoop(reduced, target, DT, joints=["left_wheel_jont"])


def travelled(loop, times, slow=1.0, clock=lambda t: t, missing=lambda t: False):
    """Distance and turn of a base that follows twists at a share of their speed, by Euler steps of one millisecond."""
    robot, pose, done = loop.reduced.robot, np.zeros(3), np.zeros(2)
    for first, last in pairwise(times):
        q = robot.configuration({"root_joint": pose})
        v = np.zeros(robot.nv) if loop.last is None else slow * loop.command.v
        twist = loop.step(clock(first), np.full(robot.nq, np.nan) if missing(first) else q, v).twist
        for _ in range(round((last - first) / 1e-3)):
            step = 1e-3 * slow * np.array([twist.forward, twist.yaw])
            pose += np.array([step[0] * np.cos(pose[2]), step[0] * np.sin(pose[2]), step[1]])
            done += step
    return done


@pytest.mark.parametrize("fallback", ["zero", "brake"])
@pytest.mark.parametrize("velocity", ["measured", "commanded"])
def test_a_clock_that_jumps_and_a_gap_of_measurements_leave_no_error_of_the_distance(velocity, fallback):
    reduced, _ = differential_drive()
    way = rnc.planning.MinimumJerk([0.0, 0.0], [1.0, 0.5], 2.0)
    target = rnc.control.ReducingOutputController(reduced, way)
    times, options = DT * np.arange(400), {"velocity": velocity, "fallback": fallback}
    for disturbance in (
        {"clock": lambda t: t + 3600.0 * (t > 1.0)},  # first it is late by an hour
        {"missing": lambda t: 0.9 < t < 1.5},
    ):
        loop = rnc.VelocityLoop(reduced, target, DT, **options)
        # A measured velocity is that of the interval before, so its trapezoids have an error of v dt / 2.
        assert travelled(loop, times, **disturbance) == pytest.approx([1.0, 0.5], abs=0.015)
