"""The program in reduced velocities: law (12) without limits, conditions of optimality, and samples that join."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.control import ControlSample, RedundancyController, VelocityQP, limits, tasks
from rnc_pin.motion.planning import Hold, MinimumJerk
from rnc_pin.motion.whole_body.task_hierarchy import MotionMetric
from systems import random_states, space_robot, spinning_space_robot, tiago

TIP = MinimumJerk([1.0, 1.0], [0.5, 0.7], 2.0)
LAW = 1e-9  # of the largest rate; the bound


@pytest.mark.parametrize("system", [space_robot, spinning_space_robot])
def test_without_active_limits_the_program_is_law_12(system):
    reduced, turn = system(), MinimumJerk([0.0], [0.3], 2.0)
    followed = [tasks.OutputTask(rnc.FramePosition("tip", "xy"), TIP, gain=0.9)]
    followed += [tasks.OutputTask(rnc.JointPosition("platform"), turn, gain=1.7)]
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    law = RedundancyController(task, TIP, turn, k3=1.7, k21=0.9)
    wide = limits.JointVelocityLimit(limit=1e6)
    for q, v2 in random_states(reduced, 8, seed=1):
        sample = ControlSample(reduced, 0.3, q, v2, 1e-6)
        expected = law.step(sample.time, sample.end.measure(), None)[0].v2
        for program in (VelocityQP(reduced, followed), VelocityQP(reduced, followed, [wide])):
            found = program.solve(sample)
            np.testing.assert_allclose(found.v2, expected, rtol=0, atol=LAW * (1 + np.abs(expected).max()))
            assert not found.multipliers.any()


def test_law_12_moves_the_arm_of_tiago_as_the_program_does():
    """Redundant rates of the joints for three coordinates of the hand, while the base drives."""
    reduced = tiago()
    arm = list(reduced.reducing.names[2:])
    chosen = rnc.Task.of(reduced, list(reduced.reducing.names[:2]), arm, list(reduced.vertical.names[:3]))
    drive, reach = MinimumJerk([0.0, 0.0], [1.0, 0.5], 2.0), MinimumJerk([0.6, 0.1, 0.8], [0.9, 0.4, 1.0], 2.0)
    law = RedundancyController(chosen, drive, reach, k3=1.3, k21=0.0)
    ahead = tasks.OutputTask(rnc.FrameSpeed("base_link"), MinimumJerk([0.0], [1.0], 2.0))
    turn = tasks.OutputTask(rnc.FrameYaw("base_link"), MinimumJerk([0.0], [0.5], 2.0), gain=0.0)
    hand = tasks.OutputTask(rnc.FramePosition("arm_7_link"), reach, gain=1.3)
    goals = [ahead, turn, hand, tasks.DampingTask(arm, priority=1)]
    program = VelocityQP(reduced, goals, [limits.JointVelocityLimit(limit=1e6)])
    for q, v2 in random_states(reduced, 4, seed=2):
        sample = ControlSample(reduced, 0.7, q, v2, 1e-4)
        measurement = sample.end.measure(np.zeros(reduced.r))
        expected = law.step(sample.time, measurement, None)[0].v2
        found = program.solve(sample)
        np.testing.assert_allclose(found.v2, expected, rtol=0, atol=LAW * (1 + np.abs(expected).max()))
        assert not found.multipliers.any()


def tiago_program(limit=0.2, **settings):
    reduced = tiago()
    arm = [name for name in reduced.robot.joint_names[1:] if "wheel" not in name]
    reach = tasks.OutputTask(rnc.FramePosition("arm_7_link"), Hold([1.5, 1.0, 1.2]), gain=3.0)
    level = tasks.OutputTask(rnc.FrameOrientation("arm_7_link"), Hold([0.0, 0.3, 0.0]), gain=1.0, weight=[0.2, 0.5, 1])
    posture = [tasks.OutputTask(rnc.JointPosition(name), Hold([0.1]), gain=2.0, weight=0.05) for name in arm]
    slow = [limits.JointVelocityLimit(limit=limit, margin=0.0)]
    return reduced, VelocityQP(reduced, [reach, level, *posture], slow, **settings)


@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_the_solution_satisfies_the_conditions_of_optimality(damping):
    """Stationarity, signs of multipliers, complementarity and bounds, written from the tasks and limits themselves.

    A residual of rows that turn with the configuration adds the cost ``lambda`` of a motion: 2 dt times the residual
    and the levers of these rows.
    """
    reduced, program = tiago_program(damping=damping)
    touched, metric = 0, MotionMetric(reduced)
    for q, v2 in random_states(reduced, 6, seed=3):
        sample = ControlSample(reduced, 0.0, q, 0.1 * v2, 0.002)
        found = program.solve(sample)
        R, gradient, levers, squares = sample.end.R, np.zeros(reduced.r), np.zeros(reduced.n), 0.0
        for each in program.tasks:
            rows = each.bind(reduced).rows(sample)
            weight = np.broadcast_to(np.asarray(each.weight, dtype=float), len(rows.rate))
            J, error = rows.jacobian @ R, rows.jacobian @ R @ found.v2 - rows.rate
            gradient += J.T @ (weight * error)
            if not isinstance(each.output, rnc.JointPosition):  # a constant Jacobian needs no damping
                levers, squares = levers + weight @ rows.jacobian**2, squares + weight @ error**2
        lever, of_v2 = np.sqrt(levers @ metric.curvature), metric.basis(R).of_v2
        gradient += (damping**2 + 2.0 * sample.dt * np.sqrt(squares) * lever) * (of_v2.T @ of_v2 @ found.v2)
        box = program.limits[0].bind(reduced).rows(sample)
        values, force = box.jacobian @ R @ found.v2, found.multipliers[0]
        scale = np.abs(gradient).max() + np.abs(force).max()
        np.testing.assert_allclose(gradient + (box.jacobian @ R).T @ force, 0.0, atol=1e-5 * scale)
        assert (values <= box.upper + 1e-9).all()
        assert (values >= box.lower - 1e-9).all()
        np.testing.assert_allclose(values[force > 0], box.upper[force > 0], atol=1e-9)
        np.testing.assert_allclose(values[force < 0], box.lower[force < 0], atol=1e-9)
        touched += np.count_nonzero(force)
    assert touched > 6


def test_samples_join_without_jumps_and_the_rate_is_exact():
    reduced, program = tiago_program()
    q = reduced.robot.configuration({"arm_2_joint": -0.5, "arm_4_joint": 1.0})
    still = reduced.at(q, np.zeros(reduced.r)).measure()
    state = program.initial_state(still)
    first, state = program.step(0.0, still, state)
    np.testing.assert_array_equal([first.v2, first.v2_dot], 0.0)  # no interval is known yet
    target, state = program.step(0.01, still, state)
    assert np.abs(target.v2_dot).max() > 1
    shorter, _ = program.step(0.016, still, state)
    np.testing.assert_array_equal(shorter.v2, target.v2 + (0.016 - 0.01) * target.v2_dot)
    later, _ = program.step(0.05, still, state)  # a late sample: the planned end is held
    np.testing.assert_array_equal(later.v2, target.v2 + 0.01 * target.v2_dot)
    np.testing.assert_allclose(target.v2_held, (target.v2 + later.v2) / 2, rtol=1e-12, atol=1e-15)  # moves as far
    wheels = reduced.robot.velocity_indices("wheel_left_joint")
    assert abs((reduced.at(q).R @ later.v2)[wheels][0]) <= 0.2 + 1e-9


def test_desired_outputs_are_recorded_where_the_model_has_them():
    reduced, program = tiago_program(dt=0.002)
    here = reduced.at(reduced.robot.configuration(), np.zeros(reduced.r)).measure()
    target, _ = program.step(0.0, here, program.initial_state(here))
    np.testing.assert_array_equal(target.x1, [1.5, 1.0, 1.2, np.nan])
    np.testing.assert_array_equal(target.x2, [np.nan, np.nan] + [0.1] * 10)
