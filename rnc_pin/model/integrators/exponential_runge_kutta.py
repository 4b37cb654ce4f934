"""Exponential Runge-Kutta on the configuration manifold: matrix exponentials integrate damping of any size."""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.model.integrators.runge_kutta import ExponentialCoordinates, Rate, check_reach
from rnc_pin.robots.robot import Robot

_SERIES_BELOW = 1.0  # below it the recurrence of the phi functions loses digits by cancellation
_TERMS = 18
_SERIES = [[1.0 / factorial(k + last) for k in reversed(range(_TERMS))] for last in range(5)]


class LinearPart(NamedTuple):
    """Linear part L of the motion, frozen during a step: decay of the velocities w, and the states that they drive.

    Attributes:
        modes: (r, r), ``w = modes @ a``; kinetic energy is ``|a|^2 / 2`` at the start of the step.
        inverse: (r, r), ``a = inverse @ w``.
        decay: decay rates (r,) [1/s], not negative: ``adot = -decay a`` plus nonlinear terms.
        u: (nv, r), rate of the configuration's coordinates per mode.
        others: (s, r), rate of the other integrals per mode.
    """

    modes: np.ndarray
    inverse: np.ndarray
    decay: np.ndarray
    u: np.ndarray
    others: np.ndarray


class ExponentialRungeKutta4:
    """Method ETD4RK (Cox and Matthews 2002, eq. 26 to 29) in the coordinates ``q = q0 (+) u`` of one step.

    The state is (u, y) with ``y = [w, others]``, ``zdot = L z + N(z)``. L is frozen at the start of the step.
    L contains the damping, so damping does not limit the step size. For a constant L, motion under constant forces is
    exact, including the steady speed. Otherwise the order is four while ``decay h`` is moderate.

    Args:
        robot: robot of the configurations.

    Example:
        >>> from rnc_pin.model.integrators import ExponentialRungeKutta4, LinearPart
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> along, one = np.array([[1.0], [0.0], [0.0]]), np.eye(1)
        >>> damped = LinearPart(one, one, decay=np.array([100.0]), u=along, others=np.zeros((0, 1)))
        >>> rate = lambda q, y: (along @ y, 200.0 - 100.0 * y)
        >>> integrator = ExponentialRungeKutta4(robot)
        >>> q, y, roughness = integrator.step(rate, damped, robot.configuration(), y=np.zeros(1), h=1.0)
        >>> y.round(6), q[:1].round(6)  # steady speed 2 m/s after 1/100 s
        (array([2.]), array([1.98]))
    """

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model
        self._coordinates = ExponentialCoordinates(robot)

    def step(
        self, rate: Rate, linear: LinearPart, q: np.ndarray, y: np.ndarray, h: float
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the state after a time h, and the roughness of the step as ``LieRungeKutta4.measured_step``.

        Args:
            rate: ``rate(q, y) -> (v, ydot)``.
            linear: linear part at (q, y).
            q: configuration (nq,).
            y: velocities w (r,), then all other states (s,), in a linear space.
            h: step [s].

        Raises:
            DivergenceError: the step is longer than the chart.
        """
        n, r = len(linear.u), len(linear.decay)
        follow = np.vstack([linear.u, linear.others])
        half, whole = phi_functions(-0.5 * h * linear.decay, 2), phi_functions(-h * linear.decay, 4)

        def slope(x: np.ndarray) -> np.ndarray:
            u, a = x[:n], x[n : n + r]
            check_reach(u, h)
            y_at = np.concatenate([linear.modes @ a, x[n + r :]])
            u_dot, y_dot = self._coordinates.derivative(rate, q, u, y_at)
            return np.concatenate([u_dot, linear.inverse @ y_dot[:r], y_dot[r:]])

        def linear_slope(x: np.ndarray) -> np.ndarray:
            a = x[n : n + r]
            following = follow @ a
            return np.concatenate([following[:n], -linear.decay * a, following[n:]])

        def phi(k: int, values: list[np.ndarray], time: float, x: np.ndarray) -> np.ndarray:
            """``time phi_k(time L) x``."""
            a = x[n : n + r]
            others = np.concatenate([x[:n], x[n + r :]]) / factorial(k) + time * (follow @ (values[k + 1] * a))
            return time * np.concatenate([others[:n], values[k] * a, others[n:]])

        start = np.concatenate([np.zeros(n), linear.inverse @ y[:r], y[r:]])
        first, flows = slope(start), linear_slope(start)
        N = first - flows
        at_a = start + phi(1, half, 0.5 * h, first)
        N_a = slope(at_a) - linear_slope(at_a)
        at_b = start + phi(1, half, 0.5 * h, flows + N_a)
        N_b = slope(at_b) - linear_slope(at_b)
        at_c = at_a + phi(1, half, 0.5 * h, linear_slope(at_a) + 2.0 * N_b - N)
        N_c = slope(at_c) - linear_slope(at_c)
        end = (
            start
            + phi(1, whole, h, first)
            + phi(2, whole, h, 2.0 * (N_a + N_b) - 3.0 * N - N_c)
            + phi(3, whole, h, 4.0 * (N - N_a - N_b + N_c))
        )
        check_reach(end[:n], h)
        y = np.concatenate([linear.modes @ end[n : n + r], end[n + r :]])
        uneven, bent = (np.abs(each[: n + r]).max(initial=0.0) for each in (N_b - N_a, N - N_a - N_b + N_c))
        return pin.integrate(self._model, q, end[:n]), y, h * float(max(uneven, bent))


def phi_functions(x: np.ndarray, last: int) -> list[np.ndarray]:
    """Functions ``phi_0(x) = exp(x)``, ``phi_k+1(x) = (phi_k(x) - 1/k!) / x`` up to ``last``, for x <= 0.

    Near zero the upward recurrence loses digits by cancellation. There a series gives the last function, and the
    downward recurrence gives the others.
    """
    if not x.any():
        return [np.full_like(x, 1.0 / factorial(k)) for k in range(last + 1)]
    far = x < -_SERIES_BELOW
    near = np.where(far, 0.0, x)
    series = np.zeros_like(x)
    for coefficient in _SERIES[last]:
        series = series * near + coefficient
    values = [series]
    for k in reversed(range(last)):
        values.insert(0, near * values[0] + 1.0 / factorial(k))
    if far.any():
        values[0] = np.where(far, np.exp(x), values[0])
        divisor = np.where(far, x, 1.0)
        for k in range(last):
            values[k + 1] = np.where(far, (values[k] - 1.0 / factorial(k)) / divisor, values[k + 1])
    return values
