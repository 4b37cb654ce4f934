"""One stretch of a car's path: a polynomial in a chart of its own. Paper (22).

(x, y) of the rear axle is a flat output of a car (Fliess, Levine, Martin and Rouchon 1995): heading, steering
angle and speed follow from it by differentiation. In the chained form (22) ``x1 = tan theta = y'`` and
``x0 = tan phi / (L cos^3 theta) = y''`` as functions of x, so from pose to pose with straight wheels goes the
quintic y(x) with y, y' and y'' = 0 given at both ends. The form holds in any rotated axes: a leg has axes (a chart)
from which its headings stay within 75 degrees. Where x falls along it, the car backs up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from numpy.polynomial import Polynomial

from rnc_pin.math.coordinates import wrapped
from rnc_pin.planning.references import MinimumJerk

_STEEPEST = np.deg2rad(75.0)
FINE = 201  # samples of a leg that is to be driven
_MARGIN = 0.99  # curvature is compared at samples; between them it may be a little more
# Of charts from the mean heading, as parts of what 75 degrees leave.
_OFFSETS = np.array([0.0, -0.25, 0.25, -0.5, 0.5, -0.8, 0.8])

# On s in [0, 1]: final value, initial slope and final slope one, and all other values, slopes and curvatures zero.
_SHAPES = [Polynomial([0, 0, 0, 10, -15, 6]), Polynomial([0, 1, 0, -6, 8, -3]), Polynomial([0, 0, 0, -4, 7, -3])]
_VALUES, _SLOPES, _BENDS = ([shape.deriv(order) if order else shape for shape in _SHAPES] for order in range(3))


@cache
def _sampled(samples: int) -> tuple[Array, Array, Array]:
    """S (samples,), and slopes and bends (3, samples) of the shapes there."""
    s = np.linspace(0.0, 1.0, samples)
    return s, np.array([shape(s) for shape in _SLOPES]), np.array([shape(s) for shape in _BENDS])


@dataclass(frozen=True)
class Leg:
    """A path of one piece from a pose at rest to a pose at rest, wheels straight at both.

    Attributes:
        start: (x, y, heading) of the rear axle's middle [m, m, rad].
        goal: the same.
        chart: direction of the axes in which it is y(x) [rad].
    """

    start: Float[Array, " 3"]
    goal: Float[Array, " 3"]
    chart: float

    @property
    def length(self) -> float:
        """Along the path [m]."""
        dx, factors = self._coefficients()
        s, slopes, _ = _sampled(FINE)
        return float(abs(dx) * np.trapezoid(np.sqrt(1 + (factors @ slopes / dx) ** 2), s))

    def _coefficients(self) -> tuple[float, Array]:
        """Extent in x, and factors (3,) of the shapes."""
        dx, dy, slopes = _in_chart(self.start, self.goal, np.array(self.chart))
        return float(dx), np.array([dy, dx * slopes[0], dx * slopes[1]])

    def drive(self, duration: float, wheelbase: float, samples: int) -> tuple[Array, Array, Array, Array]:
        """The leg driven by a minimum-jerk motion along the chart's x.

        Args:
            duration: [s].
            wheelbase: rear to front axle [m].
            samples: at equal times.

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
        # The start's heading is kept as it is given, not modulo a turn.
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
    """Costs (n,) and charts (n,) of the best legs between pairs of poses; infinite cost where there is none.

    The cost is ``integral of 1 + (radius curvature)^2 along the leg``: its length, and more where it bends. The
    shortest leg alone would turn as sharply as it may at both ends.

    Args:
        starts: poses.
        goals: poses.
        radius: smallest that the car can turn at [m].
        forward_only: whether legs that back up do not count.
        samples: places on a leg at which it is checked; with few of them sharp bends escape.
    """
    s, slopes, bends = _sampled(samples)
    turn = wrapped(goals[:, 2] - starts[:, 2])
    room = _STEEPEST - np.abs(turn) / 2
    costs, charts = np.full(len(starts), np.inf), np.zeros(len(starts))
    for offset in _OFFSETS:
        chart = starts[:, 2] + turn / 2 + offset * room
        dx, dy, (first, last) = _in_chart(starts, goals, chart)
        # Else the headings at its ends are outside the chart, or there is nothing to drive along.
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
