"""Derivatives and linearisations: against differences of the dynamics, closed forms and published numbers."""

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg

import rnc_pin as rnc
from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.analysis.differences import gradient
from systems import ALL, random_states
from textbook_systems import vertical_disk, wheeled_pendulum

DIFFERENCES = 1e-8  # eighth-order differences of the dynamics themselves, relative
STEP = 1e-3


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("moving", [True, False])
def test_derivatives_are_those_of_the_dynamics(name, moving):
    """Every kind of row, joint and actuator, at states that are no equilibria."""
    reduced = ALL[name]()
    model = reduced.robot.model
    generator = np.random.default_rng(3)
    for q, v2 in random_states(reduced, 2, seed=8):
        v2 = v2 * moving
        T = generator.normal(size=reduced.p)
        found = state_derivatives(reduced, q, v2, T)

        def close(actual, expected):
            np.testing.assert_allclose(actual, expected, rtol=0, atol=DIFFERENCES * max(1.0, np.abs(expected).max()))

        close(found.v2_dot_q, gradient(model, lambda p, v2=v2, T=T: reduced.forward_dynamics(p, v2, T), q, STEP))
        close(found.v_q, gradient(model, lambda p, v2=v2, T=T: reduced.flow(p, v2, T).v, q, STEP))
        # Accelerations are quadratic in v2 and linear in T: plain central differences have no truncation error.
        close(
            found.v2_dot_v2,
            np.stack(
                [
                    (reduced.forward_dynamics(q, v2 + e, T) - reduced.forward_dynamics(q, v2 - e, T)) / 2
                    for e in np.eye(reduced.r)
                ],
                axis=-1,
            ),
        )
        close(
            found.v2_dot_T,
            np.stack(
                [
                    reduced.forward_dynamics(q, v2, T + e) - reduced.forward_dynamics(q, v2, T)
                    for e in np.eye(reduced.p)
                ],
                axis=-1,
            ),
        )


@pytest.mark.parametrize("actuators", [("left_axle", "right_axle"), ()])
def test_pendulum_on_wheels_falls_at_the_rate_of_the_closed_form(actuators):
    """Fewer actuators than velocities, or none: the model does not ask for more."""
    reduced = wheeled_pendulum(actuators)
    found = rnc.linearize(reduced, reduced.robot.configuration(), coordinates=["pitch"])
    # Body 12 kg, 0.45 m up, 0.8 kg m^2; two wheels 1 kg, 0.005 kg m^2, 0.1 m.
    rolling, turning, coupling = 12 + 2 + 2 * 0.005 / 0.1**2, 0.8 + 12 * 0.45**2, 12 * 0.45
    pole = np.sqrt(coupling * 9.81 * rolling / (turning * rolling - coupling**2))
    np.testing.assert_allclose(found.eigenvalues, [-pole, 0, 0, pole], rtol=1e-12, atol=1e-12)
    assert found.state_names == ("pitch", "base_speed_x", "pitch_dot", "base_yaw_dot")
    assert found.input_names == actuators
    assert found.B.shape == (4, len(actuators))
    assert found.difference_error == 0.0


def test_whole_state_of_a_steady_motion_is_the_variational_equation():
    """Deviations from a circling disk, measured in axes that go along, against two nonlinear runs."""
    reduced = vertical_disk()
    model, q0, v2, size, duration = reduced.robot.model, reduced.robot.configuration(), np.array([5.0, 0.8]), 1e-5, 1.3
    found = rnc.linearize(reduced, q0, v2)
    start = np.random.default_rng(2).normal(size=found.A.shape[0])

    def end(sign):
        q = pin.integrate(model, q0, sign * size * start[: reduced.n])
        run = rnc.free_motion(reduced, q, v2 + sign * size * start[reduced.n :], duration, dt=duration)
        return run.q[-1], run.v2[-1]

    middle = rnc.free_motion(reduced, q0, v2, duration, dt=duration).q[-1]
    (q_plus, v2_plus), (q_minus, v2_minus) = end(1), end(-1)
    moved = (pin.difference(model, middle, q_plus) - pin.difference(model, middle, q_minus)) / (2 * size)
    expected = scipy.linalg.expm(found.A * duration) @ start
    np.testing.assert_allclose(np.r_[moved, (v2_plus - v2_minus) / (2 * size)], expected, atol=1e-7)


def test_deviation_is_the_state():
    reduced = wheeled_pendulum()
    q0 = reduced.robot.configuration({"root_joint": (0.3, -0.2, 3.0)})
    found = rnc.linearize(reduced, q0, coordinates=["pitch", rnc.FrameYaw("base")], rates=["pitch", "base_yaw"])
    q = reduced.robot.configuration({"root_joint": (0.3, -0.2, -3.0), "pitch": 0.1})
    turned = 2 * np.pi - 6.0  # through pi, not back around
    np.testing.assert_allclose(found.deviation(q, [7.0, 8.0, 9.0]), [0.1, turned, 8.0, 9.0], atol=1e-15)
    for own in ("_read", "_kept"):  # how it finds them
        assert own not in repr(found)


def test_inputs_that_hold_the_state_are_found():
    reduced = ALL["tiago"]()
    q, _ = random_states(reduced, 1, seed=1)[0]
    found = rnc.linearize(reduced, q)
    np.testing.assert_allclose(reduced.forward_dynamics(q, np.zeros(reduced.r), found.T), 0, atol=1e-8)
    assert found.A.shape == (reduced.n + reduced.r,) * 2
    assert found.B.shape == (reduced.n + reduced.r, reduced.p)


def test_rows_of_a_user_say_how_good_their_differences_are():
    from benchmarks.validation.ball import ball

    q = ball().robot.configuration({"root_joint": (0.3, 0, 0.2, 0, 0, 0, 1)})
    state = np.array([1.0, 2.0, 3.0])
    assert state_derivatives(ball(), q, state, np.empty(0)).difference_error == 0.0
    assert 0 < state_derivatives(ball(turntable=True), q, state, np.empty(0)).difference_error < 1e-10


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (
            lambda r, q: rnc.linearize(r, q, T=[1.0, 1.0]),
            rnc.ConstraintError,
            "not an equilibrium and not a steady motion",
        ),
        (lambda r, q: rnc.linearize(r, _tipped(r)), rnc.ConstraintError, "rate of 'pitch'"),
        (lambda r, q: rnc.linearize(r, q, coordinates=[]), rnc.ConstraintError, "also depends on 'pitch'"),
        (lambda r, q: rnc.linearize(r, q, rates=["pitch"]), rnc.ConstraintError, "also depends on 'base_speed_x'"),
        (lambda r, q: rnc.linearize(r, q, coordinates=["pich"]), rnc.ModelError, "did you mean 'pitch'"),
        (lambda r, q: rnc.linearize(r, q, rates=["base_yow"]), rnc.ModelError, "did you mean 'base_yaw'"),
        (lambda r, q: rnc.linearize(r, q, coordinates="pitch"), rnc.InputError, "have to be a list"),
        (lambda r, q: rnc.linearize(r, q, coordinates=["pitch", "pitch"]), rnc.ConstraintError, "not independent"),
        (
            lambda r, q: rnc.linearize(r, q, coordinates=[rnc.FramePosition("base", "z")], rates=[]),  # cannot move
            rnc.ConstraintError,
            "coordinates base_z are not independent under the constraints",
        ),
        (
            lambda r, q: rnc.linearize(r, q, coordinates=[rnc.FrameSpeed("base")]),
            rnc.ConstraintError,
            "quasi-velocity: it has no value",
        ),
        (
            lambda r, q: rnc.linearize(r, q, [0.5, 0, 0], coordinates=["pitch", "root_joint[0]"]),
            rnc.ConstraintError,
            r"'root_joint\[0\]' moves in this motion",
        ),
        (lambda r, q: rnc.linearize(r, q[:-1]), rnc.InputError, "q has shape"),
    ],
)
def test_what_cannot_be_linearised_is_refused(call, error, words):
    reduced = wheeled_pendulum()
    with pytest.raises(error, match=words):
        call(reduced, reduced.robot.configuration())


def _tipped(reduced):
    return reduced.robot.configuration({"pitch": 0.3})
