"""Smooth convex surfaces of rolling bodies: the surface point with a given outward normal, and its rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.model.frame_rows import axis_index
from rnc_pin.model.parameter_types import Axis, NotNegative, Positive, Vector, is_number

_EYE = np.eye(3)


class BodyShape(Protocol):
    """Smooth convex surface in the axes of its body, described by its support function.

    Formulas take complex numbers too, without conjugation, for derivatives by the complex step.
    """

    def point(self, normal: np.ndarray) -> np.ndarray:
        """Surface point (..., 3) [m] with the outward unit normal (..., 3)."""

    def point_rate(self, normal: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Rate of ``point`` (..., 3) for a rate of the normal (..., 3)."""

    def regularity(self, normal: np.ndarray) -> np.ndarray:
        """Number (...) that tends to zero where ``point`` is not unique, e.g. the horizontal part of a disk's axle."""


@dataclass(frozen=True)
class Sphere:
    """Ball.

    Args:
        radius: radius [m].

    Example:
        >>> rnc.Sphere(0.2).point(np.array([0.0, 0.0, -1.0]))
        array([ 0. ,  0. , -0.2])
    """

    radius: Positive

    def __post_init__(self) -> None:
        check_positive("radius of a sphere", self.radius)

    def point(self, normal: np.ndarray) -> np.ndarray:
        """Surface point (..., 3) [m] with the outward unit normal (..., 3)."""
        return self.radius * normal

    def point_rate(self, normal: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Rate of ``point`` (..., 3) for a rate of the normal (..., 3)."""
        return self.radius * rate

    def regularity(self, normal: np.ndarray) -> np.ndarray:
        """One: every normal has one point."""
        return np.ones(normal.shape[:-1])


@dataclass(frozen=True)
class Ellipsoid:
    """Ellipsoid with its axes along those of the body, e.g. of a rattleback.

    Args:
        semi_axes: semi-axes along x, y and z [m].

    Example:
        >>> rnc.Ellipsoid((0.2, 0.03, 0.02)).point(np.array([0.0, 0.0, -1.0]))
        array([ 0.  ,  0.  , -0.02])
    """

    semi_axes: Vector

    def __post_init__(self) -> None:
        if np.shape(self.semi_axes) != (3,):
            raise ConstraintError(f"semi-axes of an ellipsoid: expected three numbers, found {self.semi_axes}")
        for each in self.semi_axes:
            check_positive("semi-axis of an ellipsoid", each)

    def point(self, normal: np.ndarray) -> np.ndarray:
        """Surface point (..., 3) [m] with the outward unit normal (..., 3)."""
        return support_point(normal, np.square(self.semi_axes))

    def point_rate(self, normal: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Rate of ``point`` (..., 3) for a rate of the normal (..., 3)."""
        return _support_rate(normal, rate, np.square(self.semi_axes))

    def regularity(self, normal: np.ndarray) -> np.ndarray:
        """One: every normal has one point."""
        return np.ones(normal.shape[:-1])


@dataclass(frozen=True)
class Torus:
    """Outer half of a torus: a wheel with a round tyre, or with ``tube=0`` the rim of a disk, cylinder, cone or cup.

    Args:
        radius: radius of the circle at the middle of the tube [m].
        tube: radius of the tube [m].
        axis: the body's axis about which the torus is round, "x", "y" or "z".

    Example:
        >>> rnc.Torus(0.3, 0.02, axis="y").point(np.array([0.0, 0.0, -1.0]))
        array([ 0.  ,  0.  , -0.32])
    """

    radius: Positive
    tube: NotNegative = 0.0
    axis: Axis = "z"

    def __post_init__(self) -> None:
        check_positive("radius of a torus", self.radius)
        if not (is_number(self.tube) and self.tube >= 0):
            raise ConstraintError(f"tube of a torus has to be zero or positive [m], found {self.tube!r}")
        axis_index(self.axis)

    @property
    def _across(self) -> np.ndarray:
        """Ones for the axes across that of the torus, (3,)."""
        return 1.0 - _EYE[axis_index(self.axis)]

    def point(self, normal: np.ndarray) -> np.ndarray:
        """Surface point (..., 3) [m] with the outward unit normal (..., 3)."""
        return support_point(normal, self._across, self.radius, self.tube)

    def point_rate(self, normal: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Rate of ``point`` (..., 3) for a rate of the normal (..., 3)."""
        return _support_rate(normal, rate, self._across, self.radius, self.tube)

    def regularity(self, normal: np.ndarray) -> np.ndarray:
        """Part of the normal across the axis; zero where the torus lies flat."""
        return np.linalg.norm(self._across * normal, axis=-1)


def support_point(normal: np.ndarray, S: np.ndarray, scale: float = 1.0, tube: float = 0.0) -> np.ndarray:
    """Surface point (..., 3) with the outward unit normal d (..., 3): gradient of ``scale sqrt(d . S d) + tube |d|``.

    Args:
        normal: the normal.
        S: diagonal (3,): squares of the semi-axes of an ellipsoid, or ones for the axes across that of a torus.
        scale: radius of a torus [m].
        tube: radius of its tube [m].
    """
    return np.asarray(scale * (S * normal) / _dot(S * normal, normal) ** 0.5 + tube * normal)


def _support_rate(
    normal: np.ndarray, rate: np.ndarray, S: np.ndarray, scale: float = 1.0, tube: float = 0.0
) -> np.ndarray:
    """Rate of ``support_point`` (..., 3) for a rate of the normal (..., 3)."""
    length = _dot(S * normal, normal) ** 0.5
    unit = S * normal / length
    return np.asarray(scale * (S * rate - unit * _dot(unit, rate)) / length + tube * rate)


def support_numbers(shape: BodyShape) -> list[float] | None:
    """Numbers (5,) of ``support_point`` for the compiled kernel; None for a shape of the user."""
    if type(shape) is Sphere:
        return [float(shape.radius) ** 2] * 3 + [1.0, 0.0]
    if type(shape) is Ellipsoid:
        return [*np.square(np.asarray(shape.semi_axes, dtype=float)).tolist(), 1.0, 0.0]
    if type(shape) is Torus:
        return [*shape._across.tolist(), float(shape.radius), float(shape.tube)]
    return None


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product (..., 1) without conjugation."""
    return np.asarray((a * b).sum(axis=-1, keepdims=True))


def check_positive(what: str, value: float) -> None:
    """Raise a ``ConstraintError`` for a length [m] that is not positive."""
    if not (is_number(value) and value > 0):
        raise ConstraintError(f"{what} has to be positive [m], found {value!r}")
