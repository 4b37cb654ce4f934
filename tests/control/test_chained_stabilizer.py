"""Stabilisation of chained systems: convergence, rates and limits."""

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import chain_rate
from rnc_pin.control import (
    ChainedStabilizer,
)
from tolerances import FINITE_DIFFERENCE


@pytest.mark.parametrize("max_input", [0.5, 1e9])
def test_a_long_chain_and_the_rate_of_its_command(max_input):
    stabilizer, h = ChainedStabilizer(5, 0.6, 1.4, max_input), 1e-6
    for x, u in zip(*np.random.default_rng(2).uniform(-1, 1, (2, 6, 5)), strict=True):
        x[0] = np.sign(x[0]) * (0.5 + abs(x[0]))
        np.testing.assert_allclose(stabilizer.coordinates(x), [x[i] / x[0] ** (i - 1) for i in range(1, 5)])
        law = np.array([-0.6 * x[0], -stabilizer.P @ stabilizer.coordinates(x)])
        command = stabilizer.command(x)
        np.testing.assert_allclose(command, law / max(1.0, np.hypot(*law) / max_input), rtol=1e-12)
        ahead, behind = (stabilizer.command(x + sign * h * chain_rate(x, u[:2])) for sign in (1, -1))
        rate = (ahead - behind) / (2 * h)
        np.testing.assert_allclose(
            stabilizer.command_rate(x, u[:2]), rate, atol=FINITE_DIFFERENCE * (1 + np.abs(rate).max())
        )


@pytest.mark.parametrize("over", [0.999, 1.001, 1.7])
def test_a_chain_at_its_limit_moves_along_its_law_alone(over):
    """From just beyond the limit on its command has that length, and a rate across itself."""
    free, x, u, h = ChainedStabilizer(4), np.array([0.8, -0.3, 0.5, 0.2]), np.array([-0.7, 0.4]), 1e-6
    limit = np.linalg.norm(free.command(x)) / over
    held = ChainedStabilizer(4, max_input=limit)
    command, rate = held.command(x), held.command_rate(x, u)
    assert np.linalg.norm(command) == pytest.approx(min(over, 1.0) * limit)
    ahead, behind = (held.command(x + sign * h * chain_rate(x, u)) for sign in (1, -1))
    np.testing.assert_allclose(rate, (ahead - behind) / (2 * h), atol=1e-6)
    assert (abs(command @ rate) < 1e-9) == (over > 1)


def test_a_chain_says_where_it_has_no_law_and_which_rates_make_no_sense():
    for x, said in (([0.0, 2.0, 3.0], "0"), ([1e-320, 2.0, 3.0], "9.99989e-321")):
        with pytest.raises(rnc.InputError) as caught:
            ChainedStabilizer(3).command(np.array(x))
        assert str(caught.value) == f"a chained state with x1 = {said} is outside the domain of its stabiliser: x1 = 0"
    for n, k, rate in ((2, 0.5, 1.5), (3, -0.5, 1.5), (3, 0.0, 1.5), (3, 1.5, 1.5), (4, 0.5, float("nan"))):
        with pytest.raises(rnc.ConfigurationError) as caught:
            ChainedStabilizer(n, k, rate)
        words = f"a chained stabiliser needs n >= 3 and 0 < k < rate, found {n}, {k:g}, {rate:g}"
        assert str(caught.value) == words
    for max_input in (0.0, -1.0, float("nan")):
        with pytest.raises(rnc.ConfigurationError, match="needs a positive largest input, found"):
            ChainedStabilizer(3, max_input=max_input)
    assert ChainedStabilizer(3, max_input=1e-9).command(np.array([1.0, 0.0, 0.0])).tolist() == [-1e-9, 0.0]


@pytest.mark.parametrize("n", [3, 4, 5])
def test_chained_systems_converge_exponentially_from_anywhere(n):
    """Astolfi 1996, on the chain itself: every coordinate below 1e-3 of where it began, and inputs stay bounded."""
    stabilizer = ChainedStabilizer(n, k=0.5, rate=1.5)
    generator = np.random.default_rng(n)
    for _ in range(3):
        x = generator.uniform(-1, 1, n)
        x[0] = np.sign(x[0]) * max(abs(x[0]), 0.5)
        start, h, largest = np.abs(x).max(), 5e-3, 0.0
        # A linear system whose poles are close together overshoots; by how much depends on the gains alone.
        bound = 10 * np.linalg.norm(stabilizer.P) * np.linalg.norm(stabilizer.coordinates(x))
        for _ in range(round(16.0 / h)):
            u = stabilizer.command(x)
            largest = max(largest, np.abs(u).max())
            middle = x + h / 2 * chain_rate(x, u)
            x = x + h * chain_rate(middle, stabilizer.command(middle))
        assert np.abs(x).max() < 1e-3 * start
        assert largest < bound


def test_poles_are_where_they_were_asked_for():
    """z is linear: under u1 = -k x1 it moves by a matrix whose eigenvalues are the poles."""
    stabilizer = ChainedStabilizer(4, k=0.5, rate=2.0)
    columns, h = [], 1e-6
    for z in np.eye(3):
        x = np.concatenate([[1.0], z])
        moved = x + h * chain_rate(x, stabilizer.command(x))
        columns.append((stabilizer.coordinates(moved) - z) / h)
    poles = np.sort(np.linalg.eigvals(np.column_stack(columns)).real)
    np.testing.assert_allclose(poles, [-2.4, -2.2, -2.0], atol=1e-3)
