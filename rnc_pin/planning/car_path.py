"""A flat path for a vehicle with front steering, and what its trailer should do: paper (22) and section 4.3.

(x, y) of the rear axle is a flat output of a car (Fliess, Levine, Martin and Rouchon 1995): heading, steering
angle and speed follow from it by differentiation. The chained form (22) has ``z0 = x``, ``x2 = y``,
``x1 = tan theta`` and ``x0 = tan phi / (L cos^3 theta)``, that is y' and y'' as functions of x, so a path
from pose to pose is a polynomial y(x) with three conditions at each end.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BPoly, make_interp_spline
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from rnc_pin.errors import ConfigurationError
from rnc_pin.planning.references import MinimumJerk, Reference, ViaPoints

_SAMPLES = 401
_STEEPEST = np.deg2rad(75.0)


class CarPath:
    """From pose to pose at rest, with wheels straight at both ends.

    Args:
        start: (x, y, heading) of the rear axle's middle [m, m, rad].
        goal: the same.
        duration: [s].
        wheelbase: rear to front axle [m].

    Attributes:
        reference: of (distance driven, front steering angle).
        position: of (x, y) of the rear axle.
        times: (N,) [s]; ``poses``: (N, 3) on the path.

    Raises:
        ConfigurationError: there is no such path in one piece: it would have to turn past 75 degrees from the
            x axis, or start and goal have the same x.
    """

    def __init__(self, start: np.ndarray, goal: np.ndarray, duration: float, wheelbase: float) -> None:
        (x0, y0, heading0), (x1, y1, heading1) = np.asarray(start, float), np.asarray(goal, float)
        if abs(x1 - x0) < 1e-6:
            raise ConfigurationError("start and goal of a path have the same x: go by way of another pose")
        if max(abs(heading0), abs(heading1)) > _STEEPEST:
            raise ConfigurationError("start and goal of a path have to head within 75 degrees of the x axis")
        self._sign = float(np.sign(x1 - x0))  # negative: the vehicle backs up
        ends = [[y0, np.tan(heading0), 0.0], [y1, np.tan(heading1), 0.0]]
        order = 1 if x1 > x0 else -1
        self._y = BPoly.from_derivatives([x0, x1][::order], ends[::order])
        self._dy, self._ddy = self._y.derivative(1), self._y.derivative(2)
        along = MinimumJerk([x0], [x1], duration)
        self.times = np.linspace(0.0, duration, _SAMPLES)
        x = np.array([along.at(t).position[0] for t in self.times])
        speed_x = np.array([along.at(t).velocity[0] for t in self.times])
        slope = self._dy(x)
        if np.abs(np.arctan(slope)).max() > _STEEPEST:
            raise ConfigurationError("the path from start to goal turns past 75 degrees from the x axis")
        self.poses = np.column_stack([x, self._y(x), np.arctan(slope)])
        steering = np.arctan(wheelbase * self._ddy(x) / (1 + slope**2) ** 1.5)
        speed = make_interp_spline(self.times, speed_x * np.sqrt(1 + slope**2), k=5)
        driven = speed.antiderivative()(self.times)
        self.duration = duration
        self.reference: Reference = ViaPoints(self.times, np.column_stack([driven, steering]))
        self.position: Reference = ViaPoints(self.times, self.poses[:, :2])
        self._start, self._heading = np.array([x0, y0]), heading0

    def point(self, s: float) -> np.ndarray:
        """Path by its x coordinate, (2,); before the start it goes straight on backwards."""
        if (s - self._start[0]) * self._sign < 0:
            return self._start + (s - self._start[0]) * np.array([1.0, np.tan(self._heading)])
        return np.array([s, float(self._y(s))])

    def follower(self, length: float) -> Reference:
        """Heading of a trailer whose axle stays on the path, one chord behind the kingpin: "slithering".

        Args:
            length: kingpin to axle [m].

        Raises:
            ConfigurationError: the vehicle backs up, so that the trailer would lead.
        """
        if self._sign < 0:
            raise ConfigurationError("a slithering trailer needs a path that is driven forwards")
        headings = []
        for x, y, _ in self.poses:
            kingpin = np.array([x, y])

            def gap(s: float, kingpin: np.ndarray = kingpin) -> float:
                return float(np.linalg.norm(kingpin - self.point(s)) - length)

            axle = self.point(brentq(gap, x - length - 1e-9, x, xtol=1e-13))
            headings.append(np.arctan2(*(kingpin - axle)[::-1]))
        return ViaPoints(self.times, np.unwrap(headings))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distances (N,) of points (N, 2) from the path, straight continuation included [m]."""
        low = self.poses[:, 0].min() - 3.0
        grid = np.linspace(low, self.poses[:, 0].max(), 20_001)
        path = np.array([self.point(s) for s in grid])
        return np.asarray(cKDTree(path).query(points)[0])
