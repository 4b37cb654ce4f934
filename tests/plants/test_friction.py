"""Damping of any size and dry friction with stiction: against closed forms and finely integrated smooth laws."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.plants import ReducedPlant
from rnc_pin.plants.friction import INSTANT, _least_energy
from simple_controllers import Inputs
from systems import arm_on_base, floating_robot

MASS = 2.0
DAMPED, RUBBED = {"joint_damping": True}, {"joint_friction": True}
BOTH = {**DAMPED, **RUBBED}


def slider(damping=0.0, friction=0.0):
    model = pin.Model()
    add_body(model, "slide", "PX", MASS)
    model.damping, model.upperDryFrictionLimit = np.array([damping]), np.array([friction])
    return rnc.NonholonomicSystem(rnc.Robot(model), [], ["slide"]).reduce()


def run_slider(reduced, push, effects, dt, v=0.0, duration=2.0):
    plant = ReducedPlant(reduced, **effects)
    return rnc.simulate(reduced, Inputs(lambda t: [push(t)]), np.zeros(1), duration, dt, v2_0=[v], plant=plant)


@pytest.mark.parametrize("damping", [0.5, 40.0, 1e5, 1e9])
def test_damping_of_any_size_gives_the_closed_form(damping):
    """Of rates up to 5e8 / s at a step of 0.1 s: decay, steady speed, distance and energy."""
    run = run_slider(slider(damping), lambda t: 3.0, DAMPED, 0.1, v=1.0)
    t, steady, rate = run.time, 3.0 / damping, damping / MASS
    np.testing.assert_allclose(run.v[:, 0], steady + (1.0 - steady) * np.exp(-rate * t), atol=1e-13)
    gone = steady * t - (1.0 - steady) * np.expm1(-rate * t) / rate
    np.testing.assert_allclose(run.q[:, 0], gone, atol=1e-13)
    np.testing.assert_allclose(run.energy - run.work, run.energy[0], atol=1e-7)


def manipulator(damping=0.0, friction=0.0):
    """Model whose joints have losses, a damping for both or one each, and a bent configuration."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    robot.model.damping = np.r_[np.zeros(3), damping * np.ones(2)]
    robot.model.upperDryFrictionLimit = np.r_[np.zeros(3), friction * np.ones(2)]
    kinds = [rnc.FrameSpeed("base"), rnc.FrameYaw("base"), rnc.JointPosition("joint_1"), rnc.JointPosition("joint_2")]
    return arm_on_base(robot).reduce(kinds), robot.configuration({"joint_1": 0.4, "joint_2": 1.2})


V2, PUSH = np.array([0.5, 0.4, 0.5, -0.6]), np.array([2.0, 1.0, -0.5, 0.3])


def test_moderate_damping_keeps_the_order_four():
    """Beside an adaptive method of order eight."""
    (reduced, q0), errors = manipulator(np.array([3.0, 2.0])), []
    exact = rnc.free_motion(ReducedPlant(reduced, **DAMPED), q0, V2, 0.5, 0.5, PUSH)
    for count in (16, 32, 64):
        plant = ReducedPlant(reduced, **DAMPED)
        run = rnc.simulate(reduced, Inputs(lambda t: PUSH), q0, 0.5, 0.5 / count, v2_0=V2, plant=plant)
        gap = pin.difference(reduced.robot.model, exact.q[-1], run.q[-1])
        errors.append(np.linalg.norm(np.r_[gap, run.v2[-1] - exact.v2[-1]]))
    np.testing.assert_allclose(np.diff(np.log2(errors)), -4.0, atol=0.35)
    np.testing.assert_allclose(run.energy - run.work, run.energy[0], atol=1e-6)


@pytest.mark.parametrize("dt", [0.5, 0.1, 0.02, 0.003])
def test_a_mass_slides_to_rest_and_stays_there(dt):
    """It stops after v m / mu at v^2 m / 2 mu, in the middle of a step."""
    run = run_slider(slider(friction=4.0), lambda t: 0.0, RUBBED, dt, v=1.3, duration=60 * dt if dt < 0.1 else 3.0)
    t = np.minimum(run.time, 1.3 * MASS / 4.0)
    np.testing.assert_allclose(run.q[:, 0], 1.3 * t - 4.0 / MASS * t**2 / 2, atol=1e-13)
    assert (np.abs(run.v[run.time > 0.65]) == 0).all()
    np.testing.assert_allclose(run.energy - run.work, run.energy[0], atol=1e-13)


def test_friction_holds_what_is_below_it_and_lets_go_above():
    """Held for a second by 3.9 N, pulled by 6, then pushed back by 8 through a stop at which it does not stick."""
    push = lambda t: 3.9 if t < 0.99 else 6.0 if t < 1.99 else -8.0  # noqa: E731
    run = run_slider(slider(friction=4.0), push, RUBBED, 0.2, duration=4.0)
    assert not run.q[:6].any()
    assert run.q[10, 0] == pytest.approx(0.5, abs=1e-13)
    back = 2.0 - 1.0 / 6.0  # it stops 1/6 s later, and goes back with -8 + 4
    assert run.q[-1, 0] == pytest.approx(0.5 + 1.0 / 12.0 - back**2, abs=1e-12)
    assert run.v[-1, 0] == pytest.approx(-2.0 * back, abs=1e-12)


@pytest.mark.parametrize("dt", [1.0, 0.1])
def test_damping_and_friction_together(dt):
    """``m vdot = -d v - mu`` stops after ``m/d log(1 + d v / mu)``."""
    reduced, rate = slider(damping=30.0, friction=4.0), 30.0 / MASS
    run = run_slider(reduced, lambda t: 0.0, BOTH, dt, v=2.0)
    t = np.minimum(run.time, np.log1p(30.0 * 2.0 / 4.0) / rate)
    expected = -(2.0 + 4.0 / 30.0) * np.expm1(-rate * t) / rate - 4.0 / 30.0 * t
    np.testing.assert_allclose(run.q[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(run.energy - run.work, run.energy[0], atol=1e-12)


def differential_drive(damping=0.0, friction=0.0):
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    robot.model.damping = np.array([0.0, 0.0, 0.0, damping, damping])
    robot.model.upperDryFrictionLimit = np.array([0.0, 0.0, 0.0, friction, friction])
    wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
    return rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"]).reduce()


@pytest.mark.parametrize("dt", [0.02, 0.3])
def test_wheels_that_friction_stops_do_not_creep_or_swing(dt):
    reduced = differential_drive(friction=0.6)
    plant = ReducedPlant(reduced, **RUBBED)
    plant.reset(reduced.robot.configuration(), reduced.at(reduced.robot.configuration(), [3.0, -1.0]).v)
    for _ in range(round(3.0 / dt)):
        plant.apply(np.array([0.2, -0.29]))
        plant.advance(dt)
    q, v = plant.read()
    assert np.abs(v).max() < 1e-14
    for _ in range(20):
        plant.advance(dt)
    np.testing.assert_allclose(plant.read()[0], q, atol=1e-14)


def test_friction_agrees_with_a_steep_smooth_law_that_is_integrated_finely():
    limit, duration, width = 0.4, 1.5, 1e-5
    reduced, q0 = manipulator(friction=limit)
    push = lambda t: np.array([1.5 * np.cos(4 * t), 0.3, -0.9 * np.sin(3 * t), 0.35])  # noqa: E731
    dt, plant = 0.01, ReducedPlant(reduced, **RUBBED)
    plant.reset(q0, reduced.at(q0, V2).v)
    balance = plant.state.energy
    for k in range(round(duration / dt)):
        plant.apply(push(k * dt))
        plant.advance(dt)

    def rate(t, y, T):
        q = pin.integrate(reduced.robot.model, q0, y[:5])
        state = reduced.at(q, y[5:])
        rubbing = np.r_[0.0, 0.0, -limit * np.tanh(state.v[3:] / width)]  # the last inputs drive the joints
        slope = pin.dDifference(reduced.robot.model, q0, q, pin.ArgumentPosition.ARG1) @ state.v
        return np.concatenate([slope, state.v2_dot(T + rubbing)])

    y = np.concatenate([np.zeros(5), V2])
    for k in range(round(duration / dt)):
        y = solve_ivp(rate, (0, dt), y, "LSODA", args=(push(k * dt),), rtol=1e-8, atol=1e-9).y[:, -1]
    np.testing.assert_allclose(plant.read()[0], pin.integrate(reduced.robot.model, q0, y[:5]), atol=2e-3)
    np.testing.assert_allclose(plant.state.v2, y[5:], atol=5e-3)
    assert plant.state.energy - plant.work == pytest.approx(balance, abs=1e-6)


@pytest.mark.parametrize(("effects", "name"), [(RUBBED, "friction"), (DAMPED, "damping")])
def test_losses_of_a_conserved_momentum_are_refused(effects, name):
    reduced = floating_robot().reduce()
    robot = reduced.robot
    robot.model.upperDryFrictionLimit = robot.model.damping = np.ones(4)
    inputs, q0 = Inputs(lambda t: np.zeros(3)), robot.configuration()
    with pytest.raises(rnc.ConstraintError, match=f"joint {name} acts on momentum"):
        rnc.simulate(reduced, inputs, q0, 0.1, plant=ReducedPlant(reduced, **effects))


def test_contact_forces_count_damping_and_friction():
    """At constant speed nothing is left for the ground: the drives give what the axles take."""
    reduced = differential_drive(damping=0.48)
    q0, v2 = reduced.robot.configuration(), np.array([2.0, 2.0])
    plant = ReducedPlant(reduced, **DAMPED)
    run = rnc.simulate(reduced, Inputs(lambda t: 0.48 * v2), q0, 0.2, 0.02, v2_0=v2, plant=plant)
    np.testing.assert_allclose(run.v2, 2.0, atol=1e-12)
    np.testing.assert_allclose(run.contact_forces, 0.0, atol=1e-10)
    np.testing.assert_allclose(run.multipliers, 0.0, atol=1e-10)


def test_forces_of_least_energy_are_those_of_a_bounded_least_squares_program(generator):
    for r, k in [(1, 1), (3, 2), (4, 4), (2, 5), (6, 3)] * 8:
        basis, limits = generator.standard_normal((r, k)), generator.uniform(0.1, 2.0, k)
        free = basis.T @ generator.standard_normal(r) * generator.choice([0.1, 1.0, 10.0])
        forces, sticks = _least_energy(basis, free, limits)
        target = np.linalg.lstsq(basis.T, free, rcond=None)[0]
        expected = lsq_linear(basis, -target, bounds=(-limits, limits), method="bvls", tol=1e-14).x
        assert np.abs(basis @ (forces - expected)).max() < 1e-9
        assert (np.abs(forces) <= limits * (1.0 + 1e-12)).all()
        assert not (sticks & (np.abs(forces) > limits * (1.0 + 1e-12))).any()
    still, sticking = _least_energy(np.zeros((1, 2)), np.array([1.0, -2.0]), np.array([3.0, 4.0]))  # driven joints
    assert (still.tolist(), sticking.any()) == ([-3.0, 4.0], False)


@pytest.mark.parametrize("effects", [(0.0, 0.3), (3.0, 0.0), (2e3, 0.3)])
def test_the_kernel_takes_the_steps_of_numpy(effects):
    """States from fast to nearly at rest, with stops within the step; rows that say the same are left to NumPy."""
    damping, joints = effects
    reduced, q0 = manipulator(*effects)
    plant = ReducedPlant(reduced, joint_damping=damping > 0.0, joint_friction=joints > 0.0)
    step, generator = plant._dissipative, np.random.default_rng(2)
    compared, stopped = 0, 0
    for _ in range(20):
        v = reduced.at(q0, 10.0 ** generator.uniform(-3.0, 0.3) * generator.standard_normal(reduced.r)).v
        T = 10.0 ** generator.uniform(-2.0, 1.0) * generator.standard_normal(reduced.p)
        plant.reset(q0, v)
        found = step.compiled(plant._q, plant._y, T, 0.02, 1, np.empty_like(plant._y))
        if found is None:
            continue
        (q, y, roughness), compared = found, compared + 1
        by_numpy = step._step(plant._q, plant._y, T, 0.02)
        np.testing.assert_allclose(q, by_numpy[0], rtol=0, atol=1e-11)
        np.testing.assert_allclose(y, by_numpy[1], rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(roughness, by_numpy[2], rtol=1e-6, atol=1e-9)
        stopped += np.isinf(roughness)
        _, found, _ = step.compiled(plant._q, plant._y, T, INSTANT, 0, np.empty(reduced.n))
        state = plant.dynamics.at(plant._q, plant._y)
        linear, w_dot = step._linear(state, T)
        if len(step.friction.limits):
            forces = step.friction.forces_in_step(state, w_dot, linear, INSTANT).forces
            np.testing.assert_allclose(found, forces @ step.friction.rows, rtol=1e-9, atol=1e-9)
    if reduced.evaluator.kernel:
        assert compared > 19
        assert stopped or not joints
