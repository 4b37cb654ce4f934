"""Jets of iterated brackets: closed forms, moving axes, and which brackets a flow shows."""

from itertools import product
from math import factorial

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.analysis.lie_brackets import PIECES, BracketJets
from systems import ALL, random_states
from textbook_systems import sliders_with_rows

MOEBIUS = {1: 1, 2: -1, 3: -1, 4: 0, 5: -1, 6: 1, 7: -1, 8: 0}


def commutator(x, y):
    """Of tensors, in the free associative algebra."""
    return np.multiply.outer(x, y) - np.multiply.outer(y, x)


@pytest.mark.parametrize(("generators", "degree"), [(2, 4), (2, 5), (2, 6), (2, 7), (2, 8), (3, 4), (3, 5), (4, 4)])
def test_the_fields_of_a_flow_show_every_bracket(generators, degree):
    """``ad_Y1^a ad_Y2^b ad_Y3^c [X, X']`` of random fields span what Witt's formula counts in a free Lie algebra."""
    divisors = [d for d in range(1, degree + 1) if degree % d == 0]
    dimension = sum(MOEBIUS[d] * generators ** (degree // d) for d in divisors) // degree
    generator, found = np.random.default_rng(0), []
    while len(found) < dimension + 10:
        fields = generator.normal(size=(PIECES, generators))
        for powers in product(range(degree - 1), repeat=PIECES):
            if sum(powers) == degree - 2:
                value = commutator(*generator.normal(size=(2, generators)))
                for field, power in reversed(list(zip(fields, powers, strict=True))):
                    for _ in range(power):
                        value = commutator(field, value)
                found.append(value.ravel() / np.linalg.norm(value))
    assert np.linalg.matrix_rank(np.array(found), tol=1e-8) == dimension


def test_rates_in_a_chart_are_those_of_the_exponential():
    """``xi'`` in ``exp(xi)`` for the velocity v of a planar body; terms of the series shrink by ``|xi| / 2 pi``."""
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    jets = BracketJets(rnc.NonholonomicSystem(robot).reduce(), robot.configuration())
    xi, v = np.array([0.3, -0.2, 0.4]), np.array([0.7, 0.5, -0.3])
    exact = np.linalg.solve(pin.dIntegrate(robot.model, pin.neutral(robot.model), xi)[1], v)
    for order in (2, 3, 6, 12):
        error = np.abs(jets._in_chart(xi[None], v[None], order)[0] - exact).max()
        assert error < 4.0 * (np.linalg.norm(xi) / (2.0 * np.pi)) ** (order + 2) + 1e-15


@pytest.mark.parametrize(("order", "error"), [(7, 1e-10), (9, 1e-9)])
def test_coefficients_are_those_of_a_closed_form(order, error):
    """``x2' = sin(x0) x1'``: a bracket pulled back from ``x0 + s t`` is ``c cos(x0 + s t)`` along x2."""
    reduced = sliders_with_rows(lambda q: [[0.0, np.sin(q[0])]], lambda q, v: [[0.0, np.cos(q[0]) * v[0]]])
    x, time = 0.4, 0.5
    drawn = BracketJets(reduced, np.array([x, 0.3, -0.2])).draw(order, time, np.random.default_rng(4))
    np.testing.assert_allclose(drawn.coefficients[:, :2], 0.0, atol=1e-9)
    derivatives = np.array([np.cos(x + k * np.pi / 2) / factorial(k) for k in range(order + 1)])
    for function in drawn.coefficients[:, 2].T:
        c = function[0] / derivatives[0]
        s = function[1] / (c * derivatives[1])
        assert 1e-3 < abs(s) < 1.0
        largest = np.abs(np.polynomial.Polynomial(function)(np.linspace(-1.0, 1.0, 99))).max()
        assert largest == pytest.approx(1.0, abs=0.01)  # its unit
        np.testing.assert_allclose(function, c * derivatives * s ** np.arange(order + 1), atol=error)


@pytest.mark.parametrize("name", ["fire_truck", "leaning_wheel", "free_flying_panda"])
def test_the_first_coefficient_is_the_bracket_of_generators(name):
    reduced = ALL[name]()
    q, _ = random_states(reduced, 1, seed=4)[0]
    jets = BracketJets(reduced, q)
    pairs = jets.pairs()
    there = np.linalg.norm(pairs, axis=0) > 1e-6
    drawn = jets.draw(2, 0.05, np.random.default_rng(1))
    values = drawn.coefficients[0].reshape(reduced.n, PIECES, -1)
    for piece in range(PIECES):
        found, expected = values[:, piece, there], pairs[:, there]
        scale = np.sum(found * expected, axis=0) / np.sum(expected * expected, axis=0)
        np.testing.assert_allclose(found, scale * expected, atol=1e-9)
    assert np.abs(drawn.coefficients - drawn.coarser).max() < 1e-6
