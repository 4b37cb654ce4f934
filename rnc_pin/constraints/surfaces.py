"""Smooth surfaces: of rolling bodies, by the point with a given normal; of curved ground, by the zeros of a level."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rnc_pin.errors import ConfigurationError, ConstraintError, RncError
from rnc_pin.model.frame_rows import axis_index, frame_direction, triple
from rnc_pin.model.input_validation import Axis, NotNegative, Positive, Vector, is_number

_EYE = np.eye(3)
_EDGES = 48  # edges of drawn patches


# ------------------------------------------------------------------ surfaces of bodies


class BodyShape(Protocol):
    """Smooth convex surface in the axes of its body, described by its support function.

    Formulas take complex numbers too, without conjugation, for derivatives by the complex step.
    """

    def point(self, normal: np.ndarray) -> np.ndarray:
        """Surface point (..., 3) [m] with the outward unit normal (..., 3).

        Args:
            normal: outward unit normal, in the axes of the body.
        """

    def point_rate(self, normal: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Rate of ``point`` (..., 3) for a rate of the normal (..., 3).

        Args:
            normal: outward unit normal, in the axes of the body.
            rate: rate of the normal [1/s], across it.
        """

    def regularity(self, normal: np.ndarray) -> np.ndarray:
        """Number (...) that tends to zero where ``point`` is not unique, e.g. the horizontal part of a disk's axle.

        Args:
            normal: outward unit normal, in the axes of the body.
        """


class _SupportedShape(ABC):
    """Surface with the support function ``scale sqrt(d . S d) + tube |d|`` of a direction d."""

    @property
    @abstractmethod
    def support(self) -> tuple[np.ndarray, float, float]:
        """Diagonal of S (3,), scale and tube, with lengths in m."""

    def point(self, normal: np.ndarray) -> np.ndarray:
        """Surface point (..., 3) [m] with the outward unit normal (..., 3).

        Args:
            normal: outward unit normal, in the axes of the body.
        """
        return support_point(normal, *self.support)

    def point_rate(self, normal: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Rate of ``point`` (..., 3) for a rate of the normal (..., 3).

        Args:
            normal: outward unit normal, in the axes of the body.
            rate: rate of the normal [1/s], across it.
        """
        S, scale, tube = self.support
        length = scalar_product(S * normal, normal) ** 0.5
        unit = S * normal / length
        # Derivative of the unit vector S d / |S d|: what is along it does not turn it.
        return np.asarray(scale * (S * rate - unit * scalar_product(unit, rate)) / length + tube * rate)

    def regularity(self, normal: np.ndarray) -> np.ndarray:
        """One: every normal has one point.

        Args:
            normal: outward unit normal, in the axes of the body.
        """
        return np.ones(normal.shape[:-1])


@dataclass(frozen=True)
class Sphere(_SupportedShape):
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

    @property
    def support(self) -> tuple[np.ndarray, float, float]:
        """S = I, scaled by the radius."""
        return np.ones(3), self.radius, 0.0


@dataclass(frozen=True)
class Ellipsoid(_SupportedShape):
    """Ellipsoid with its axes along the axes of the body, e.g. of a rattleback.

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

    @property
    def support(self) -> tuple[np.ndarray, float, float]:
        """Squares of the semi-axes."""
        return np.square(np.asarray(self.semi_axes, dtype=float)), 1.0, 0.0


@dataclass(frozen=True)
class Torus(_SupportedShape):
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
        check_positive("tube of a torus", self.tube, or_zero=True)
        axis_index(self.axis)

    @property
    def support(self) -> tuple[np.ndarray, float, float]:
        """Ones for the axes across the axis of the torus, its radius, and that of its tube."""
        return 1.0 - _EYE[axis_index(self.axis)], self.radius, self.tube

    def regularity(self, normal: np.ndarray) -> np.ndarray:
        """Part of the normal across the axis; zero where the torus lies flat.

        Args:
            normal: outward unit normal, in the axes of the body.
        """
        return np.linalg.norm(self.support[0] * normal, axis=-1)


def support_point(normal: np.ndarray, S: np.ndarray, scale: float = 1.0, tube: float = 0.0) -> np.ndarray:
    """Surface point (..., 3) with the outward unit normal d (..., 3): gradient of ``scale sqrt(d . S d) + tube |d|``.

    Args:
        normal: the normal.
        S: diagonal (3,): squares of the semi-axes of an ellipsoid, or ones for the axes across the axis of a torus.
        scale: radius of a torus [m].
        tube: radius of its tube [m].
    """
    return np.asarray(scale * (S * normal) / scalar_product(S * normal, normal) ** 0.5 + tube * normal)


def support_numbers(shape: BodyShape) -> list[float] | None:
    """Numbers (5,) of ``support_point`` for the compiled kernel; None for a shape of the user.

    Args:
        shape: surface of a body.
    """
    # The exact type: a subclass may have methods of its own.
    if not isinstance(shape, _SupportedShape) or type(shape) not in (Sphere, Ellipsoid, Torus):
        return None
    S, scale, tube = shape.support
    return [*S.tolist(), float(scale), float(tube)]


def scalar_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the scalar product (..., 1) of vectors (..., 3), without conjugation: a factor of vectors.

    Args:
        a: vectors.
        b: vectors.
    """
    return np.asarray((a * b).sum(axis=-1, keepdims=True))


def check_positive(what: str, value: object, error: type[RncError] = ConstraintError, *, or_zero: bool = False) -> None:
    """Raise an error for a length [m] that is not positive.

    Args:
        what: the length, for the message.
        value: its value [m].
        error: kind of the error.
        or_zero: True if zero is valid too.
    """
    if not (is_number(value) and (value > 0 or (or_zero and value == 0))):
        raise error(f"{what} has to be {'zero or ' * or_zero}positive, found {value!r} [m]")


# ------------------------------------------------------------------ curved ground


class CurvedGround(Protocol):
    """Smooth surface ``level(point) = 0`` whose gradient points out of the ground, and the motion of its material.

    The functions take complex numbers too, without conjugation, for derivatives by the complex step.

    The material is a rigid body that turns and slides so that the surface stays in place. An attribute ``frame`` with
    the name of a frame says that this frame carries the surface and stands for the world.

    Example:
        >>> bowl: rnc.CurvedGround = rnc.SphericalGround(1.0)
        >>> print(bowl.level(np.array([0.0, 0.0, -0.5])), bowl.gradient(np.array([1.0, 0.0, 0.0])), bowl.moves)
        0.375 [-1.  0.  0.] False
    """

    def level(self, point: np.ndarray) -> np.ndarray:
        """Function (...) that is zero on the surface and grows outwards, at each point (..., 3) [m].

        Args:
            point: places, in world axes.
        """

    def gradient(self, point: np.ndarray) -> np.ndarray:
        """Gradient (..., 3) of ``level`` at each point (..., 3).

        Args:
            point: places, in world axes [m].
        """

    def hessian(self, point: np.ndarray) -> np.ndarray:
        """Second derivatives (..., 3, 3) of ``level`` at each point (..., 3).

        Args:
            point: places, in world axes [m].
        """

    @property
    def moves(self) -> bool:
        """True if the material of the ground moves."""

    @property
    def angular_velocity(self) -> Vector | np.ndarray:
        """Angular velocity of the material in world axes (3,) [rad/s]."""

    @property
    def along(self) -> np.ndarray:
        """Direction (3,) to whose projection on the surface the first rolling row belongs."""

    def below(self, place: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the surface near which bodies with centres (..., 3) touch it.

        Args:
            place: centres of bodies, in world axes [m].
        """

    def material_velocity(self, place: np.ndarray) -> np.ndarray:
        """Velocity of the material (..., 3) at each place (..., 3) [m/s], in world axes.

        Args:
            place: places on the surface, in world axes [m].
        """

    def mesh(self, center: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Part of half width ``size`` [m] near a point ``center`` (3,) [m]: vertices (n, 3) and triangles (m, 3).

        Args:
            center: the point, in world axes.
            size: half width along the surface.
        """


class _QuadricGround(ABC):
    """Surface of points at a distance ``radius`` from a center or an axis, whose material turns and slides in it."""

    radius: float
    inside: bool

    @abstractmethod
    def _place(self) -> tuple[np.ndarray, np.ndarray]:
        """Center, or a point of the axis (3,) [m], and projection (3, 3) on the directions in which distance counts."""

    def _form(self) -> np.ndarray:
        """Second derivatives (3, 3) of ``level``."""
        # Over the radius, the gradient has the length one on the surface, and the level is a distance [m] near it.
        return (-1.0 if self.inside else 1.0) / self.radius * self._place()[1]

    def level(self, point: np.ndarray) -> np.ndarray:
        """Half the difference of squared distance and squared radius, over the radius, at each point (..., 3).

        Args:
            point: places, in world axes [m].
        """
        away = point - self._place()[0]
        rim = (-0.5 if self.inside else 0.5) * self.radius
        return np.asarray(0.5 * (away * (away @ self._form())).sum(axis=-1) - rim)

    def gradient(self, point: np.ndarray) -> np.ndarray:
        """Gradient (..., 3) of ``level`` at each point (..., 3).

        Args:
            point: places, in world axes [m].
        """
        return np.asarray((point - self._place()[0]) @ self._form())

    def hessian(self, point: np.ndarray) -> np.ndarray:
        """Second derivatives (..., 3, 3) of ``level`` at each point (..., 3).

        Args:
            point: places, in world axes [m].
        """
        return np.broadcast_to(self._form(), (*point.shape[:-1], 3, 3))

    def below(self, place: np.ndarray) -> np.ndarray:
        """Nearest points (..., 3) to each place (..., 3); for the center, or a place on the axis, a low one.

        Args:
            place: centres of bodies, in world axes [m].
        """
        point, across = self._place()
        away = (place - point) @ across
        # For an upright cylinder no side is low: x is as good as any.
        low = -_EYE[2] if across[2, 2] > 0.2 else _EYE[0]
        return place - away + self.radius * _unit_vectors(away, low @ across)


@dataclass(frozen=True)
class SphericalGround(_QuadricGround):
    """Sphere: a bowl whose inside, or a ball whose outside, is the ground. Its material may turn about the centre.

    Args:
        radius: radius of the sphere [m].
        center: centre of the sphere [m].
        inside: True if bodies roll inside.
        angular_velocity: angular velocity of the material in world axes [rad/s].
        frame: name of a frame of the robot that carries the surface and stands for the world; None for the world.

    Raises:
        ConfigurationError: the radius is not positive, or vectors are not three finite numbers.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> bowl = rnc.SphericalGround(1.0, center=(0.0, 0.0, 1.0))
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", 0.2, ground=bowl)]).reduce()
        >>> q = reduced.assembled(robot.configuration({"root_joint": [0.5, 0, 0.3, 0, 0, 0, 1]}))
        >>> np.linalg.norm(q[:3] - [0.0, 0.0, 1.0]).round(6)
        np.float64(0.8)
    """

    radius: Positive
    center: Vector = (0.0, 0.0, 0.0)
    inside: bool = True
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    frame: str | None = None

    def __post_init__(self) -> None:
        check_positive("radius of spherical ground", self.radius, ConfigurationError)
        triple(self.center, "center of spherical ground")
        triple(self.angular_velocity, "angular velocity of spherical ground")

    @property
    def moves(self) -> bool:
        """True if the material of the ground moves."""
        return bool(np.any(self.angular_velocity))

    @property
    def along(self) -> np.ndarray:
        """Direction of the first rolling row: the world's x."""
        return _EYE[0]

    def _place(self) -> tuple[np.ndarray, np.ndarray]:
        return np.asarray(self.center), _EYE

    def material_velocity(self, place: np.ndarray) -> np.ndarray:
        """Velocity of the material (..., 3) at each place (..., 3) [m/s], in world axes.

        Args:
            place: places on the surface, in world axes [m].
        """
        return np.cross(np.asarray(self.angular_velocity), place - np.asarray(self.center))

    def mesh(self, center: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Cap around the point nearest to ``center`` (3,), of half width ``size``, for drawings.

        Args:
            center: point near the middle of the cap (3,) [m].
            size: half width of the cap along the surface [m].
        """
        middle = _unit_vectors(np.asarray(center, dtype=float) - np.asarray(self.center), -_EYE[2])
        first, second = _perpendicular(middle)
        largest_half_angle = 1.4  # [rad] of a drawn cap: less than a half ball
        tilt = np.linspace(0.0, min(size / self.radius, largest_half_angle), _EDGES)[:, None, None]
        around = np.linspace(0.0, 2 * np.pi, _EDGES + 1)[:, None]
        out = np.cos(tilt) * middle + np.sin(tilt) * (np.cos(around) * first + np.sin(around) * second)
        return np.asarray(self.center) + self.radius * out.reshape(-1, 3), _grid_triangles(_EDGES, _EDGES + 1)


@dataclass(frozen=True)
class CylindricalGround(_QuadricGround):
    """Circular cylinder whose inside or outside is the ground: a pipe, a tube on end. Its material may turn and slide.

    Args:
        radius: radius of the cylinder [m].
        axis: direction of its axis in world axes; its length has no meaning.
        point: a point of the axis [m].
        inside: True if bodies roll inside.
        spin: angular velocity of the material about the axis [rad/s].
        sliding: velocity of the material along the axis [m/s].
        frame: name of a frame of the robot that carries the surface and stands for the world; None for the world.

    Raises:
        ConfigurationError: the radius is not positive, an axis of no length, or numbers that are not finite.

    Example:
        >>> upright = rnc.CylindricalGround(1.0)
        >>> drum = rnc.CylindricalGround(0.5, axis=(1.0, 0.0, 0.0), point=(0.0, 0.0, 0.5), spin=2.0)
    """

    radius: Positive
    axis: Vector = (0.0, 0.0, 1.0)
    point: Vector = (0.0, 0.0, 0.0)
    inside: bool = True
    spin: float = 0.0
    sliding: float = 0.0
    frame: str | None = None

    def __post_init__(self) -> None:
        check_positive("radius of cylindrical ground", self.radius, ConfigurationError)
        triple(self.point, "point of cylindrical ground")
        frame_direction(self.axis, "axis of cylindrical ground")
        for name in ("spin", "sliding"):
            if not np.isfinite(getattr(self, name)):
                raise ConfigurationError(f"{name} of cylindrical ground: expected a finite number")

    @property
    def moves(self) -> bool:
        """True if the material of the ground moves."""
        return bool(self.spin or self.sliding)

    @property
    def along(self) -> np.ndarray:
        """Direction of the first rolling row: the axis."""
        return frame_direction(self.axis)

    @property
    def angular_velocity(self) -> np.ndarray:
        """Angular velocity of the material in world axes (3,) [rad/s]."""
        return self.spin * self.along

    def _place(self) -> tuple[np.ndarray, np.ndarray]:
        return np.asarray(self.point), _EYE - np.outer(self.along, self.along)

    def material_velocity(self, place: np.ndarray) -> np.ndarray:
        """Velocity of the material (..., 3) at each place (..., 3) [m/s], in world axes.

        Args:
            place: places on the surface, in world axes [m].
        """
        return np.asarray(self.sliding * self.along + np.cross(self.angular_velocity, place - np.asarray(self.point)))

    def mesh(self, center: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Tube of half length ``size`` beside a point, for drawings.

        Args:
            center: point beside the middle of the tube (3,) [m].
            size: half length of the tube [m].
        """
        along, (first, second) = self.along, _perpendicular(self.along)
        middle = np.asarray(self.point) + along * (along @ (np.asarray(center) - np.asarray(self.point)))
        around = np.linspace(0.0, 2 * np.pi, 2 * _EDGES + 1)[:, None]
        ring = self.radius * (np.cos(around) * first + np.sin(around) * second)
        ends = np.array([-size, size])[:, None, None] * along
        return (middle + ends + ring).reshape(-1, 3), _grid_triangles(2, 2 * _EDGES + 1)


def admit_ground(ground: CurvedGround, body: str) -> CurvedGround:
    """Return the ground of a constraint.

    Args:
        ground: ground that the user gave.
        body: the constraint that takes it, for messages.

    Raises:
        ConstraintError: an object without the methods of a ``CurvedGround``.
    """
    missing = [name for name in ("level", "gradient", "hessian", "below") if not hasattr(ground, name)]
    if missing or isinstance(ground, type):
        raise ConstraintError(
            f"ground of {body}: expected a GroundPlane, SphericalGround, CylindricalGround or an object "
            f"with the methods of a CurvedGround, found {ground!r}"
        )
    return ground


def _unit_vectors(vector: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3); another one for vectors of no length."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.where(length > 0, vector / np.where(length > 0, length, 1.0), otherwise)


def _perpendicular(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (3,) across a third."""
    # The world axis that is farthest from the given one: the product is never short.
    first = np.cross(axis, _EYE[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def _grid_triangles(rows: int, columns: int) -> np.ndarray:
    """Triangles (m, 3) of a grid of vertices that is stored by rows."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    corners = [first, first + 1, first + columns], [first + 1, first + columns + 1, first + columns]
    return np.concatenate([np.stack(each, 1) for each in corners])
