"""References: derivatives belong together, ends are at rest, and the profile is the one named."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polynomials import powers
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.motion.planning import Geodesic, Harmonic, Hold, Joined, MinimumJerk, TaskReference, ViaPoints
from rnc_pin.references.reference import InTurn
from tolerances import ROUNDING


def test_via_points_are_joined_by_the_quintic_spline():
    """Pieces by hand: values at knots, four derivatives that go on over inner ones, rest at both ends."""
    knots, values = np.array([0.5, 1.2, 2.6, 3.1]), np.array([[1.0, 0.3], [-0.4, 2.0], [0.7, -1.1], [2.2, 0.6]])
    rows, right = [], []

    def condition(value, *terms):
        row = np.zeros(18)
        for piece, t, order, sign in terms:
            row[6 * piece : 6 * piece + 6] += sign * powers([t - knots[piece]], order)[0]
        rows.append(row)
        right.append(np.broadcast_to(value, 2))

    for piece in range(3):
        for end in (piece, piece + 1):
            condition(values[end], (piece, knots[end], 0, 1))
    for inner, order in product((1, 2), (1, 2, 3, 4)):
        condition(0.0, (inner - 1, knots[inner], order, 1), (inner, knots[inner], order, -1))
    for order in (1, 2):
        condition(0.0, (0, knots[0], order, 1))
        condition(0.0, (2, knots[3], order, 1))
    pieces = np.linalg.solve(rows, right).reshape(3, 6, 2)
    reference = ViaPoints(knots, values)
    for t in (0.5, 0.61, 1.2, 1.9, 2.7, 3.09):
        piece = np.searchsorted(knots, t, side="right") - 1
        for order, part in enumerate(reference.at(t)):
            expected = powers([t - knots[piece]], order)[0] @ pieces[piece]
            np.testing.assert_allclose(part, expected, rtol=1e-8, atol=1e-7)


def test_a_geodesic_among_other_outputs_is_the_shortest_turn():
    start, goal = np.array([0.4, 0.3, -1.1, 0.5, 2.0]), np.array([1.4, -0.7, 0.2, 1.9, -1.0])
    reference = Geodesic(start, goal, 2.5, Coordinates([False] * 5, [1]), begin=0.75)
    assert (reference.size, reference.duration) == (5, 3.25)
    first, last = (Rotation.from_rotvec(each[1:4]) for each in (start, goal))
    arc = (last * first.inv()).as_rotvec()

    def place(t):
        u = np.clip((t - 0.75) / 2.5, 0, 1)
        s = 10 * u**3 - 15 * u**4 + 6 * u**5
        turned = (Rotation.from_rotvec(s * arc) * first).as_rotvec()
        others = start + s * (goal - start)
        return np.array([others[0], *turned, others[4]])

    h = 1e-4
    for t in (0.0, 0.9, 1.7, 2.9, 3.25, 8.0):
        point = reference.at(t)
        np.testing.assert_allclose(point.position, place(t), atol=1e-10)
        np.testing.assert_allclose(point.velocity, (place(t + h) - place(t - h)) / (2 * h), atol=1e-6)
        second = (place(t + h) - 2 * place(t) + place(t - h)) / h**2
        np.testing.assert_allclose(point.acceleration, second, atol=1e-2 if t == 3.25 else 1e-5)
        assert np.isnan(point.jerk).tolist() == [False, True, True, True, False]
    line = Geodesic(0.5, 2.0, 1.0, Coordinates([False]))
    np.testing.assert_allclose([line.at(0.5).position, line.at(0.5).velocity], [[1.25], [1.5 * 1.875]])


def assert_same(point, *expected):
    for part, value in zip(point, expected, strict=True):
        np.testing.assert_allclose(part, value, atol=ROUNDING)


def test_a_minimum_jerk_motion_has_the_rates_of_its_quintic():
    """Begun late: before, at the first and from the last moment on it rests, and between it is the polynomial."""
    reference, move = MinimumJerk([1.0, 2.0], [4.0, 1.0], 2.0, begin=3.0), np.array([3.0, -1.0])
    assert (reference.size, reference.duration) == (2, 5.0)
    for t in (-1.0, 2.999, 3.0):
        assert_same(reference.at(t)[:3], [1.0, 2.0], 0.0, 0.0)
    for s in (0.0, 0.1, 0.5, 0.8, 0.9999):
        assert_same(
            reference.at(3.0 + 2.0 * s),
            [1.0, 2.0] + move * (10 * s**3 - 15 * s**4 + 6 * s**5),
            move * (30 * s**2 - 60 * s**3 + 30 * s**4) / 2,
            move * (60 * s - 180 * s**2 + 120 * s**3) / 4,
            move * (60 - 360 * s + 360 * s**2) / 8,
        )
    assert_same(reference.at(2.999), [1.0, 2.0], 0.0, 0.0, 0.0)
    for t in (5.0, 99.0):
        assert_same(reference.at(t), [4.0, 1.0], 0.0, 0.0, 0.0)


def test_via_points_begin_when_the_first_says_and_may_be_numbers():
    times, points = [2.0, 3.0, 5.0], [1.0, 4.0, 2.0]
    reference = ViaPoints(times, points)
    assert (reference.size, reference.duration) == (1, 5.0)
    for t, point in zip(times, points, strict=True):
        np.testing.assert_allclose(reference.at(t).position, [point], atol=ROUNDING)
    for t in (2.0, 1.9, 5.0):
        assert_same(reference.at(t)[1:3], 0.0, 0.0)


def test_a_harmonic_grows_by_the_step_of_degree_seven():
    """``35 u^4 - 84 u^5 + 70 u^6 - 20 u^7`` of the ramp, by Leibniz with the sine; from its end on the sine alone."""
    center, amplitude, rate, phase, ramp = np.array([0.3, -0.2]), np.array([0.5, 2.0]), 2 * np.pi * 0.4, 0.7, 3.0
    reference = Harmonic(center, amplitude, 0.4, phase, ramp)
    step = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
    growth = [step.deriv(k) if k else step for k in range(4)]
    for t in (0.5, 2.0, 2.999, 3.0, 7.0):
        g = [growth[k](t / ramp) / ramp**k if t < ramp else float(k == 0) for k in range(4)]
        wave = [amplitude * rate**k * np.sin(rate * t + phase + k * np.pi / 2) for k in range(4)]
        expected = [sum(n * g[k] * wave[i - k] for k, n in enumerate(row)) for i, row in enumerate(PASCAL)]
        expected[0] = expected[0] + center
        assert_same(reference.at(t), *expected)
    for t in (0.0, -1.0):
        assert_same(reference.at(t), center, 0.0, 0.0, 0.0)
    assert reference.duration == np.inf
    at_once = Harmonic([0.0], 1.0, 0.25, ramp=0.0)
    assert_same(at_once.at(1.0), [1.0], 0.0, -(np.pi**2) / 4, 0.0)
    assert_same(at_once.at(1e-12)[:2], 0.0, np.pi / 2)


PASCAL = ((1,), (1, 1), (1, 2, 1), (1, 3, 3, 1))


def test_references_that_are_joined_or_in_turn():
    first, second = MinimumJerk([0.0], [1.0], 2.0), MinimumJerk([1.0], [5.0], 1.0, begin=2.0)
    turn = InTurn([first, second])
    assert (turn.size, turn.duration) == (1, 3.0)
    for t, part in ((1.0, first), (1.999, first), (2.0, second), (2.5, second), (3.0, second), (9.0, second)):
        assert_same(turn.at(t), *part.at(t))
    joined = Joined([first, Hold([7.0, 8.0]), second])
    assert (joined.size, joined.duration) == (4, 3.0)
    np.testing.assert_allclose(joined.at(2.5).position, [1.0, 7.0, 8.0, 3.0])
    assert (Joined([]).size, Joined([]).duration, Hold([1.0]).duration) == (0, 0.0, 0.0)
    assert TaskReference(first, second).duration == TaskReference(second, first).duration == 3.0


def test_later_changes_of_given_arrays_change_no_reference():
    value = np.array([0.5, 1.0])
    references = Hold(value), Harmonic(value, 0.1, 1.0)
    value[:] = 9.0
    for reference in references:
        assert reference.at(0.0).position.tolist() == [0.5, 1.0]
    with pytest.raises(ValueError, match="read-only"):
        references[0].at(0.0).position[0] = 9.0
