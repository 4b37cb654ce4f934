"""Where a path known by places is a chord away from a point: on the curve that fits the places around best."""

from __future__ import annotations

from math import atan, atan2, cos, hypot, sin
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.math.coordinates import wrapped

_DEGREE = 5
_FEWEST = 4  # places, each with a heading, that a curve of this degree can be fitted to
_STEEPEST = 1.0  # heading against the middle of the window up to which y(x) describes a path [rad]
_CLOSE = 1e-13  # part of a step, or of the window, below which Newton has arrived


class PathPoint(NamedTuple):
    """A place on a path."""

    x: float
    y: float
    heading: float
    """Direction of the path [rad]."""
    curvature: float
    """[1/m], to the left."""


def chord_end_between(
    begin: list[float], end: list[float] | tuple[float, float, float], px: float, py: float, L: float
) -> PathPoint:
    """Where a cubic Hermite curve between two places (x, y, heading) is L from (px, py), by Newton."""
    x0, y0, dx, dy = begin[0], begin[1], end[0] - begin[0], end[1] - begin[1]
    h = hypot(dx, dy)
    ux, uy, vx, vy = h * cos(begin[2]), h * sin(begin[2]), h * cos(end[2]), h * sin(end[2])
    # x0 + ux s + b s^2 + a s^3
    bx, by, ax, ay = 3 * dx - 2 * ux - vx, 3 * dy - 2 * uy - vy, ux + vx - 2 * dx, uy + vy - 2 * dy
    s = 0.0
    for _ in range(12):
        x, y = x0 + s * (ux + s * (bx + s * ax)), y0 + s * (uy + s * (by + s * ay))
        x_s, y_s = ux + s * (2 * bx + 3 * s * ax), uy + s * (2 * by + 3 * s * ay)
        rx, ry = px - x, py - y
        slope = rx * x_s + ry * y_s
        if slope <= 0.0:
            break  # across the path: the caller says so
        step = (rx * rx + ry * ry - L * L) / (2 * slope)
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
    """Where the quintic that fits the places around best is L from (px, py).

    In axes at ``near`` the path is y(x), and the places give values of y and, by their headings, of its slope. They are
    weighed by ``(1 - u^2)^2``, u the distance along the path over the window, so that none comes or goes with a jump;
    an error of heading counts like one of position L away. So noise of the places is averaged where the curve
    through two of them would divide it by the square of their distance.

    Args:
        path: x, y, heading and distance driven, oldest first.
        older: index of the place before ``near``.
        near: where a curve through the two places around is L from (px, py).
        px, py: the other end of the chord.
        L: its length [m].
        window: distance along the path beyond which places do not count [m].

    Returns:
        The place on the fitted curve; ``near`` itself where there are too few places around it, or it is not between
        two of them.
    """
    x0, y0, axis, _ = near
    driven = path[:, 3]
    middle = driven[older] + hypot(x0 - path[older, 0], y0 - path[older, 1])
    first, last = np.searchsorted(driven, [middle - window, middle + window])
    if first > older or last < older + 2:
        return near
    around = path[first:last]
    turned = wrapped(around[:, 2] - axis)
    even = np.abs(turned) < _STEEPEST
    if np.count_nonzero(even) < _FEWEST:
        return near
    around, turned = around[even], turned[even]
    c, s = cos(axis), sin(axis)
    dx, dy = around[:, 0] - x0, around[:, 1] - y0
    u, values = (c * dx + s * dy) / window, (c * dy - s * dx) / window
    weight = 1.0 - ((around[:, 3] - middle) / window) ** 2
    powers = u[:, None] ** np.arange(_DEGREE + 1)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, _DEGREE + 1)
    # The heading that a slope means turns by cos^2 of it.
    lever = weight * np.cos(turned) ** 2 * (L / window)
    rows = np.concatenate([weight[:, None] * powers, lever[:, None] * slopes])
    right = np.concatenate([weight * values, lever * np.tan(turned)])
    curve = np.linalg.lstsq(rows, right, rcond=None)[0]
    return _chord_end_along(curve.tolist(), near, px, py, L, window)


def _chord_end_along(curve: list[float], near: PathPoint, px: float, py: float, L: float, window: float) -> PathPoint:
    """Where y(x), a polynomial in axes at ``near`` and in units of the window, is L from (px, py), by Newton."""
    x0, y0, axis, _ = near
    c, s = cos(axis), sin(axis)
    ahead, left = (c * (px - x0) + s * (py - y0)) / window, (c * (py - y0) - s * (px - x0)) / window
    square, u = (L / window) ** 2, 0.0
    for _ in range(12):
        y, slope, bend = _derivatives(curve, u)
        rx, ry = ahead - u, left - y
        along = rx + ry * slope
        if along <= 0.0:
            return near  # across the path: the caller says so
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
    """A polynomial and its first two derivatives, by Horner."""
    y = slope = bend = 0.0
    for coefficient in reversed(curve):
        bend = bend * u + 2.0 * slope
        slope = slope * u + y
        y = y * u + coefficient
    return y, slope, bend
