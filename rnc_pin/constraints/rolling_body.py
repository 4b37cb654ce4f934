"""Bodies with smooth convex surfaces that roll without slip: on planes, on curved surfaces, and on each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.body_shapes import Apex, BodyShape, Cone, Cylinder, Sphere, grid_triangles, support_numbers
from rnc_pin.constraints.curved_grounds import CurvedGround, Levelled, admit_ground, unit_vectors
from rnc_pin.constraints.ground_plane import GroundPlane, on_carrier
from rnc_pin.constraints.surface_contact import SurfaceContactRows, contact_wrench_rates, contact_wrenches
from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply, apply_transposed, vector_product
from rnc_pin.model.frame_rows import FLAT, ConstantWrenchRows, WrenchRows, point_name, triple
from rnc_pin.model.kernel_rows import Form, KernelRow, attached, wrench_rows
from rnc_pin.model.kinematics import Placement, PositionKinematics
from rnc_pin.model.parameter_types import Positive, Vector, is_number
from rnc_pin.model.rows import GroundContact, Phrases, Rows, check_defined
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class RollingBody:
    """Body whose contact point has the velocity of the ground: two rolling rows and a vertical row.

    The contact point is where the surface has its lowest point above the ground, so it moves over the body. The
    vertical row is holonomic: the surface touches the ground. The body has to be curved more than curved ground.

    Args:
        frame: name of a frame of the body.
        shape: ``Sphere``, ``Ellipsoid``, ``Torus``, or an object with the methods of a ``BodyShape``. A ``Cylinder`` or
            ``Cone`` touches a plane along a line: its two ends have the rows, and their names tell where.
        at: centre of the shape in the frame's axes [m].
        rpy: orientation of the shape relative to the frame: roll, pitch and yaw as in a URDF [rad].
        pivoting: False to add a row: the body does not turn about the normal relative to the ground, as soft contact
            areas prevent.
        ground: a ``GroundPlane``, ``SphericalGround``, ``CylindricalGround``, ``HeightField`` or ``BodySurface``, or an
            object with the methods of a ``CurvedGround``; None for z = 0 at rest. A frame can carry it.

    Raises:
        ModelError: unknown frame.
        ConstraintError: a shape without the methods of a ``BodyShape``, or a ground of another kind.
        SingularityError: during evaluation, the contact is not one point, e.g. a disk lies flat.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> egg = rnc.RollingBody("ball", rnc.Ellipsoid((0.2, 0.2, 0.3)))
        >>> reduced = rnc.NonholonomicSystem(robot, [egg]).reduce()
        >>> q = reduced.assembled(robot.configuration({"root_joint": [0, 0, 1, 0, 0, 0, 1]}))
        >>> q[2].round(3)  # height of the centre
        np.float64(0.3)
    """

    frame: str
    shape: BodyShape | Cylinder | Cone
    at: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)
    pivoting: bool = True
    ground: GroundPlane | CurvedGround | None = None

    def parts(self) -> tuple[RollingBody, ...]:
        """The body, or both ends of the line along which a ``Cylinder`` or ``Cone`` touches a plane.

        Raises:
            ConstraintError: a line on curved ground.
        """
        if not isinstance(self.shape, Cylinder | Cone):
            return (self,)
        if not (self.ground is None or isinstance(self.ground, GroundPlane)):
            raise ConstraintError(
                f"rolling body '{self.frame}': a {type(self.shape).__name__} on its side touches planes only; use a "
                "Torus for its rim"
            )
        return tuple(
            replace(self, shape=end.shape, at=tuple(self.placement.act(end.offset).tolist()), pivoting=True)
            for end in self.shape.ends()
        )

    @property
    def placement(self) -> pin.SE3:
        """Placement of the shape on the frame."""
        center = triple(self.at, f"centre of rolling body '{self.frame}'")
        return pin.SE3(pin.rpy.rpyToMatrix(triple(self.rpy, f"rpy of rolling body '{self.frame}'")), center)

    def bind(self, robot: Robot) -> Rows:
        if isinstance(self.shape, Cylinder | Cone):
            raise ConstraintError(
                f"rolling body '{self.frame}': a {type(self.shape).__name__} touches along a line; here, name the ends "
                "of this line one by one (parts())"
            )
        missing = [name for name in ("point", "point_rate", "regularity") if not hasattr(self.shape, name)]
        if missing or isinstance(self.shape, type):
            raise ConstraintError(
                f"shape of rolling body '{self.frame}': expected Sphere, Ellipsoid, Torus, Cylinder, Cone or an object "
                f"with the methods point, point_rate and regularity, found {self.shape!r}"
            )
        if self.ground is None or isinstance(self.ground, GroundPlane):
            rows: Rows = _RollingBodyRows(self, self.shape, self.ground or GroundPlane(), robot)
            return on_carrier(rows, self.frame, self.ground, robot)
        ground = admit_ground(self.ground, f"rolling body '{self.frame}'")
        rows = SurfaceContactRows(self.frame, self.shape, self.placement, self.pivoting, ground, robot)
        return on_carrier(rows, self.frame, ground, robot)


def contact_arm(rotation: np.ndarray, normal: np.ndarray, point: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Vector (..., 3) from the centre of a shape to its contact point on a plane, in world axes.

    Args:
        rotation: axes of the shape (..., 3, 3).
        normal: normal of the plane (3,).
        point: surface point with a given outward normal, both in the axes of the shape.
    """
    return apply(rotation, point(_outward(rotation, normal)))


def _outward(rotation: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Outward normal (..., 3) at the contact point, in the axes of the shape."""
    return -apply_transposed(rotation, np.broadcast_to(normal, rotation.shape[:-1]))


class _RollingBodyRows(WrenchRows):
    """Velocity of the material at the contact point, along the axes of the plane.

    The arm goes from the frame's origin to the contact point. In the shape's axes the outward normal there turns at
    ``R^T (w x n)``. Without pivoting there is the angular velocity about the normal too.
    """

    on_ground = True

    def __init__(self, kind: RollingBody, shape: BodyShape, plane: GroundPlane, robot: Robot) -> None:
        self._shape, self._body, self.frame = shape, kind.frame, robot.frame_id(kind.frame)
        self._center, self._turned = kind.placement.translation, kind.placement.rotation
        self.ground = None if plane.is_default else plane
        self.twist, self.affine = plane.twist, plane.moves
        self._axes, self._normal, self._point = plane.axes, plane.axes[2], np.asarray(plane.point, dtype=float)
        parts = ("rolling_x", "rolling_y", "vertical", "pivoting")[: 3 if kind.pivoting else 4]
        self.names = tuple(f"{part}({point_name(kind.frame, self._center)})" for part in parts)
        self.units = ("m/s",) * 3 + ("rad/s",) * (len(parts) - 3)
        self.holonomic = tuple(part == "vertical" for part in parts)

    def _arm(self, rotation: np.ndarray) -> np.ndarray:
        center = apply(rotation, np.broadcast_to(self._center, rotation.shape[:-1]))
        return np.asarray(center + contact_arm(rotation @ self._turned, self._normal, self._shape.point))

    def _arm_rate(self, rotation: np.ndarray, w: np.ndarray) -> np.ndarray:
        axes = rotation @ self._turned
        turning = apply_transposed(axes, vector_product(w, np.broadcast_to(self._normal, w.shape)))
        moved = self._shape.point_rate(_outward(axes, self._normal), turning)
        return np.asarray(vector_product(w, self._arm(rotation)) + apply(axes, moved))

    def check_defined(self, at: PositionKinematics) -> None:
        regularity = self._shape.regularity(_outward(at.rotation(self.frame) @ self._turned, self._normal))
        check_defined("a body touches the ground at more than one point", at.q, regularity, FLAT, self.names)

    def wrench(self, place: Placement) -> np.ndarray:
        return contact_wrenches(self._axes, self._arm(place.rotation), len(self.names))

    def wrench_rate(self, place: Placement, velocity: np.ndarray) -> np.ndarray:
        moved = self._arm_rate(place.rotation, velocity[..., 3:])
        axes_rate = np.zeros((*moved.shape, 3))
        return contact_wrench_rates(self._axes, axes_rate, np.zeros_like(moved), moved, len(self.names))

    def _contact(self, at: PositionKinematics) -> np.ndarray:
        """Contact points (..., 3) in the world."""
        self.check_defined(at)
        rotation, origin = at.placement(self.frame)
        return origin + self._arm(rotation)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        return ((self._contact(at) - self._point) @ self._normal)[..., None] * self.holonomic

    # ------------------------------------------------------------------ descriptions

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        """Rows of the kernel; None for a shape of the user."""
        frame = attached(model, self.frame, pin.SE3(self._turned, self._center))
        if isinstance(self._shape, Apex):  # a point of the body: rows of its velocity
            numbers = np.hstack([self._axes, np.zeros((3, 3))]).tolist()
            return wrench_rows(Form.WORLD, frame, numbers, self.twist)
        support = support_numbers(self._shape)
        if support is None:
            return None
        numbers = [[*axis, *self._normal, *support] for axis in self._axes]
        pivot = wrench_rows(Form.WORLD, frame, [[0.0, 0.0, 0.0, *self._normal]], self.twist)
        return [*wrench_rows(Form.ROLLING, frame, numbers, self.twist), *pivot][: len(self.names)]

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact = self._contact(at)
        points = np.full((*contact.shape[:-1], len(self.names), 3), np.nan)
        directions = points.copy()
        points[..., :3, :], directions[..., :3, :] = contact[..., None, :], self._axes
        return points, directions

    def phrases(self) -> Phrases:
        return Phrases("rolling body", prevents="slip at", where=self._body)


@dataclass(frozen=True)
class RollingBall:
    """Ball whose contact point has the velocity of the ground: two rolling rows and a vertical row.

    The contact point is ``radius`` below the centre at any attitude. The rows are the velocity of the material point
    there along the world's x, y and z, or along the axes of the ground. The vertical row is holonomic: the centre stays
    at height ``radius``. For a planar base on level ground, it is zero and is dropped.

    Args:
        frame: a frame at the centre of the ball that turns with it.
        radius: radius of the ball [m].
        ground: a plane, or curved ground as of a ``RollingBody``; None for z = 0 at rest.

    Raises:
        ModelError: unknown frame.
        ConstraintError: the radius is not positive, or a ground of another kind.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", radius=0.3)])
        >>> reduced = system.reduce([rnc.FrameAngularVelocity("ball", axis) for axis in "xyz"])
        >>> q = robot.configuration({"root_joint": [0, 0, 0.3, 0, 0, 0, 1]})
        >>> reduced.at(q, [0.0, 2.0, 0.0]).v[[0, 4]].round(3)  # as it turns about y it goes along x
        array([0.6, 2. ])
    """

    frame: str
    radius: Positive
    ground: GroundPlane | CurvedGround | None = None

    def bind(self, robot: Robot) -> Rows:
        if not (is_number(self.radius) and self.radius > 0):
            raise ConstraintError(f"radius of ball '{self.frame}' has to be positive, found {self.radius!r}")
        if self.ground is None or isinstance(self.ground, GroundPlane):
            return on_carrier(
                _RollingBallRows(self, self.ground or GroundPlane(), robot), self.frame, self.ground, robot
            )
        return RollingBody(self.frame, Sphere(self.radius), ground=self.ground).bind(robot)


class _RollingBallRows(ConstantWrenchRows):
    """Velocity of the material at a constant arm from the centre, along the axes of the plane."""

    holonomic = (False, False, True)
    on_ground = True
    units = ("m/s",) * 3

    def __init__(self, kind: RollingBall, plane: GroundPlane, robot: Robot) -> None:
        self.names = tuple(f"{part}({kind.frame})" for part in ("rolling_x", "rolling_y", "vertical"))
        self._ball, self.frame = kind, robot.frame_id(kind.frame)
        self.ground = None if plane.is_default else plane
        self.twist, self.affine = plane.twist, plane.moves
        self._plane, self._axes, self._arm = plane, plane.axes, -kind.radius * plane.axes[2]
        self.matrix = np.hstack([self._axes, np.cross(self._arm, self._axes)])

    def residual(self, at: PositionKinematics) -> np.ndarray:
        height = (self._contact(at) - self._plane.point) @ self._axes[2]
        return np.asarray(height)[..., None] * [0.0, 0.0, 1.0]

    def _contact(self, at: PositionKinematics) -> np.ndarray:
        """Contact point (..., 3) in the world."""
        return np.asarray(at.placement(self.frame).translation + self._arm)

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact = self._contact(at)[..., None, :]
        shape = (*contact.shape[:-2], 3, 3)
        return np.broadcast_to(contact, shape), np.broadcast_to(self._axes, shape)

    def mechanisms(self) -> tuple[GroundContact]:
        return (GroundContact(self._ball.frame, self._ball.radius),)

    def phrases(self) -> Phrases:
        return Phrases("rolling ball", prevents="slip at", where=self._ball.frame)


_EYE = np.eye(3)
_FINE = 32  # edges of the drawn surface


class LevelledShape(BodyShape, Levelled, Protocol):
    """Shape with a function that is zero on its surface, in the axes of its body."""


@dataclass(frozen=True)
class BodySurface:
    """Outside of a convex body, on which another body rolls. Both move; a frame carries the surface.

    Args:
        shape: ``Sphere``, ``Ellipsoid``, ``Torus`` with a tube, or a ``BodyShape`` with ``level``, ``gradient`` and
            ``hessian``.
        frame: name of the frame that carries the shape; None for a body at rest in the world.
        at: centre of the shape in the frame's axes [m].
        rpy: orientation of the shape relative to the frame: roll, pitch and yaw as in a URDF [rad].

    Raises:
        ConstraintError: a shape without these methods.
        ConfigurationError: vectors that are not three finite numbers.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> hill = rnc.BodySurface(rnc.Ellipsoid((2.0, 1.0, 0.5)))
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", 0.2, ground=hill)]).reduce()
        >>> q = reduced.assembled(robot.configuration({"root_joint": [0, 0, 1, 0, 0, 0, 1]}))
        >>> q[2].round(6)  # height of the centre above that of the hill
        np.float64(0.7)
    """

    shape: LevelledShape
    frame: str | None = None
    at: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        names = ("point", "level", "gradient", "hessian")
        missing = [name for name in names if not hasattr(self.shape, name)]
        if missing or isinstance(self.shape, type):
            raise ConstraintError(
                "shape of a body's surface: expected Sphere, Ellipsoid, Torus or an object with the methods "
                f"{', '.join(names)}, found {self.shape!r}"
            )
        if getattr(self.shape, "tube", 1.0) == 0:
            raise ConstraintError("shape of a body's surface: a Torus with tube=0 is a sharp edge; give it a tube")
        triple(self.at, "centre of a body's surface")
        triple(self.rpy, "rpy of a body's surface")

    @property
    def _axes(self) -> np.ndarray:
        """Axes of the shape as columns (3, 3)."""
        return np.asarray(pin.rpy.rpyToMatrix(np.asarray(self.rpy, dtype=float)))

    def _local(self, point: np.ndarray) -> np.ndarray:
        return np.asarray((point - np.asarray(self.at)) @ self._axes)

    @property
    def moves(self) -> bool:
        """False: the surface is at rest in the frame that carries it."""
        return False

    @property
    def angular_velocity(self) -> np.ndarray:
        """Zero (3,)."""
        return np.zeros(3)

    @property
    def along(self) -> np.ndarray:
        """Direction of the first rolling row: the carrier's x."""
        return _EYE[0]

    def level(self, point: np.ndarray) -> np.ndarray:
        """Function (...) that is zero on the surface and grows outwards, at each point (..., 3) [m]."""
        return self.shape.level(self._local(point))

    def gradient(self, point: np.ndarray) -> np.ndarray:
        """Gradient (..., 3) of ``level`` at each point (..., 3)."""
        return apply(self._axes, self.shape.gradient(self._local(point)))

    def hessian(self, point: np.ndarray) -> np.ndarray:
        """Second derivatives (..., 3, 3) of ``level`` at each point (..., 3)."""
        axes = self._axes
        return np.asarray(axes @ self.shape.hessian(self._local(point)) @ axes.T)

    def below(self, place: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the surface whose normals are along the lines from its centre to each place (..., 3)."""
        normal = unit_vectors(self._local(place), _EYE[2])
        return np.asarray(self.at) + apply(self._axes, self.shape.point(normal))

    def material_velocity(self, place: np.ndarray) -> np.ndarray:
        """Zero (..., 3) at each place (..., 3)."""
        return np.zeros_like(place)

    def mesh(self, center: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Whole surface, for drawings: vertices (n, 3) and triangles (m, 3).

        Args:
            center: not used.
            size: not used.
        """
        tilt = (np.arange(_FINE) + 0.5) * np.pi / _FINE
        around = np.linspace(0.0, 2 * np.pi, 2 * _FINE + 1)
        height, angle = np.meshgrid(np.cos(tilt), around, indexing="ij")
        width = np.sqrt(1.0 - height**2)
        normals = np.stack([width * np.cos(angle), width * np.sin(angle), height], axis=-1).reshape(-1, 3)
        vertices = np.asarray(self.at) + apply(self._axes, self.shape.point(normals))
        return vertices, grid_triangles(_FINE, 2 * _FINE + 1)
