"""Limits of the regulator from both sides: what fades by itself, what is reached, what costs something."""

import numpy as np
import pytest

import rnc_pin as rnc
from textbook_systems import linear

NOT_REACHED = "the actuators u0 do not control a mode that is not stable: it moves "
COSTS_NOTHING = "state_cost: a mode that is not stable has zero cost: it moves "


def told(system, *costs):
    with pytest.raises(rnc.ConstraintError) as raised:
        rnc.lqr(system, *costs)
    return str(raised.value)


@pytest.mark.parametrize("fast", [0.3, 3.0])
def test_what_fades_by_itself_need_not_be_reached(fast):
    """Faster than a hundred thousandth of the largest entry of A, or of one a second."""
    limit = 1e-5 * max(1.0, fast)
    B = [[0.0], [1.0]]
    assert told(linear(np.diag([-0.97 * limit, -fast]), B), 1.0) == NOT_REACHED + "x0"
    K = rnc.lqr(linear(np.diag([-1.03 * limit, -fast]), B), 1.0)
    np.testing.assert_allclose(K, [[0.0, np.sqrt(fast**2 + 1.0) - fast]], atol=1e-9)


@pytest.mark.parametrize("fast", [0.3, 3.0])
def test_what_grows_slowly_has_to_cost_something(fast):
    """What grows faster is stopped at any cost."""
    limit = 1e-5 * max(1.0, fast)
    B = np.eye(2)
    message = told(linear(np.diag([0.97 * limit, -fast]), B), [0.0, 1.0])
    assert message == COSTS_NOTHING + "x0"
    K = rnc.lqr(linear(np.diag([1.03 * limit, -fast]), B), [0.0, 1.0])
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
    assert told(linear(np.zeros((2, 2)), np.eye(2)), np.array([[part**2, -part], [-part, 1.0]])).endswith(
        f"it moves {names}"
    )


@pytest.mark.parametrize("unit", [1.0, 1e-14])
def test_a_weight_is_negative_beyond_rounding(unit):
    """A part in ten to the twelve of the largest entry."""
    system = linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]])
    with pytest.raises(rnc.ConfigurationError) as raised:
        rnc.lqr(system, unit * np.array([3.0, -1.03 * 3e-12]), unit)
    assert str(raised.value) == "state_cost: no weight may be negative"
    K = rnc.lqr(system, unit * np.array([3.0, -0.97 * 3e-12]), unit)
    np.testing.assert_allclose(K, [[np.sqrt(3.0), np.sqrt(2 * np.sqrt(3.0))]], rtol=1e-6)


@pytest.mark.parametrize("cost", ["heavy", ["a", "b"], [[1.0], [1.0, 2.0]]])
def test_costs_are_numbers(cost):
    with pytest.raises(rnc.ConfigurationError) as raised:
        rnc.lqr(linear(np.zeros((2, 2)), np.eye(2)), cost)
    assert str(raised.value) == f"state_cost: expected numbers, found {cost!r}"


def test_nothing_feeds_back_to_no_actuators():
    assert told(linear([[1.0]], np.zeros((1, 0))), 1.0) == "a regulator needs at least one actuator, found none"


def test_inputs_of_unlike_weights_share_a_state_in_proportion_to_what_they_do_for_it():
    """``x' = a x + b1 u1 + b2 u2``: gains are ``b_i p / r_i``, with ``2 a p - p^2 (b1^2 / r1 + b2^2 / r2) + q = 0``."""
    a, b, r, q = 0.3, np.array([2.0, -0.7]), np.array([5.0, 0.04]), 1.7
    s = np.sum(b**2 / r)
    p = (a + np.sqrt(a**2 + q * s)) / s
    expected = b * p / r
    np.testing.assert_allclose(rnc.lqr(linear([[a]], [b]), q, {"u0": r[0], "u1": r[1]})[:, 0], expected, rtol=1e-10)


@pytest.mark.parametrize("slowly", [3e-6, -3e-6, 0.0])
@pytest.mark.parametrize("size", [1.0, 40.0])
def test_what_hardly_grows_or_fades_is_named_all_the_same(slowly, size):
    system = linear(size * np.diag([slowly, -1.0]), size * np.array([[0.0], [1.0]]))
    assert told(system, 1.0) == NOT_REACHED + "x0"
    assert told(linear(system.A, np.eye(2)), [0.0, 1.0]) == COSTS_NOTHING + "x0"
