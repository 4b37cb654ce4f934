"""Fourth-order Runge-Kutta on the configuration manifold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from rnc_pin.errors import DivergenceError
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation.exponential import ExponentialCoordinates

Rate = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

_FARTHEST = 100.0**2  # square of a step [rad or m] that no motion takes


class LieRungeKutta4:
    """The classical method in the coordinates ``q = q0 (+) u`` of one step (Munthe-Kaas 1999).

    The coordinates move by the exact right Jacobian of the exponential (``ExponentialCoordinates``), so planar,
    spherical and free-flying joints keep the order four, and quaternions their length.

    Args:
        robot: whose configurations they are.
    """

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model
        self._coordinates = ExponentialCoordinates(robot)

    def step(
        self, rate: Rate, q: np.ndarray, y: np.ndarray, h: float, first: tuple[np.ndarray, np.ndarray] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """State after a time h.

        Args:
            rate: ``rate(q, y) -> (v, ydot)``.
            q: configuration (nq,).
            y: everything else that moves, in a linear space.
            h: step [s].
            first: the rate at (q, y), where it is known already.

        Raises:
            DivergenceError: a step that goes farther than any chart reaches.
        """
        slope, y_slope = rate(q, y) if first is None else first
        u_sum, y_sum = slope, y_slope
        for fraction, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            u = (fraction * h) * slope
            check_reach(u, h)
            v, y_slope = rate(pin.integrate(self._model, q, u), y + (fraction * h) * y_slope)
            slope = self._coordinates.rate(q, u, v)
            u_sum = u_sum + weight * slope
            y_sum = y_sum + weight * y_slope
        return pin.integrate(self._model, q, (h / 6) * u_sum), y + (h / 6) * y_sum


def check_reach(u: np.ndarray, h: float) -> None:
    """Refuse a step that goes farther than any chart reaches.

    Args:
        u: coordinates that it leads to (nv,) [rad or m].
        h: its duration [s].

    Raises:
        DivergenceError: it goes too far, or is not finite.
    """
    if not u.dot(u) < _FARTHEST:  # nor is infinity or NaN
        raise DivergenceError(f"one step of {h:g} s would move by {np.sqrt(u.dot(u)):.3g} rad or m")
