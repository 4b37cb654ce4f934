"""Point stabilisation of chained systems, and of a unicycle as one.

A. Astolfi, "Discontinuous control of nonholonomic systems", Systems & Control Letters 27 (1996) 37-45:
for ``x1dot = u1, x2dot = u2, x3dot = x2 u1, ..., xndot = x(n-1) u1`` the coordinates ``z_i = x_i / x1^(i-2)``
are linear under ``u1 = -k x1``, so that a linear law places their poles and everything converges exponentially
from wherever x1 is not zero.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.signal import place_poles

from rnc_pin.control.protocol import Description, VelocityTarget, listed
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.measurement import Measurement
from rnc_pin.printing import Spelled


class ChainedStabilizer(Spelled):
    """``u1 = -k x1``, ``u2 = -P z`` with poles of z placed at -rate, -1.1 rate, -1.2 rate, ...

    Args:
        n: length of the chain, at least 3.
        k: rate at which x1 fades [1/s].
        rate: at which z fades [1/s]; above k, so that z is gone before x1 is.
    """

    def __init__(self, n: int, k: float = 0.5, rate: float = 1.5) -> None:
        if n < 3 or not 0 < k < rate:
            raise ConfigurationError(f"a chained stabiliser needs n >= 3 and 0 < k < rate, found {n}, {k:g}, {rate:g}")
        self.n, self.k, self.rate = n, k, rate
        size = n - 1
        A = np.diag(k * np.arange(size, dtype=float)) - np.diag(np.full(size - 1, k), -1)
        poles = -rate * (1.0 + 0.1 * np.arange(size))
        self.P = place_poles(A, np.eye(size)[:, :1], poles).gain_matrix[0]

    def describe(self) -> Description:
        """Its rates."""
        return {
            "type": type(self).__name__,
            "n": self.n,
            "k": self.k,
            "rate": self.rate,
        }

    def command(self, x: np.ndarray) -> np.ndarray:
        """(u1, u2) at a chained state x (n,) with x1 not zero."""
        return np.array([-self.k * x[0], -self.P @ self.coordinates(x)])

    def coordinates(self, x: np.ndarray) -> np.ndarray:
        """``z_i = x_i / x1^(i-2)`` for i = 2..n, (n - 1,)."""
        return x[1:] / x[0] ** np.arange(self.n - 1)

    def command_rate(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Rate of the command while the chain moves under u."""
        powers = x[0] ** np.arange(self.n - 1)
        x_dot = np.concatenate([[u[1]], x[1:-1] * u[0]])  # of x2, x3, ..., xn
        z_dot = x_dot / powers - np.arange(self.n - 1) * x[1:] / powers * (u[0] / x[0])
        return np.array([-self.k * u[0], -self.P @ z_dot])


class Waiting(NamedTuple):
    """Whether the goal was reached, after which the vehicle rests."""

    arrived: bool


class UnicycleStabilizer(Spelled):
    """Drives a unicycle (forward speed, yaw) to a pose: the chain (x, tan heading, y) in the goal's axes.

    It rests until ``begin``. The chart holds for headings within 90 degrees of the goal's; outside, or abeam of the
    goal, it refuses, because no law in these coordinates can help there. Close to the goal it rests.

    Reads from the measurement: ``x1`` (positions), ``x2`` (of speed and yaw), ``v2``.

    Args:
        goal: (x, y, heading) [m, m, rad].
        position: where in x1 the vehicle's x and y stand.
        begin: time at which it starts [s].
        k, rate: of the chained stabiliser [1/s].
        close: distance at which it rests [m].
        soft: time over which it takes up speed [s].
    """

    def __init__(
        self,
        goal: np.ndarray,
        position: np.ndarray,
        begin: float = 0.0,
        k: float = 0.5,
        rate: float = 1.5,
        close: float = 2e-3,
        soft: float = 1.0,
    ) -> None:
        self.goal, self.position = np.asarray(goal, dtype=float), np.asarray(position, dtype=int)
        self.begin, self.close, self.soft = begin, close, soft
        self.chain = ChainedStabilizer(3, k, rate)

    def describe(self) -> Description:
        """Where it drives, from when, and how fast."""
        return {
            "type": type(self).__name__,
            "goal": listed(self.goal),
            "begin": self.begin,
            "k": self.chain.k,
            "rate": self.chain.rate,
            "close": self.close,
            "soft": self.soft,
        }

    def initial_state(self, measurement: Measurement) -> Waiting:
        """Not there yet.

        Raises:
            ConfigurationError: the goal cannot be reached from here in these coordinates.
        """
        x, heading = self._chained(measurement)
        if np.cos(heading) < 0.1 or abs(x[0]) < 0.2 * abs(x[2]) or abs(x[0]) < self.close:
            raise ConfigurationError(
                f"the platform's goal is {-x[0]:.3g} m ahead and {-x[2]:.3g} m abeam at {np.rad2deg(-heading):.0f} "
                "degrees: it has to lie ahead or behind, with headings within 84 degrees"
            )
        return Waiting(False)

    def _chained(self, measurement: Measurement) -> tuple[np.ndarray, float]:
        dx, dy = measurement.x1[self.position] - self.goal[:2]
        c, s = np.cos(self.goal[2]), np.sin(self.goal[2])
        heading = measurement.x2[1] - self.goal[2]
        return np.array([c * dx + s * dy, np.tan(heading), c * dy - s * dx]), float(heading)

    def step(self, t: float, measurement: Measurement, state: Waiting) -> tuple[VelocityTarget, Waiting]:
        x, heading = self._chained(measurement)
        arrived = state.arrived or (t >= self.begin and abs(x[0]) < self.close)
        x1 = np.full(measurement.x1.shape, np.nan)
        x1[self.position] = self.goal[:2]
        still, x2 = np.zeros(2), np.array([np.nan, self.goal[2]])
        if arrived or t < self.begin:
            return VelocityTarget(v2=still, v2_dot=still, x1=x1, x2=x2), Waiting(arrived)
        u = self.chain.command(x)
        cosine, sine, turn = np.cos(heading), np.sin(heading), measurement.v2[1]
        moving = np.array([measurement.v2[0] * cosine, turn / cosine**2])
        u_dot = self.chain.command_rate(x, moving)
        v2 = np.array([u[0] / cosine, u[1] * cosine**2])
        v2_dot = np.array(
            [
                u_dot[0] / cosine + u[0] * sine * turn / cosine**2,
                u_dot[1] * cosine**2 - 2 * u[1] * cosine * sine * turn,
            ]
        )
        share = min(1.0, (t - self.begin) / self.soft) if self.soft > 0 else 1.0
        growth = 1.0 / self.soft if share < 1.0 else 0.0
        return VelocityTarget(v2=share * v2, v2_dot=share * v2_dot + growth * v2, x1=x1, x2=x2), Waiting(False)
