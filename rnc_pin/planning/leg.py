"""One leg of a car's path: a polynomial in a chart of its own. Paper (22).

(x, y) of the rear axle is a flat output of a car (Fliess, Levine, Martin and Rouchon 1995): heading, steering
angle and speed follow from it by differentiation. In the chained form (22) ``x1 = tan theta = y'`` and
``x0 = tan phi / (L cos^3 theta) = y''`` are functions of x. So a leg from pose to pose with straight wheels is the
quintic y(x) with given y, y' and y'' = 0 at both ends. The form holds in any rotated axes. Each leg has its own axes (a
chart), and its headings stay within 75 degrees of them. If x decreases along the leg, the car backs up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy import ndarray as Array
from numpy.polynomial import Polynomial

from rnc_pin.array_shapes import Float
from rnc_pin.math.coordinates import wrapped
from rnc_pin.planning.references import MinimumJerk

_STEEPEST = np.deg2rad(75.0)
FINE = 201  # samples of a leg in the final path
_MARGIN = 0.99  # factor on the largest curvature: between samples the curvature may be slightly larger
# Angles of charts from the mean heading, as parts of the angle that the limit of 75 degrees leaves.
_OFFSETS = np.array([0.0, -0.25, 0.25, -0.5, 0.5, -0.8, 0.8])

# Quintics on s in [0, 1]: one each with unit final value, initial slope and final slope; all other end data are zero.
_SHAPES = [Polynomial([0, 0, 0, 10, -15, 6]), Polynomial([0, 1, 0, -6, 8, -3]), Polynomial([0, 0, 0, -4, 7, -3])]
_VALUES, _SLOPES, _BENDS = ([shape.deriv(order) if order else shape for shape in _SHAPES] for order in range(3))


@cache
def _sampled(samples: int) -> tuple[Array, Array, Array]:
    """Samples s (samples,), and first and second derivatives (3, samples) of the shapes at them."""
    s = np.linspace(0.0, 1.0, samples)
    return s, np.array([shape(s) for shape in _SLOPES]), np.array([shape(s) for shape in _BENDS])


@dataclass(frozen=True)
class Leg:
    """Path of one piece between two poses; the car rests with straight wheels at both.

    Attributes:
        start: (x, y, heading) of the rear axle's middle [m, m, rad].
        goal: the same.
        chart: direction of the x axis in which the leg is y(x) [rad].
    """

    start: Float[Array, " 3"]
    goal: Float[Array, " 3"]
    chart: float

    @property
    def length(self) -> float:
        """Length along the path [m]."""
        dx, factors = self._coefficients()
        s, slopes, _ = _sampled(FINE)
        return float(abs(dx) * np.trapezoid(np.sqrt(1 + (factors @ slopes / dx) ** 2), s))

    def _coefficients(self) -> tuple[float, Array]:
        """Extent in x, and factors (3,) of the shapes."""
        dx, dy, slopes = _in_chart(self.start, self.goal, np.array(self.chart))
        return float(dx), np.array([dy, dx * slopes[0], dx * slopes[1]])

    def drive(self, duration: float, wheelbase: float, samples: int) -> tuple[Array, Array, Array, Array]:
        """Return the motion along the leg; the chart's x is a minimum-jerk function of time.

        Args:
            duration: [s].
            wheelbase: rear to front axle [m].
            samples: number of equally spaced times.

        Returns:
            Times (N,) from zero, poses (N, 3), signed speeds (N,) and steering angles (N,).
        """
        times = np.linspace(0.0, duration, samples)
        along = MinimumJerk([0.0], [1.0], duration)
        points = [along.at(t) for t in times]
        s = np.array([point.position[0] for point in points])
        s_dot = np.array([point.velocity[0] for point in points])
        dx, factors = self._coefficients()
        y = sum(a * shape(s) for a, shape in zip(factors, _VALUES, strict=True))
        slope = sum(a * shape(s) for a, shape in zip(factors, _SLOPES, strict=True)) / dx
        bend = sum(a * shape(s) for a, shape in zip(factors, _BENDS, strict=True)) / dx**2
        c, n = np.cos(self.chart), np.sin(self.chart)
        x = dx * s
        # Keep the start heading as given, not modulo a full turn.
        heading = self.start[2] + np.arctan(slope) - np.arctan(slope[0])
        poses = np.column_stack([self.start[0] + c * x - n * y, self.start[1] + n * x + c * y, heading])
        speeds = dx * s_dot * np.sqrt(1 + slope**2)
        return times, poses, speeds, np.arctan(wheelbase * bend / (1 + slope**2) ** 1.5)


def best_legs(
    starts: Float[Array, "n 3"],
    goals: Float[Array, "n 3"],
    radius: float,
    forward_only: bool = False,
    samples: int = FINE,
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Return costs (n,) and charts (n,) of the best legs between pairs of poses; infinite cost if there is no leg.

    The cost is ``integral of 1 + (radius curvature)^2 along the leg``: its length plus a penalty on curvature. Without
    the penalty the best leg would turn as sharply as possible at both ends.

    Args:
        starts: poses.
        goals: poses.
        radius: smallest turning radius of the car [m].
        forward_only: True excludes legs that back up.
        samples: number of checked points on a leg; too few miss sharp bends.
    """
    s, slopes, bends = _sampled(samples)
    turn = wrapped(goals[:, 2] - starts[:, 2])
    room = _STEEPEST - np.abs(turn) / 2
    costs, charts = np.full(len(starts), np.inf), np.zeros(len(starts))
    for offset in _OFFSETS:
        chart = starts[:, 2] + turn / 2 + offset * room
        dx, dy, (first, last) = _in_chart(starts, goals, chart)
        # Otherwise the end headings are outside the chart, or the leg has no extent.
        able = np.flatnonzero((room > 0) & ((dx if forward_only else np.abs(dx)) > 1e-6 * radius))
        dx, dy, first, last = (each[able, None] for each in (dx, dy, first, last))
        slope = dy / dx * slopes[0] + first * slopes[1] + last * slopes[2]
        square = 1 + slope**2
        bend = (dy / dx * bends[0] + first * bends[1] + last * bends[2]) / dx
        tightness = (bend * radius) ** 2 / square**3  # (radius curvature)^2
        drivable = ((tightness <= _MARGIN**2) & (square <= 1 + np.tan(_STEEPEST) ** 2)).all(axis=1)
        cost = np.abs(dx[:, 0]) * np.trapezoid(np.sqrt(square) * (1 + tightness), s, axis=1)
        better = drivable & (cost < costs[able])
        costs[able[better]], charts[able[better]] = cost[better], chart[able[better]]
    return costs, charts


def _in_chart(start: Array, goal: Array, chart: Array) -> tuple[Array, Array, tuple[Array, Array]]:
    """Displacement along and across a chart's axis, and slopes at both ends; batch axes lead."""
    d = goal - start
    c, n = np.cos(chart), np.sin(chart)
    slopes = np.tan(start[..., 2] - chart), np.tan(goal[..., 2] - chart)
    return c * d[..., 0] + n * d[..., 1], c * d[..., 1] - n * d[..., 0], slopes
