"""Exponential coordinates ``q = q0 (+) u`` about a configuration, and their rates."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import cache
from math import factorial

import numpy as np
import pinocchio as pin

from rnc_pin.errors import DivergenceError
from rnc_pin.robots.robot import Robot

Rate = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

_FARTHEST = 100.0**2  # square of the longest valid step [rad or m]
_SERIES_BELOW = 1.0  # [rad]: below it the closed forms lose digits by cancellation; the series converges within 2 pi
_TERMS = np.arange(1, 15)


class ExponentialCoordinates:
    """Exponential coordinates of a robot's configurations, joint by joint.

    With v the velocity at ``q0 (+) u`` in the joint's local frame, ``udot = J(u)^-1 v``, J the right Jacobian of the
    exponential. For SE(2), SO(3) and SE(3) alike, ``J^-1 = I + ad/2 + a ad^2 + b ad^4``, with a and b functions of the
    angle of u (Bullo and Murray 1995). Pinocchio's ``dIntegrate`` is not used: in 4.1 its error is 4e-7 for a
    free-flyer that translates while it rotates by 1e-4 rad.

    Args:
        robot: robot of the configurations.

    Example:
        >>> from rnc_pin.model.integrators import ExponentialCoordinates
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> coordinates = ExponentialCoordinates(robot)
        >>> along = np.array([1.0, 0.0, 1.0])
        >>> coordinates.rate(robot.configuration(), 0.3 * along, along).round(6)  # on a circle u = t v
        array([1., 0., 1.])
    """

    def __init__(self, robot: Robot) -> None:
        self._curved: list[tuple[slice, Callable[[np.ndarray], tuple[np.ndarray, float]]]] = []
        self._model = robot.model
        self._others = False
        for joint in list(robot.model.joints)[1:]:
            adjoint = _ADJOINTS.get(joint.shortname())
            if adjoint is not None:
                self._curved.append((slice(joint.idx_v, joint.idx_v + joint.nv), adjoint))
            elif joint.nv > 1 and joint.shortname() != "JointModelTranslation":
                self._others = True

    def derivative(self, rate: Rate, q: np.ndarray, u: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ``(udot, ydot)`` at ``q (+) u`` of a motion ``rate(q, y) -> (v, ydot)``."""
        v, y_dot = rate(pin.integrate(self._model, q, u), y)
        return self.rate(q, u, v), y_dot

    def rate(self, q: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """``udot`` (nv,) at ``q (+) u``."""
        if self._others:  # a joint type that robot files do not have: use Pinocchio's own derivative
            return np.linalg.solve(pin.dIntegrate(self._model, q, u, pin.ArgumentPosition.ARG1), v)
        if not self._curved:
            return v
        rate = v.copy()
        for where, adjoint in self._curved:
            ad, angle = adjoint(u[where])
            a, b = _coefficients(angle)
            once = ad.dot(v[where])
            twice = ad.dot(once)
            rate[where] += 0.5 * once + a * twice + b * ad.dot(ad.dot(twice))
        return rate


def check_reach(u: np.ndarray, h: float) -> None:
    """Raise an error if a step is longer than the chart.

    Args:
        u: coordinates (nv,) at the end of the step [rad or m].
        h: duration of the step [s].

    Raises:
        DivergenceError: the step is too long or not finite.
    """
    if not u.dot(u) < _FARTHEST:  # also false for infinity and NaN
        moved, limit = np.sqrt(u.dot(u)), np.sqrt(_FARTHEST)
        raise DivergenceError(
            f"one step of {h:g} s would move by {moved:.3g} rad or m, limit {limit:g}: reduce the step"
        )


def _coefficients(angle: float) -> tuple[float, float]:
    square = angle * angle
    if angle < _SERIES_BELOW:
        powers = square ** (_TERMS - 1)
        second, fourth = _series()
        return float(second.dot(powers)), float(fourth.dot(powers[:-1]))
    half = 0.5 * angle
    alpha, beta = half / np.tan(half), (half / np.sin(half)) ** 2
    return (2 * (1 - alpha) + 0.5 * (alpha - beta)) / square, ((1 - alpha) + 0.5 * (alpha - beta)) / square**2


@cache
def _series() -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of the series of a and b in the square of the angle."""
    scaled = [Fraction(1)]  # B_n / n! of the Bernoulli numbers: the series x / (exp(x) - 1); scipy.special loads slowly
    for n in range(1, 2 * len(_TERMS) + 1):
        scaled.append(-sum((each / factorial(n + 1 - k) for k, each in enumerate(scaled)), Fraction(0)))
    bernoulli = np.abs(np.array(scaled[2::2], dtype=float))
    return (2 - _TERMS) * bernoulli, ((1 - _TERMS) * bernoulli)[1:]


def _planar(u: np.ndarray) -> tuple[np.ndarray, float]:
    x, y, turn = u
    return np.array([[0.0, -turn, y], [turn, 0.0, -x], [0.0, 0.0, 0.0]]), abs(turn)


def _spherical(u: np.ndarray) -> tuple[np.ndarray, float]:
    return pin.skew(u), float(np.sqrt(u.dot(u)))


def _free(u: np.ndarray) -> tuple[np.ndarray, float]:
    ad = np.zeros((6, 6))
    ad[:3, :3] = ad[3:, 3:] = pin.skew(u[3:])
    ad[:3, 3:] = pin.skew(u[:3])
    return ad, float(np.sqrt(u[3:].dot(u[3:])))


_ADJOINTS = {"JointModelPlanar": _planar, "JointModelSpherical": _spherical, "JointModelFreeFlyer": _free}
