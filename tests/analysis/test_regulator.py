"""Regulators, linear models and combinations of rows of systems written down, beside closed forms."""

import numpy as np
import pytest
import scipy.linalg

import rnc_pin as rnc
from refusals import refused
from textbook_systems import linear


@pytest.mark.parametrize("a", [-0.7, 0.0, 1.3])
def test_the_gain_of_one_state_is_that_of_the_closed_form(a):
    b, q, r = 0.8, 3.0, 0.5
    expected = (a + np.sqrt(a**2 + b**2 * q / r)) / b
    for state_cost in (q, [q], {"x0": q}, [[q]]):
        for input_cost in (r, [r], {"u0": r}, [[r]]):
            np.testing.assert_allclose(rnc.lqr(linear([[a]], [[b]]), state_cost, input_cost), [[expected]])


def test_a_gain_for_inputs_that_cost_together_is_the_least(generator):
    """No other gain costs less: the cost of a start x is ``x^T P x``, by the equation of Lyapunov."""
    system = linear(generator.normal(size=(3, 3)), generator.normal(size=(3, 2)))
    Q, R = np.diag([1.0, 0.0, 2.0]), np.array([[2.0, 0.7], [0.7, 0.5]])
    K = rnc.lqr(system, {"x0": 1.0, "x2": 2.0}, R)

    def cost(gain):
        closed = system.A - system.B @ gain
        assert np.linalg.eigvals(closed).real.max() < 0
        return np.trace(scipy.linalg.solve_continuous_lyapunov(closed.T, -(Q + gain.T @ R @ gain)))

    for i in np.ndindex(K.shape):
        step = np.zeros(K.shape)
        step[i] = 1e-4
        assert abs(cost(K + step) - cost(K - step)) / 2e-4 < 1e-6 * cost(K)
        assert cost(K) < min(cost(K + step), cost(K - step))


def test_what_grows_and_costs_nothing_is_mirrored():
    """The cheapest way to stop it: from a rate of 1.5 to one of -1.5. What fades by itself is left alone."""
    np.testing.assert_allclose(rnc.lqr(linear([[1.5]], [[0.5]]), 0.0), [[6.0]])
    K = rnc.lqr(linear(np.diag([-1.0, 1.5]), [[0.0], [0.5]]), {"x1": 0.0})
    np.testing.assert_allclose(K, [[0.0, 6.0]], atol=1e-9)


def test_sampled_gains_are_stable_as_long_as_a_sample_takes_less_than_twice_the_error():
    """``x' = 2 u`` with ``u = -4 x`` over a sample: ``x`` becomes ``(1 - 8 dt) x``."""
    rnc.analysis.check_sampling(linear([[0.0]], [[2.0]]), np.array([[4.0]]), 0.249)
    with pytest.raises(rnc.InfeasibleError, match=r"eigenvalue is 8/s and the sampling period 0\.251 s"):
        rnc.analysis.check_sampling(linear([[0.0]], [[2.0]]), np.array([[4.0]]), 0.251)


NOT_REACHED = "the actuators u0 do not control a mode that is not stable: it moves "
REMEDY = "; leave out what rows hold (coordinates= and rates= of linearize), or add actuators"
COSTS_NOTHING = "state_cost: a mode that is not stable has zero cost: it moves "


def told(system, *costs):
    with pytest.raises(rnc.ConstraintError) as raised:
        rnc.lqr(system, *costs)
    assert str(raised.value).endswith(REMEDY) == str(raised.value).startswith(NOT_REACHED)
    return str(raised.value).removesuffix(REMEDY)


OSCILLATOR = [[0.3, 2.7, 0.0, 0.0], [-1.9, -0.3, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 0.0]]


@pytest.mark.parametrize(("A", "B", "cost", "words"), [
    (OSCILLATOR, [[0], [0], [0], [1]], 1.0, NOT_REACHED + "x0, x1"),
    (OSCILLATOR, [[1], [0], [0], [0]], 1.0, NOT_REACHED + "x3"),
    (OSCILLATOR, [[1, 0], [0, 0], [0, 0], [0, 1]], {"x2": 1.0, "x3": 2.0}, COSTS_NOTHING + "x0, x1"),
    (OSCILLATOR, [[1, 0], [0, 0], [0, 0], [0, 1]], {"x0": 1.0}, COSTS_NOTHING + "x3"),
    (np.diag([0.5, 0.2]), [[1.0], [0.0]], 1.0, NOT_REACHED + "x1"),
])  # fmt: skip
@pytest.mark.parametrize("rate", [1.0, 1e5])
def test_modes_that_cannot_be_held_are_named(A, B, cost, words, rate):
    assert told(linear(rate * np.array(A), rate * np.array(B)), cost) == words


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e4])
def test_a_double_integrator_in_other_units_of_time_is_regulated(size):
    K = rnc.lqr(linear([[0.0, size], [0.0, 0.0]], [[0.0], [size]]), 1.0)
    np.testing.assert_allclose(K, [[1.0, np.sqrt(3.0)]], rtol=1e-7)


test_costs_that_are_none_are_refused = refused([
    (([[1.0, 2.0], [2.0, 1.0]], 1.0), "state_cost: no weight may be negative"),
    (([[1.0, 0.5], [0.0, 1.0]], 1.0), "or a symmetric matrix, found"),
    (([1.0, np.nan], 1.0), "or a symmetric matrix, found"),
    (([[1.0, 2.0]], 1.0), "or a symmetric matrix, found"),
    (("heavy", 1.0), "state_cost: expected numbers, found 'heavy'"),
    (([[1.0], [1.0, 2.0]], 1.0), "state_cost: expected numbers, found"),
    (([1.0], 1.0), "state_cost: expected a number, one for each of x0, x1, or a symmetric matrix, found"),
    ((1.0, [1.0, 1.0]), "input_cost: expected a number, one for each of u0, or a symmetric matrix, found"),
    ((1.0, 0.0), "input_cost: every input needs a positive weight"),
    ((1.0, {"u": 1.0}), "input_cost: no 'u'; did you mean 'u0'"),
], lambda costs: rnc.lqr(linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]]), *costs), rnc.ConfigurationError)  # fmt: skip


def test_default_coordinates_leave_out_what_rows_hold(robot):
    """A welded joint, and two joints that move by equal amounts: what is left is regulated."""
    rows = [rnc.FixedOutput(rnc.JointPosition("joint_3"), 0.4), rnc.JointCoupling("joint_1", "joint_2", 1.0, 0.0)]
    reduced = rnc.NonholonomicSystem(robot, rows, robot.joint_names).reduce()
    system = rnc.linearize(reduced, robot.configuration({"joint_3": 0.4}))
    assert len(system.state_names) == 4
    assert not any("joint_3" in name for name in system.state_names)
    assert np.linalg.eigvals(system.A - system.B @ rnc.lqr(system, 1.0)).real.max() < 0
