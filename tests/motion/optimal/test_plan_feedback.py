"""Feedback along plans in closed loop, and the regulator against a dense least-squares solution."""

from functools import cache

import numpy as np
import pytest
import scipy.linalg

import rnc_pin as rnc
import systems
from rnc_pin.motion.optimal import OutputBound, VelocityBound
from rnc_pin.motion.planning.action_models import Nodes, action_model


@cache
def curve(form, duration=3.0, **options):
    reduced = systems.sleigh()
    start, goal = reduced.robot.configuration(), systems.goal_of("sleigh", 1.5, 0.6, 0.5)
    return reduced, rnc.optimal.plan(reduced, start, goal, duration, form=form, **options)


@pytest.mark.parametrize("form", ["kinematic", "acceleration", "dynamic"])
def test_feedback_corrects_a_wrong_start(form):
    reduced, plan = curve(form)
    start = reduced.robot.configuration()
    start[1] += 0.05
    weights = {"root_joint[0]": 50.0, "root_joint[1]": 50.0, "root_joint[2]": 10.0}
    run = rnc.simulate(reduced, rnc.tvlqr(reduced, plan, weights, 0.1), start, 3.0, dt=0.02)
    assert np.abs(run.q[-1, :2] - plan.q[-1, :2]).max() < 0.02


MOVING = {"duration": 2.0, "at_rest": False, "v2_0": (0.8, 0.0)}  # a plan that ends in motion


@pytest.mark.parametrize("form", ["acceleration", "dynamic"])
def test_after_a_plan_that_ends_in_motion_the_velocity_falls_linearly_to_zero(form):
    reduced, plan = curve(form, **MOVING)
    controller = rnc.optimal.PlanFeedback(reduced, plan)
    largest, last = np.abs(plan.acceleration[:, :, :2]).max(axis=(0, 1)), plan.w[-1]
    stop = np.max(np.abs(last) / np.maximum(largest, np.abs(last) / plan.duration))
    for part in (0.0, 0.3, 0.8, 1.0, 1.5):
        state, _, _ = controller.planned(plan.duration + part * stop)
        np.testing.assert_allclose(state.w[0], max(0.0, 1 - part) * last, atol=2e-3)
    run = rnc.simulate(reduced, controller, plan.q[0], 2.2 + stop, dt=0.02, v2_0=plan.w[0])
    np.testing.assert_allclose(run.q[100], plan.q[-1], atol=1e-2)  # the gains of the plan keep it on its path
    assert np.abs(run.v2[-1]).max() < 2e-2
    assert np.abs(np.diff(run.v2, axis=0)).max() < 0.05  # no jump at the end of the plan


def test_regulator_is_the_dense_optimum():
    """The first input of the regulator minimises the whole quadratic cost, found by least squares."""
    reduced, plan = curve("acceleration")
    feedback = rnc.tvlqr(reduced, plan, 3.0, 0.5)  # ten times as much at the end
    model, h = action_model(reduced, "acceleration"), np.diff(plan.time)
    steps = model.step_derivatives(Nodes(plan.q[:-1], plan.w[:-1]), plan.u, h)
    K, nx, nu = steps.u.shape
    start = np.random.default_rng(0).normal(size=nx)
    free, forced = start, np.zeros((nx, K * nu))
    rows, right = [], []
    for k in range(K):
        rows.append(np.sqrt(3.0 * h[k]) * forced)
        right.append(-np.sqrt(3.0 * h[k]) * free)
        free, forced = steps.x[k] @ free, steps.x[k] @ forced
        forced[:, k * nu : (k + 1) * nu] += steps.u[k]
    rows += [np.sqrt(30.0) * forced, np.sqrt(0.5 * h[0]) * np.eye(K * nu)]
    right += [-np.sqrt(30.0) * free, np.zeros(K * nu)]
    best = np.linalg.lstsq(np.vstack(rows), np.concatenate(right))[0]
    np.testing.assert_allclose(feedback.K[0] @ start, best[:nu], rtol=1e-6)


def test_forces_that_are_held_do_not_lag_behind_gravity_and_a_heavier_arm_stays_near_its_plan():
    """Forces of the begin of samples once missed this plan by 4.3 rad/s of the period, a heavier arm by 0.97 rad."""
    reduced, heavier = systems.driven_panda(), rnc.ReducedPlant(systems.driven_panda(1.2))
    q0 = reduced.robot.configuration({"panda_joint4": -1.5, "panda_joint6": 1.5})
    plan = rnc.optimal.plan(reduced, q0, {"panda_joint1": 1.2, "panda_joint2": 0.8, "panda_joint4": -2.2}, 1.74)
    for dt, plant, most in ((0.01, None, 1e-3), (0.02, None, 2e-3), (0.01, heavier, 0.1)):
        run = rnc.simulate(reduced, rnc.tvlqr(reduced, plan), q0, 1.74, dt=dt, plant=plant)
        assert np.abs(run.q[-1] - plan.q[-1]).max() < most


@pytest.mark.parametrize("form", ["kinematic", "acceleration", "dynamic"])
def test_feedback_stays_within_the_bounds_of_its_plan(form):
    """Far beside the plan, feedback once turned the sleigh faster and farther than bounds allow."""
    side, yaw = rnc.FramePosition("sleigh", "xy"), rnc.FrameYaw("sleigh")
    reduced, goal = systems.sleigh(vertical=(side,)), {side: [1.5, 0.6], yaw: 0.3}
    bounds = [OutputBound(yaw, -0.1, 0.55), OutputBound(side, None, {"sleigh_y": 0.605}), VelocityBound(-0.9, 0.9)]
    plan = rnc.optimal.plan(reduced, reduced.robot.configuration(), goal, 3.0, form=form, bounds=bounds)
    for aside in (0.3, -0.3):
        start = reduced.robot.configuration({"root_joint": [0.0, aside, 0.0]})
        run = rnc.simulate(reduced, rnc.tvlqr(reduced, plan, 50.0, 0.1), start, 3.0, dt=0.01)
        angle = np.unwrap(np.arctan2(run.q[:, 3], run.q[:, 2]))
        assert max(angle.max() - 0.55, np.abs(run.v2).max() - 0.9) < 0.0  # a bound without a range has no reserve
        assert run.q[:, 1].max() - 0.605 < 1e-6
    assert (angle.max() > 0.54, run.q[-1, :2].tolist()) == (True, pytest.approx([1.5, 0.6], abs=0.12))


def at_rest(reduced, controller):
    """Dynamics of an error after the end of a plan under its feedback, and those without it."""
    state, u, K = controller.planned(controller.plan.duration + 9.0)
    model, h = action_model(reduced, controller.plan.info.form), np.diff(controller.plan.time)[-1:]
    step = model.step_derivatives(state, u[None], h)
    return step.x[0], step.u[0], K, h[0]


@pytest.mark.parametrize("form", ["kinematic", "acceleration", "dynamic"])
def test_an_arm_at_rest_has_its_natural_frequency_or_the_gains_of_the_algebraic_riccati_equation(form):
    """The last gains of a plan, 0.2 and 5.7, let errors fade with a time constant of 25 s."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf")
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce(map(rnc.JointPosition, robot.joint_names))
    q0 = robot.configuration({"joint_1": 0.3, "joint_2": 0.5})
    plan = rnc.optimal.plan(reduced, q0, q0 + 0.2, 3.0, form=form, limits=None)
    for frequency in (0.5, 2.0):
        A, B, K, h = at_rest(reduced, rnc.tvlqr(reduced, plan, frequency=frequency))
        np.testing.assert_allclose(np.abs(np.linalg.eigvals(A + B @ K)), np.exp(-frequency * h), rtol=3e-3)
    A, B, K, h = at_rest(reduced, rnc.tvlqr(reduced, plan, 2.0, 0.5))
    P = scipy.linalg.solve_discrete_are(A, B, 2.0 * h * np.eye(len(A)), R := 0.5 * h * np.eye(reduced.r))
    np.testing.assert_allclose(K, -np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("form", ["kinematic", "acceleration", "dynamic"])
def test_a_direction_that_no_input_moves_at_rest_keeps_its_error(form):
    """An edge cannot move aside: one eigenvalue stays one, the others decay within seconds."""
    reduced, plan = curve(form)
    A, B, K, h = at_rest(reduced, rnc.tvlqr(reduced, plan))
    rates = -np.log(np.sort(np.abs(np.linalg.eigvals(A + B @ K)))) / h
    assert rates[-1] == pytest.approx(0.0, abs=1e-6)
    assert rates[-2] > 0.3


@pytest.mark.parametrize("form", ["acceleration", "dynamic"])
def test_a_plan_states_the_error_of_the_loop_that_will_run_and_plants_with_damping_follow(form):
    """Verification once knew continuous feedback without damping: it stated 1e-12 where runs were 0.03 off."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf")
    robot.model.damping[:] = 2.0
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce(map(rnc.JointPosition, robot.joint_names))
    q0, plant = robot.configuration(), rnc.ReducedPlant(reduced, joint_damping=True)
    problem = (reduced, q0, q0 + 0.5, 1.0)
    plan = rnc.optimal.plan(*problem, form=form, limits=None, dt=0.02, plant=plant)
    controller = rnc.tvlqr(reduced, plan, joint_damping=True)
    run = rnc.simulate(reduced, controller, q0, 1.0, dt=0.02, plant=plant)
    planned = [controller.planned(t)[0] for t in run.time]
    error = max(
        np.abs([*(q - at.q[0]), *(v2 - at.w[0])]).max() for at, q, v2 in zip(planned, run.q, run.v2, strict=True)
    )
    assert plan.info.verification.feedback.deviation == pytest.approx(error, rel=1e-6)
    assert (error < 0.02, plan.info.verification.dt) == (True, 0.02)
    with pytest.raises(rnc.InfeasibleError, match=r"after a loop with samples of 0.5 s, "):
        rnc.optimal.plan(*problem, form=form, limits=None, dt=0.5, plant=plant, seeds=0)
