"""Chords of a driven path between places and on a fitted curve."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from rnc_pin.control.path_fit import PathPoint, chord_end_between, chord_end_fitted


def curvature_of(d, dd):
    """Curvature of a plane curve by its derivatives."""
    return (d[0] * dd[1] - d[1] * dd[0]) / np.hypot(*d) ** 3


def hermite(begin, end):
    """The cubic between two places whose speeds are as long as the straight way."""
    h = np.hypot(end[0] - begin[0], end[1] - begin[1])
    slopes = [h * np.array([np.cos(heading), np.sin(heading)]) for heading in (begin[2], end[2])]
    return CubicHermiteSpline([0.0, 1.0], [begin[:2], end[:2]], slopes)


def parameter_at(curve, place, L):
    """Parameter, from 0 to 1, at which a chord of length L from a place meets the curve."""
    return brentq(lambda s: np.hypot(*(place - curve(s))) - L, 0, 1, xtol=1e-15, rtol=1e-15)


def test_the_end_of_a_chord_between_two_places_is_on_the_cubic_through_them():
    for x, y, h0, turn, far, side in np.random.default_rng(4).uniform(-1, 1, (30, 6)):
        step, across = 0.4 + 0.2 * far, 0.1 * side
        begin = [x, y, 3 * h0]
        direction = 3 * h0 + 0.2 * turn + 0.1
        end = (x + step * np.cos(direction), y + step * np.sin(direction), 3 * h0 + 0.4 * turn)
        curve = hermite(begin, end)
        px, py = end[0] + 0.9 * np.cos(end[2]) - across * np.sin(end[2]), end[1] + 0.9 * np.sin(end[2])
        nearest, farthest = (np.hypot(px - place[0], py - place[1]) for place in (end, begin))
        L = 0.7 * nearest + 0.3 * farthest
        s = parameter_at(curve, np.array([px, py]), L)
        point = chord_end_between(begin, end, px, py, L)
        d, dd = curve(s, 1), curve(s, 2)
        expected = [*curve(s), np.arctan2(d[1], d[0]), curvature_of(d, dd)]
        np.testing.assert_allclose(point, expected, rtol=1e-10, atol=1e-11)
        for length, place in ((0.5 * nearest, 1.0), (1.5 * farthest, 0.0)):  # beyond the places: the nearer one
            point, d, dd = chord_end_between(begin, end, px, py, length), curve(place, 1), curve(place, 2)
            expected = [*curve(place), np.arctan2(d[1], d[0]), curvature_of(d, dd)]
            np.testing.assert_allclose(point, expected, rtol=1e-11, atol=1e-12)


def driven(count, spacing, noise, seed, turn=0.8):
    """Places along a winding way, with noise; x, y, heading and distance."""
    generator = np.random.default_rng(seed)
    s = spacing * np.arange(count)
    heading = 1.1 + turn * np.sin(1.5 * s)
    x, y = (np.concatenate([[0.3], 0.3 + np.cumsum(spacing * f(heading[:-1]))]) for f in (np.cos, np.sin))
    path = np.column_stack([x, y, heading, s + 5.0])
    path[:, :3] += noise * generator.normal(size=(count, 3))
    return path


def near_to(path, older, share):
    """A place between two of a path, not quite on it."""
    begin, end = path[older], path[older + 1]
    x, y, heading, _ = (1 - share) * begin + share * end
    return PathPoint(x + 1e-3, y - 2e-3, heading + 0.01, 0.5)


def fitted(path, older, near, kingpin, L, window):
    """Of all quintics that with the least weighed errors of place and heading, and where on it the chord ends."""
    reached = path[older, 3] + np.hypot(near.x - path[older, 0], near.y - path[older, 1])
    c, s = np.cos(near.heading), np.sin(near.heading)
    axes = np.array([[c, s], [-s, c]])
    rows = []
    for x, y, heading, distance in path:
        turned = np.angle(np.exp(1j * (heading - near.heading)))
        if abs(distance - reached) <= window and abs(turned) < 1.0:
            along, left = axes @ [x - near.x, y - near.y]
            rows.append((along, left, turned, 1 - ((distance - reached) / window) ** 2))
    along, left, turned, weight = np.array(rows).T

    def errors(a):
        """Of heading the slope's, linear as in the small: by cos^2 of it, at a lever of L."""
        y = np.polynomial.Polynomial(a)
        slope = (y.deriv()(along) - np.tan(turned)) * np.cos(turned) ** 2
        return np.concatenate([weight * (y(along) - left), weight * L * slope])

    design = np.stack([errors(each) - errors(np.zeros(6)) for each in np.eye(6)], axis=1)
    curve = np.polynomial.Polynomial(np.linalg.lstsq(design, -errors(np.zeros(6)), rcond=None)[0])
    p = axes @ (np.array(kingpin) - [near.x, near.y])
    u = brentq(lambda u: np.hypot(p[0] - u, p[1] - curve(u)) - L, -window, 0.3 * window, xtol=1e-15, rtol=1e-15)
    slope, second = curve.deriv()(u), curve.deriv(2)(u)
    place = np.array([near.x, near.y]) + axes.T @ [u, curve(u)]
    return PathPoint(*place, near.heading + np.arctan(slope), second / (1 + slope**2) ** 1.5), len(rows)


@pytest.mark.parametrize(("noise", "window"), [(0.0, 0.35), (3e-3, 0.35), (3e-3, 0.21)])
def test_the_end_of_a_chord_on_a_fitted_path_is_that_of_the_best_quintic(noise, window):
    for seed, (share, off) in enumerate(np.random.default_rng(2).uniform(0.1, 0.9, (8, 2))):
        path = driven(24, 0.07, noise, seed)
        near = near_to(path, 9, share)
        direction = near.heading + 0.4 * off
        L = 0.8
        kingpin = (near.x + 0.82 * np.cos(direction), near.y + 0.82 * np.sin(direction))
        expected, count = fitted(path, 9, near, kingpin, L, window)
        assert count >= 6
        point = chord_end_fitted(path, 9, near, *kingpin, L, window)
        np.testing.assert_allclose(point[:3], expected[:3], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(point.curvature, expected.curvature, rtol=1e-7, atol=1e-7)
        assert np.hypot(kingpin[0] - point.x, kingpin[1] - point.y) == pytest.approx(L, rel=1e-12)


def straight(*distances):
    """Places on a gentle bend at these distances."""
    s = np.array(distances)
    return np.column_stack([s, 0.05 * s**2, np.arctan(0.1 * s), s + 2.0])


def test_a_path_is_fitted_to_four_places_and_not_to_three():
    """Of those within the window that head within a radian of its middle."""
    path = straight(-0.3, -0.1, 0.02, 0.1, 0.2, 0.5)
    near, window = PathPoint(0.05, 0.0, 0.0, 0.3), 0.251
    kingpin = (0.85, 0.1)
    expected, count = fitted(path, 2, near, kingpin, 0.8, window)
    assert count == 4
    np.testing.assert_allclose(chord_end_fitted(path, 2, near, *kingpin, 0.8, window), expected, rtol=1e-8, atol=1e-9)
    assert chord_end_fitted(path, 2, near, *kingpin, 0.8, 0.14) is near
    for turned, steep in ((0.999999, False), (1.000001, True), (-0.999999, False), (-1.000001, True)):
        bent = path.copy()
        bent[4, 2] = turned + 2 * np.pi
        found = chord_end_fitted(bent, 2, near, *kingpin, 0.8, window)
        assert (found is near) == steep
        if not steep:
            expected, count = fitted(bent, 2, near, kingpin, 0.8, window)
            assert count == 4
            np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-8)
