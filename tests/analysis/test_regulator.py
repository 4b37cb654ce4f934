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


def test_a_gain_for_inputs_that_cost_together_is_the_least():
    """No other gain costs less: the cost of a start x is ``x^T P x``, by the equation of Lyapunov."""
    generator = np.random.default_rng(0)
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


@pytest.mark.parametrize("fast", [0.3, 3.0])
def test_what_fades_need_not_be_reached_and_what_grows_slowly_has_to_cost_something(fast):
    limit = 1e-5 * max(1.0, fast)
    B, identity = [[0.0], [1.0]], np.eye(2)
    assert told(linear(np.diag([-0.97 * limit, -fast]), B), 1.0) == NOT_REACHED + "x0"
    K = rnc.lqr(linear(np.diag([-1.03 * limit, -fast]), B), 1.0)
    np.testing.assert_allclose(K, [[0.0, np.sqrt(fast**2 + 1.0) - fast]], atol=1e-9)
    assert told(linear(np.diag([0.97 * limit, -fast]), identity), [0.0, 1.0]) == COSTS_NOTHING + "x0"
    K = rnc.lqr(linear(np.diag([1.03 * limit, -fast]), identity), [0.0, 1.0])
    np.testing.assert_allclose(K[0], [2 * 1.03 * limit, 0.0], rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize(("size", "unit"), [(1.0, 1.0), (1.0, 1e5), (40.0, 1.0)])
def test_inputs_reach_a_mode_to_a_part_in_a_million(size, unit):
    """``x0' = b u``, ``x1' = size (-x1 + u)``: of ``[[0, b], [-1, 1]]`` the singular values have the product b."""

    def system(b):
        return linear(size * np.diag([0.0, -1.0]), unit * np.array([[b], [1.0]]))

    limit = np.sqrt(2) * 1e-6
    assert told(system(0.97 * limit), 1.0) == NOT_REACHED + "x0"
    K = rnc.lqr(system(1.03 * limit), 1.0, unit**2)
    assert np.linalg.eigvals(system(1.03 * limit).A - system(1.03 * limit).B @ K).real.max() < 0


@pytest.mark.parametrize("unit", [1.0, 1e-4, 1e6])
def test_a_mode_costs_nothing_below_a_part_in_a_million(unit):
    system = linear(np.diag([0.0, -1.0]), np.eye(2))
    assert told(system, unit * np.diag([0.97e-6, 1.0]), unit) == COSTS_NOTHING + "x0"
    K = rnc.lqr(system, unit * np.diag([1.03e-6, 1.0]), unit)
    np.testing.assert_allclose(K, np.diag([np.sqrt(1.03e-6), np.sqrt(2.0) - 1.0]), rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize(("part", "names"), [(0.097, "x0"), (0.103, "x0, x1")])
def test_states_that_a_mode_hardly_moves_are_not_named(part, names):
    assert told(linear(np.zeros((2, 2)), [[part], [-1.0]]), 1.0) == NOT_REACHED + names
    cost = np.array([[part**2, -part], [-part, 1.0]])
    assert told(linear(np.zeros((2, 2)), np.eye(2)), cost) == COSTS_NOTHING + names


@pytest.mark.parametrize("unit", [1.0, 1e-14])
def test_a_weight_is_negative_beyond_rounding(unit):
    system = linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]])
    with pytest.raises(rnc.ConfigurationError, match="state_cost: no weight may be negative"):
        rnc.lqr(system, unit * np.array([3.0, -1.03 * 3e-12]), unit)
    K = rnc.lqr(system, unit * np.array([3.0, -0.97 * 3e-12]), unit)
    np.testing.assert_allclose(K, [[np.sqrt(3.0), np.sqrt(2 * np.sqrt(3.0))]], rtol=1e-6)


def test_default_coordinates_leave_out_what_rows_hold():
    """A welded joint, and two joints that move by equal amounts: what is left is regulated."""
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    rows = [rnc.FixedOutput(rnc.JointPosition("joint_3"), 0.4), rnc.JointCoupling("joint_1", "joint_2", 1.0, 0.0)]
    reduced = rnc.NonholonomicSystem(robot, rows, robot.joint_names).reduce()
    system = rnc.linearize(reduced, robot.configuration({"joint_3": 0.4}))
    assert len(system.state_names) == 4
    assert not any("joint_3" in name for name in system.state_names)
    assert np.linalg.eigvals(system.A - system.B @ rnc.lqr(system, 1.0)).real.max() < 0
