"""Charts and integrators: against series, closed forms and step halving."""

from math import factorial

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.model import integrators
from rnc_pin.model.integrators import ExponentialCoordinates, LieRungeKutta4, LinearPart
from rnc_pin.plants.constrained_dynamics import ConstrainedDynamics
from simple_controllers import Inputs
from systems import free_flying_panda, leaning_wheel, mobile_manipulator, space_robot_in_joints
from textbook_systems import sliders

JOINTS = {
    "planar": (pin.JointModelPlanar, slice(2, 3)),
    "spherical": (pin.JointModelSpherical, slice(0, 3)),
    "free": (pin.JointModelFreeFlyer, slice(3, 6)),
}


def one_joint(kind):
    model = pin.Model()
    add_body(model, "root_joint", JOINTS[kind][0](), 1.0, com=(0.1, 0.2, 0.3), moments=(1.0, 1.5, 2.0))
    return rnc.Robot(model)


@pytest.mark.parametrize("kind", JOINTS)
@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-4, 1e-3, 1e-2, 0.3, 0.999, 1.001, 2.5])
def test_charts_move_by_the_right_jacobian_of_the_exponential(kind, angle):
    """Against its series, sum of (-ad)^k / (k + 1)!; Pinocchio's own loses nine digits at 1e-4 rad."""
    robot = one_joint(kind)
    u, v = np.random.default_rng(1).normal(size=(2, robot.nv))
    turning = JOINTS[kind][1]
    u[turning] *= angle / np.linalg.norm(u[turning])
    ad = np.stack([bracket(kind, u, e) for e in np.eye(robot.nv)], axis=-1)
    jacobian = sum(np.linalg.matrix_power(-ad, k) / factorial(k + 1) for k in range(45))
    rate = ExponentialCoordinates(robot).rate(robot.configuration(), u, v)
    np.testing.assert_allclose(jacobian @ rate, v, atol=1e-14)


def bracket(kind, x, y):
    if kind == "spherical":
        return np.cross(x, y)
    if kind == "free":
        return pin.Motion(x).cross(pin.Motion(y)).vector
    lift = lambda z: pin.Motion(np.array([z[0], z[1], 0]), np.array([0, 0, z[2]]))  # noqa: E731
    return lift(x).cross(lift(y)).vector[[0, 1, 5]]


@pytest.mark.parametrize("z", [-0.9, 0.4])
def test_a_step_of_exponential_growth_has_the_stages_of_the_textbook(z):
    """``y' = z y / h``: of the stages follow the state, the roughness, and the way of a slider that moves with y."""
    model, h = pin.Model(), 0.2
    add_body(model, "slide", "PX", 1.0)
    rate = lambda q, y: (y[:1], np.array([z / h * y[0], 50.0]))  # noqa: E731
    q, y, rough = LieRungeKutta4(rnc.Robot(model)).measured_step(rate, np.array([0.3]), np.array([2.0, 1.0]), h, 1)
    np.testing.assert_allclose(y, [2.0 * (1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24), 1.0 + 50.0 * h], rtol=1e-14)
    np.testing.assert_allclose(q, 0.3 + h * 2.0 * (1 + z / 2 + z**2 / 6 + z**3 / 24), rtol=1e-14)
    uneven, bent = abs(z**2 / 4), abs(z**2 / 4 + z**3 / 4)  # of the slope of y; the slider's are those of y itself
    assert rough == pytest.approx(2.0 * max(abs(z), h) * max(uneven, bent), rel=1e-12)


def test_an_exponential_step_is_exact_for_damping_and_the_classical_one_without_a_linear_part():
    """The matrix exponential of the linear motion under a constant force; then the stages of Runge and Kutta."""
    robot, generator, h = sliders("XXX", chain=False), np.random.default_rng(3), 0.3
    modes, others, U = *generator.normal(size=(2, 2, 2)), generator.normal(size=(3, 2))
    inverse, decay, q = np.linalg.inv(modes), np.array([0.5, 40.0]), np.array([0.2, -0.4, 0.1])
    y = generator.normal(size=4)
    L = np.zeros((8, 8))  # of the configuration, the modes, the other states, and 1
    L[:7, 3:5], L[:7, 7] = np.vstack([U, -np.diag(decay), others]), generator.normal(size=7)

    def linear(q, y):
        z_dot = L @ [0.0, 0.0, 0.0, *inverse @ y[:2], *y[2:], 1.0]
        return z_dot[:3], np.array([*modes @ z_dot[3:5], *z_dot[5:7]])

    z = expm(h * L) @ [0.0, 0.0, 0.0, *inverse @ y[:2], *y[2:], 1.0]
    integrator, part = integrators.ExponentialRungeKutta4(robot), LinearPart(modes, inverse, decay, U, others)
    q_end, y_end, rough = integrator.step(linear, part, q, y, h)
    np.testing.assert_allclose([*q_end, *y_end], [*q + z[:3], *modes @ z[3:5], *z[5:7]], atol=1e-13)
    assert rough < 1e-12
    bent = lambda q, y: (np.sin(y[:3]) + q, np.cos(y) * y[::-1] + q[0])  # noqa: E731
    none = LinearPart(np.eye(2), np.eye(2), *(0.0 * each for each in (decay, U, others)))
    expected = LieRungeKutta4(robot).measured_step(bent, q, y, h, 2)
    for found, known in zip(integrator.step(bent, none, q, y, h), expected, strict=True):
        np.testing.assert_allclose(found, known, rtol=1e-12)


@pytest.mark.parametrize(("slope", "moved"), [
    (lambda y: y**2, lambda t: [-np.log(1 - t), 1 / (1 - t)]),
    (lambda y: -np.sign(y), lambda t: [t - t**2 / 2, 1 - t]),
])  # fmt: skip
def test_adaptive_steps_end_at_a_pole_and_where_a_sign_would_change_for_ever(slope, moved):
    """Of the state; a slider that moves with it is at its integral."""
    rate = lambda t, q, x: np.concatenate([x[1:], slope(x[1:])])  # noqa: E731
    motion = integrators.AdaptiveIntegrator(sliders("X"), rate, rtol=1e-9, atol=1e-11)
    blocks, times = [], np.array([0.0, 0.4, 0.45, 0.9, 2.0])
    with pytest.raises(rnc.DivergenceError, match="step size is too small: the motion runs into a sing") as told:
        blocks.extend(motion.run(times, np.zeros(1), np.ones(1)))
    t, q, y = (np.concatenate(each) for each in zip(*blocks, strict=True))
    np.testing.assert_array_equal(t, times[:4])
    np.testing.assert_allclose(np.hstack([q, y]).T, moved(t), rtol=1e-6, atol=1e-12)
    assert told.value.time == pytest.approx(1.0, abs=1e-6)


def test_free_motion_agrees_with_a_fixed_step_that_is_halved():
    """Under constant torques: the fixed-step integrator comes closer by 2^4 each time, to what free_motion gives."""
    reduced = mobile_manipulator()
    q0 = reduced.robot.configuration({"joint_1": 0.4, "joint_2": 1.2})
    v2, T, duration = np.array([0.3, -0.2, 0.5, 0.4]), np.array([2.0, 1.0, -0.5, 0.3]), 0.5
    exact = rnc.free_motion(reduced, q0, v2, duration, dt=duration, inputs=T)

    errors = []
    for steps in (16, 32, 64):
        run = rnc.simulate(reduced, Inputs(lambda _: T), q0, duration, duration / steps, v2_0=v2)
        gap = pin.difference(reduced.robot.model, exact.q[-1], run.q[-1])
        errors.append(np.linalg.norm(np.r_[gap, run.v2[-1] - exact.v2[-1]]))
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4.0, atol=0.25)
    assert exact.energy[-1] - exact.work[-1] == pytest.approx(exact.energy[0], abs=1e-10)


def test_samples_between_steps_are_as_good_as_steps():
    reduced = leaning_wheel()
    q0 = reduced.robot.configuration({"root_joint": (0, 0, 0.3, 0, 0, 0, 1)})
    v2 = np.array([0.3, 6.0, 0.4])
    fine = rnc.free_motion(reduced, q0, v2, 2.0, dt=0.01)
    for k in (33, 100, 157):
        alone = rnc.free_motion(reduced, q0, v2, fine.time[k], dt=fine.time[k])
        np.testing.assert_allclose(fine.q[k], alone.q[-1], atol=1e-10)
        np.testing.assert_allclose(fine.v2[k], alone.v2[-1], atol=1e-10)
    assert all(pin.isNormalized(reduced.robot.model, q, 1e-12) for q in fine.q)
    assert fine.meta["outcome"] == "completed"


def test_feedback_and_damping_act():
    reduced = space_robot_in_joints()
    q0 = reduced.robot.configuration({"joint_2": 1.0})
    v2 = np.array([0.5, -0.5, 0.5])
    braked = rnc.free_motion(reduced, q0, v2, 3.0, inputs=lambda t, q, v2: -20 * v2)
    assert braked.energy[-1] < 0.2 * braked.energy[0]
    np.testing.assert_allclose(braked.T, -20 * braked.v2, atol=1e-12)
    np.testing.assert_allclose(braked.energy - braked.work, braked.energy[0], atol=1e-10)
    damped = rnc.free_motion(rnc.ReducedPlant(reduced, joint_damping=True), q0, v2, 3.0)
    assert (np.diff(damped.energy) < 0).all()


@pytest.mark.parametrize(("arguments", "words"), [
    ({"duration": 0.0}, "have to be positive"),
    ({"dt": 2.0}, "have to be positive"),
    ({"tolerance": (1e-9, 0.0)}, "have to be positive"),
    ({"duration": np.inf}, "have to be positive"),
    ({"options": rnc.SimulationOptions(loop={"brake": 1.0})}, "takes stop and meta only"),
    ({"options": rnc.SimulationOptions(observer=print)}, "takes stop and meta only"),
    ({"options": rnc.SimulationOptions(controller_state=1.0)}, "takes stop and meta only"),
    ({"inputs": np.zeros(2)}, "T has shape"),
    ({"v2": np.zeros(2)}, "v2 has shape"),
])  # fmt: skip
def test_arguments_of_a_free_motion_that_make_no_sense_are_refused(arguments, words):
    given = {"q0": np.zeros(4), "v2": np.zeros(3), "duration": 1.0, **arguments}
    q0, v2, duration = (given.pop(name) for name in ("q0", "v2", "duration"))
    with pytest.raises(rnc.RncError, match=words):
        rnc.free_motion(space_robot_in_joints(), q0, v2, duration, **given)


@pytest.mark.parametrize("make", [mobile_manipulator, free_flying_panda])
def test_rates_in_local_coordinates_are_those_of_the_exponential(make):
    """One call of the kernel gives what the chart gives of the rates at the displaced configuration."""
    reduced = make()
    robot, generator = reduced.robot, np.random.default_rng(4)
    q = robot.random_configuration(generator)
    dynamics = ConstrainedDynamics(reduced, joint_damping=bool(robot.model.damping.any()))
    T = generator.normal(size=reduced.p)
    y = dynamics.initial(q, reduced.at(q, np.zeros(reduced.r)).v)
    y[: reduced.r] = generator.normal(size=reduced.r)
    x = np.concatenate([0.05 * generator.normal(size=robot.nv), y])
    expected = ExponentialCoordinates(robot).derivative(dynamics.derivative(T), q, x[: robot.nv], x[robot.nv :])
    np.testing.assert_allclose(dynamics.local_rate(q, x, T), np.concatenate(expected), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("x", [-1e-9, -1e-3, -0.999, -1.001, -30.0, -1e12])
def test_phi_functions_are_the_integrals_that_define_them(x):
    """``phi_k(x)`` is the integral of ``exp((1 - s) x) s^(k-1) / (k-1)!`` over s from 0 to 1; ``phi_0`` is exp."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    s, values = (nodes + 1) / 2, integrators.phi_functions(np.array([x]), 4)
    assert values[0][0] == pytest.approx(np.exp(x), rel=1e-14)
    for k in range(1, 5):
        if x > -100:
            expected = (weights / 2) @ (np.exp((1 - s) * x) * s ** (k - 1)) / factorial(k - 1)
        else:
            expected = -1.0 / (x * factorial(k - 1))
        assert values[k][0] == pytest.approx(expected, rel=1e-11)
