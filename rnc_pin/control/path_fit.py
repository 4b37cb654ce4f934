"""Point of a sampled path at chord length L from another point, on a curve fitted to the samples around it."""

from __future__ import annotations

from math import atan, atan2, cos, hypot, sin
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.model.coordinates import wrapped

_CLOSE = 1e-13  # last Newton step, relative to a spacing or to the window


class PathPoint(NamedTuple):
    """Place on a path."""

    x: float
    y: float
    heading: float
    """Direction of the path [rad]."""
    curvature: float
    """[1/m], to the left."""


def chord_end_between(
    begin: list[float], end: list[float] | tuple[float, float, float], px: float, py: float, L: float
) -> PathPoint:
    """Return the point of a cubic Hermite curve between two places (x, y, heading) at distance L from (px, py).

    The method is Newton's.

    Args:
        begin: first place [m, m, rad].
        end: second place [m, m, rad].
        px: x of the other end of the chord [m].
        py: y of the other end of the chord [m].
        L: length of the chord [m].
    """
    x0, y0, dx, dy = begin[0], begin[1], end[0] - begin[0], end[1] - begin[1]
    h = hypot(dx, dy)
    ux, uy, vx, vy = h * cos(begin[2]), h * sin(begin[2]), h * cos(end[2]), h * sin(end[2])
    # x0 + ux s + b s^2 + a s^3
    bx, by, ax, ay = 3 * dx - 2 * ux - vx, 3 * dy - 2 * uy - vy, ux + vx - 2 * dx, uy + vy - 2 * dy
    s = 0.0
    for _ in range(12):  # a bound only: Newton's method is quadratic near the solution
        x, y = x0 + s * (ux + s * (bx + s * ax)), y0 + s * (uy + s * (by + s * ay))
        x_s, y_s = ux + s * (2 * bx + 3 * s * ax), uy + s * (2 * by + 3 * s * ay)
        rx, ry = px - x, py - y
        slope = rx * x_s + ry * y_s
        if slope <= 0.0:
            break  # the chord is across the path: the caller raises the error
        step = (rx * rx + ry * ry - L * L) / (2 * slope)
        # The point is between both places: beyond them the cubic is of no use.
        moved = min(max(s + step, 0.0), 1.0)
        if abs(moved - s) < _CLOSE:
            break
        s = moved
    speed = hypot(x_s, y_s)
    bend = x_s * (2 * by + 6 * s * ay) - y_s * (2 * bx + 6 * s * ax)
    return PathPoint(x, y, atan2(y_s, x_s), bend / speed**3)


def chord_end_fitted(
    path: Float[Array, "n 4"], older: int, near: PathPoint, px: float, py: float, L: float, window: float
) -> PathPoint:
    """Return the point at distance L from (px, py) on the quintic fitted to the places around it.

    In axes at ``near`` the path is y(x). The places give values of y; their headings give values of its slope. The
    weights are ``(1 - u^2)^2``, with u the distance along the path over the window, so no place enters or leaves with a
    jump. A heading error counts like a position error at distance L. The fit averages the noise of the places. A curve
    through only two places would divide the noise by the square of their distance.

    Args:
        path: x, y, heading and distance driven, oldest first.
        older: index of the place before ``near``.
        near: point at distance L from (px, py) on a curve through the two places around it.
        px, py: the other end of the chord.
        L: length of the chord [m].
        window: distance along the path beyond which places do not count [m].

    Returns:
        The point on the fitted curve; ``near`` itself if too few places are around it, or if it is not between two of
        them.
    """
    x0, y0, axis, _ = near
    driven = path[:, 3]
    middle = driven[older] + hypot(x0 - path[older, 0], y0 - path[older, 1])
    first, last = np.searchsorted(driven, [middle - window, middle + window])
    # The window has to hold the places on both sides of the point.
    if first > older or last < older + 2:
        return near
    around = path[first:last]
    turned = wrapped(around[:, 2] - axis)
    steepest = 1.0  # heading against the middle of the window for which y(x) describes a path [rad]
    even = np.abs(turned) < steepest
    fewest = 4  # places, each with a heading, for a curve of this degree
    if np.count_nonzero(even) < fewest:
        return near
    around, turned = around[even], turned[even]
    c, s = cos(axis), sin(axis)
    dx, dy = around[:, 0] - x0, around[:, 1] - y0
    u, values = (c * dx + s * dy) / window, (c * dy - s * dx) / window
    weight = 1.0 - ((around[:, 3] - middle) / window) ** 2
    degree = 5  # of the polynomial y(x)
    powers = u[:, None] ** np.arange(degree + 1)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, degree + 1)
    # d(heading) = cos^2(heading) d(slope).
    lever = weight * np.cos(turned) ** 2 * (L / window)
    rows = np.concatenate([weight[:, None] * powers, lever[:, None] * slopes])
    right = np.concatenate([weight * values, lever * np.tan(turned)])
    curve = np.linalg.lstsq(rows, right, rcond=None)[0]
    return _chord_end_along(curve.tolist(), near, px, py, L, window)


def _chord_end_along(curve: list[float], near: PathPoint, px: float, py: float, L: float, window: float) -> PathPoint:
    """Point at distance L from (px, py) on y(x), a polynomial in axes at ``near`` in units of the window, by Newton."""
    x0, y0, axis, _ = near
    c, s = cos(axis), sin(axis)
    ahead, left = (c * (px - x0) + s * (py - y0)) / window, (c * (py - y0) - s * (px - x0)) / window
    square, u = (L / window) ** 2, 0.0
    for _ in range(12):
        y, slope, bend = _derivatives(curve, u)
        rx, ry = ahead - u, left - y
        along = rx + ry * slope
        if along <= 0.0:
            return near  # the chord is across the path: the caller raises the error
        step = (rx * rx + ry * ry - square) / (2 * along)
        u += step
        if abs(u) > 1.0:
            return near
        if abs(step) < _CLOSE:
            break
    x, y = u * window, y * window
    heading = axis + atan(slope)
    return PathPoint(x0 + c * x - s * y, y0 + s * x + c * y, heading, bend / window / (1.0 + slope * slope) ** 1.5)


def _derivatives(curve: list[float], u: float) -> tuple[float, float, float]:
    """Polynomial and its first two derivatives, by Horner's scheme."""
    y = slope = bend = 0.0
    for coefficient in reversed(curve):
        bend = bend * u + 2.0 * slope
        slope = slope * u + y
        y = y * u + coefficient
    return y, slope, bend
