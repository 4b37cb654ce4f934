"""Fourth-order Runge-Kutta on the configuration manifold."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.integrators.exponential_coordinates import ExponentialCoordinates, Rate, check_reach
from rnc_pin.robots.robot import Robot


class LieRungeKutta4:
    """Classical Runge-Kutta method in the coordinates ``q = q0 (+) u`` of one step (Munthe-Kaas 1999).

    The rates of the coordinates use the exact right Jacobian of the exponential (``ExponentialCoordinates``). So the
    order is four for planar, spherical and free-flying joints too, and quaternions keep unit length.

    Args:
        robot: robot of the configurations.

    Example:
        >>> from rnc_pin.integrators import LieRungeKutta4
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> integrator = LieRungeKutta4(robot)
        >>> circle = lambda q, y: (np.array([1.0, 0.0, 1.0]), -y)
        >>> q, y = integrator.step(circle, robot.configuration(), y=np.ones(1), h=0.1)
        >>> q.round(6)  # x = sin h, y = 1 - cos h
        array([0.099833, 0.004996, 0.995004, 0.099833])
        >>> y.round(5)  # exp(-h)
        array([0.90484])
    """

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model
        self._coordinates = ExponentialCoordinates(robot)

    def step(
        self, rate: Rate, q: np.ndarray, y: np.ndarray, h: float, first: tuple[np.ndarray, np.ndarray] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the state after a time h.

        Args:
            rate: ``rate(q, y) -> (v, ydot)``.
            q: configuration (nq,).
            y: all other states, in a linear space.
            h: step [s].
            first: rate at (q, y), if already known.

        Raises:
            DivergenceError: the step is longer than the chart.
        """
        slope, y_slope = rate(q, y) if first is None else first
        u_sum, y_sum = slope, y_slope
        for fraction, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            u = (fraction * h) * slope
            check_reach(u, h)
            slope, y_slope = self._coordinates.derivative(rate, q, u, y + (fraction * h) * y_slope)
            u_sum = u_sum + weight * slope
            y_sum = y_sum + weight * y_slope
        return pin.integrate(self._model, q, (h / 6) * u_sum), y + (h / 6) * y_sum
