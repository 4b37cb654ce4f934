"""Fourth-order Runge-Kutta on the configuration manifold."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.model.integrators.exponential_coordinates import ExponentialCoordinates, Rate, check_reach
from rnc_pin.robots.robot import Robot

DEFAULT_TOLERANCE = 1e-7
"""Largest error that the integration adds in a second [m, rad, m/s or rad/s]."""


class LieRungeKutta4:
    """Classical Runge-Kutta method in the coordinates ``q = q0 (+) u`` of one step (Munthe-Kaas 1999).

    The rates of the coordinates use the exact right Jacobian of the exponential (``ExponentialCoordinates``). So the
    order is four for planar, spherical and free-flying joints too, and quaternions keep unit length.

    Args:
        robot: robot of the configurations.

    Example:
        >>> from rnc_pin.model.integrators import LieRungeKutta4
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
        return self.measured_step(rate, q, y, h, 0, first)[:2]

    def measured_step(
        self,
        rate: Rate,
        q: np.ndarray,
        y: np.ndarray,
        h: float,
        r: int,
        first: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the state after a time h, and the roughness of the step.

        The roughness is h times the largest of ``|k3 - k2|`` and ``|k1 - k2 - k3 + k4|`` over the slopes k of the
        configuration and of the first r of y. It is of the order h^3 where the error is of the order h^5.

        Args:
            rate, q, y, h, first: as for ``step``.
            r: number of states of y that count.

        Raises:
            DivergenceError: as ``step``.
        """
        slopes = [rate(q, y) if first is None else first]
        for fraction in (0.5, 0.5, 1.0):
            slope, y_slope = slopes[-1]
            u = (fraction * h) * slope
            check_reach(u, h)
            slopes.append(self._coordinates.derivative(rate, q, u, y + (fraction * h) * y_slope))
        u, by = (
            (h / 6) * (one + 2.0 * two + 2.0 * three + four) for one, two, three, four in zip(*slopes, strict=True)
        )
        one, two, three, four = (np.concatenate([slope, y_slope[:r]]) for slope, y_slope in slopes)
        largest = max(np.abs(three - two).max(initial=0.0), np.abs(one - two - three + four).max(initial=0.0))
        return pin.integrate(self._model, q, u), y + by, h * float(largest)
