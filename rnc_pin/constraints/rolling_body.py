"""Bodies with smooth convex surfaces that roll without slip on planes and on curved surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.ground_plane import GroundPlane, on_carrier
from rnc_pin.constraints.surface_contact import (
    BodyContactRows,
    SurfaceContactRows,
    contact_wrench_rates,
    contact_wrenches,
)
from rnc_pin.constraints.surfaces import BodyShape, CurvedGround, Sphere, admit_ground, support_numbers
from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply, apply_transposed, vector_product
from rnc_pin.model.frame_rows import FLAT, ConstantWrenchRows, triple
from rnc_pin.model.input_validation import Positive, Vector, is_number
from rnc_pin.model.kernel_rows import Form, KernelRow, attached, wrench_rows
from rnc_pin.model.kinematics import Placement, PositionKinematics
from rnc_pin.model.rows import GroundContact, Rows, check_defined
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class RollingBody:
    """Body whose contact point has the velocity of the ground: two rolling rows and a vertical row.

    The contact point is where the surface has its lowest point above the ground, so it moves over the body. The
    vertical row is holonomic: the surface touches the ground. The body has to be curved more than curved ground.

    Args:
        frame: name of a frame of the body.
        shape: ``Sphere``, ``Ellipsoid``, ``Torus``, or an object with the methods of a ``BodyShape``.
        at: centre of the shape in the frame's axes [m].
        rpy: orientation of the shape relative to the frame: roll, pitch and yaw as in a URDF [rad].
        pivoting: False to add a row: the body does not turn about the normal relative to the ground, as soft contact
            areas prevent.
        ground: a ``GroundPlane``, ``SphericalGround``, ``CylindricalGround``, or an object
            with the methods of a ``CurvedGround``; None for z = 0 at rest. A frame can carry it.

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
    shape: BodyShape
    at: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)
    pivoting: bool = True
    ground: GroundPlane | CurvedGround | None = None

    @property
    def placement(self) -> pin.SE3:
        """Placement of the shape on the frame."""
        center = triple(self.at, f"centre of rolling body '{self.frame}'")
        return pin.SE3(pin.rpy.rpyToMatrix(triple(self.rpy, f"rpy of rolling body '{self.frame}'")), center)

    def bind(self, robot: Robot) -> Rows:
        # Protocols are not checked at run time: a missing method would fail at the first evaluation, far from its
        # cause.
        missing = [name for name in ("point", "point_rate", "regularity") if not hasattr(self.shape, name)]
        if missing or isinstance(self.shape, type):
            raise ConstraintError(
                f"shape of rolling body '{self.frame}': expected Sphere, Ellipsoid, Torus or an object "
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


class _RollingBodyRows(BodyContactRows):
    """Velocity of the material at the contact point, along the axes of the plane.

    The arm goes from the frame's origin to the contact point. In the shape's axes the outward normal there turns at
    ``R^T (w x n)``. Without pivoting there is the angular velocity about the normal too.
    """

    def __init__(self, kind: RollingBody, shape: BodyShape, plane: GroundPlane, robot: Robot) -> None:
        self._shape, self.frame = shape, robot.frame_id(kind.frame)
        self._center, self._turned = kind.placement.translation, kind.placement.rotation
        self.ground = None if plane.is_default else plane
        self.twist, self.affine = plane.twist, plane.moves
        self._axes, self._normal, self._point = plane.axes, plane.axes[2], np.asarray(plane.point, dtype=float)
        self.name_rows(kind.frame, self._center, kind.pivoting)

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
        # These axes belong to the plane, which does not turn: only the arm moves.
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
        support = support_numbers(self._shape)
        if support is None:
            return None
        # The kernel has a closed support function only; a shape of the user is called from Python.
        numbers = [[*axis, *self._normal, *support] for axis in self._axes]
        pivot = wrench_rows(Form.WORLD, frame, [[0.0, 0.0, 0.0, *self._normal]], self.twist)
        return [*wrench_rows(Form.ROLLING, frame, numbers, self.twist), *pivot][: len(self.names)]

    def contact_axes(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        return self._contact(at), self._axes


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
            rows = _RollingBallRows(self, self.ground or GroundPlane(), robot)
            return on_carrier(rows, self.frame, self.ground, robot)
        # On curved ground the arm turns with the normal below the ball: a ball there is a body like any other.
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
        # The arm is constant in the world, so the rows are constant wrenches.
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
