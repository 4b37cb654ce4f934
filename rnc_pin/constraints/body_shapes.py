"""Smooth convex surfaces of rolling bodies: the surface point with a given outward normal, and its rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

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

    def level(self, point: np.ndarray) -> np.ndarray:
        """Half the difference of squared distance and squared radius, over the radius, at each point (..., 3) [m]."""
        return np.asarray(0.5 * ((point * point).sum(axis=-1) / self.radius - self.radius))

    def gradient(self, point: np.ndarray) -> np.ndarray:
        """Gradient (..., 3) of ``level`` at each point (..., 3)."""
        return np.asarray(point / self.radius)

    def hessian(self, point: np.ndarray) -> np.ndarray:
        """Second derivatives (..., 3, 3) of ``level`` at each point (..., 3)."""
        return np.broadcast_to(_EYE / self.radius, (*point.shape[:-1], 3, 3))


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

    @property
    def _form(self) -> np.ndarray:
        """Diagonal (3,) of the second derivatives of ``level``."""
        return np.asarray(np.min(self.semi_axes) / np.square(self.semi_axes))

    def level(self, point: np.ndarray) -> np.ndarray:
        """Half of ``sum (x / a)^2 - 1``, times the smallest semi-axis, at each point (..., 3) [m]."""
        return np.asarray(0.5 * ((point * point * self._form).sum(axis=-1) - np.min(self.semi_axes)))

    def gradient(self, point: np.ndarray) -> np.ndarray:
        """Gradient (..., 3) of ``level`` at each point (..., 3)."""
        return np.asarray(point * self._form)

    def hessian(self, point: np.ndarray) -> np.ndarray:
        """Second derivatives (..., 3, 3) of ``level`` at each point (..., 3)."""
        return np.broadcast_to(np.diag(self._form), (*point.shape[:-1], 3, 3))


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

    def _section(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Unit vector (..., 3) across the axis, distance (..., 1) from the axis, and vector from the middle circle."""
        radial = self._across * point
        distance = _dot(radial, radial) ** 0.5
        across = radial / distance
        return across, distance, point - self.radius * across

    def level(self, point: np.ndarray) -> np.ndarray:
        """Distance (...) of each point (..., 3) from the tube [m]."""
        away = self._section(point)[2]
        return np.asarray((_dot(away, away) ** 0.5)[..., 0] - self.tube)

    def gradient(self, point: np.ndarray) -> np.ndarray:
        """Gradient (..., 3) of ``level`` at each point (..., 3)."""
        away = self._section(point)[2]
        return np.asarray(away / _dot(away, away) ** 0.5)

    def hessian(self, point: np.ndarray) -> np.ndarray:
        """Second derivatives (..., 3, 3) of ``level`` at each point (..., 3)."""
        across, distance, away = self._section(point)
        length = _dot(away, away) ** 0.5
        normal, axis = away / length, _EYE[axis_index(self.axis)]
        around = np.cross(axis, across)
        bent = (_EYE - _square(normal) - _square(around)) / length[..., None]
        return np.asarray(bent + (_dot(away, across) / (length * distance))[..., None] * _square(around))


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


def _square(vector: np.ndarray) -> np.ndarray:
    """Product (..., 3, 3) of a vector and itself."""
    return np.asarray(vector[..., :, None] * vector[..., None, :])


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product (..., 1) without conjugation."""
    return np.asarray((a * b).sum(axis=-1, keepdims=True))


def check_positive(what: str, value: float) -> None:
    """Raise a ``ConstraintError`` for a length [m] that is not positive."""
    if not (is_number(value) and value > 0):
        raise ConstraintError(f"{what} has to be positive [m], found {value!r}")


def grid_triangles(rows: int, columns: int) -> np.ndarray:
    """Triangles (m, 3) of a grid of vertices that is stored by rows."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    return np.concatenate(
        [
            np.stack([first, first + 1, first + columns], 1),
            np.stack([first + 1, first + columns + 1, first + columns], 1),
        ]
    )


class Apex:
    """Single point, the apex of a cone."""

    def point(self, normal: np.ndarray) -> np.ndarray:
        """Zeros (..., 3)."""
        return np.zeros_like(normal)

    def point_rate(self, normal: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Zeros (..., 3)."""
        return np.zeros_like(rate)

    def regularity(self, normal: np.ndarray) -> np.ndarray:
        """One: every normal has one point."""
        return np.ones(normal.shape[:-1])


class LineEnd(NamedTuple):
    """End of the line along which a body touches a plane."""

    shape: BodyShape
    offset: np.ndarray
    """Centre of the shape, in the axes of the body's shape (3,) [m]."""


@dataclass(frozen=True)
class Cylinder:
    """Cylinder on its side, e.g. a roller. It touches a plane along a line, so it rolls straight.

    On its rim it is a ``Torus`` with ``tube=0``.

    Args:
        radius: radius [m].
        length: length along the axis, centred at the shape's origin [m].
        axis: the body's axis about which it is round, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> roller = rnc.RollingBody("ball", rnc.Cylinder(0.2, length=0.5, axis="y"))
        >>> rnc.NonholonomicSystem(robot, [roller]).r
        1
    """

    radius: Positive
    length: Positive
    axis: Axis = "z"

    def __post_init__(self) -> None:
        check_positive("radius of a cylinder", self.radius)
        check_positive("length of a cylinder", self.length)
        axis_index(self.axis)

    def ends(self) -> tuple[LineEnd, LineEnd]:
        """Both rims."""
        rim, half = Torus(self.radius, axis=self.axis), 0.5 * self.length * np.eye(3)[axis_index(self.axis)]
        return LineEnd(rim, -half), LineEnd(rim, half)


@dataclass(frozen=True)
class Cone:
    """Cone on its side. It touches a plane along a line, so it rolls about its apex.

    On its rim alone it is a ``Torus`` with ``tube=0``.

    Args:
        radius: radius of the base [m].
        height: distance of the apex from the base [m]. The shape's origin is the centre of the base, and the apex is
            in the positive direction of the axis.
        axis: the body's axis about which it is round, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> cone = rnc.RollingBody("ball", rnc.Cone(0.1, height=0.3))
        >>> rnc.NonholonomicSystem(robot, [cone]).r
        1
    """

    radius: Positive
    height: Positive
    axis: Axis = "z"

    def __post_init__(self) -> None:
        check_positive("radius of a cone", self.radius)
        check_positive("height of a cone", self.height)
        axis_index(self.axis)

    def ends(self) -> tuple[LineEnd, LineEnd]:
        """Rim and apex."""
        along = self.height * np.eye(3)[axis_index(self.axis)]
        return LineEnd(Torus(self.radius, axis=self.axis), np.zeros(3)), LineEnd(Apex(), along)
