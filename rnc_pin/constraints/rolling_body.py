"""Body with a smooth convex surface that rolls without slip on a plane or on a curved surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.body_shapes import BodyShape, kernel_shape
from rnc_pin.constraints.carried_ground import on_carrier
from rnc_pin.constraints.curved_grounds import CurvedGround, admit_ground
from rnc_pin.constraints.ground_plane import GroundPlane
from rnc_pin.constraints.line_shapes import Apex, Cone, Cylinder
from rnc_pin.constraints.surface_contact import SurfaceContactRows
from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply, apply_transposed, complex_step, cross_columns, vector_product
from rnc_pin.model.kernel_rows import Form, KernelRow, attached, plane_motion, rolling_rows
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.mechanisms import Phrases
from rnc_pin.model.offset_frame import point_name, triple
from rnc_pin.model.parameter_types import Vector
from rnc_pin.model.rows import Rows, check_defined
from rnc_pin.robots.robot import Robot

_FLAT = 1e-6


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


class _RollingBodyRows(Rows):
    """Rows ``axes (v + w x arm) = axes u`` and, without pivoting, ``n . w = spin``.

    The arm goes from the frame's origin to the contact point, in world axes. In the shape's axes the contact point has
    the outward normal ``-R^T n``, which turns at ``R^T (w x n)``. The material of the ground has the velocity u there.
    """

    on_ground = True

    def __init__(self, kind: RollingBody, shape: BodyShape, ground: GroundPlane, robot: Robot) -> None:
        self._shape, self._body, self._frame = shape, kind.frame, robot.frame_id(kind.frame)
        self.ground = None if ground.is_default else ground
        self._center, self._turned = kind.placement.translation, kind.placement.rotation
        self._axes = ground.axes
        self._normal, self._spin = self._axes[2], float(ground.spin)
        self._point = triple(ground.point, "point of the ground")
        self._sliding = triple(ground.velocity, "velocity of the ground")
        self._pivots = kind.pivoting
        parts = ("rolling_x", "rolling_y", "vertical", "pivoting")[: 3 if kind.pivoting else 4]
        self.names = tuple(f"{part}({point_name(kind.frame, self._center)})" for part in parts)
        self.units = ("m/s",) * 3 + ("rad/s",) * (len(parts) - 3)
        self.holonomic = tuple(part == "vertical" for part in parts)
        self.affine = ground.moves
        self._seen: tuple[np.ndarray | None, np.ndarray] = None, self._center

    # ------------------------------------------------------------------ contact point; formulas take complex numbers

    def _arm(self, rotation: np.ndarray) -> np.ndarray:
        """Vector (..., 3) from the frame's origin to the contact point, in world axes."""
        return apply(rotation, self._center + apply(self._turned, self._shape.point(self._downward(rotation))))

    def _downward(self, rotation: np.ndarray) -> np.ndarray:
        """Outward normal at the contact point in the shape's axes, (..., 3)."""
        return -apply(self._turned.T, apply_transposed(rotation, self._wide(rotation)))

    def _arm_rate(self, rotation: np.ndarray, arm: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Rate of the arm at an angular velocity w (..., 3)."""
        turning = apply_transposed(rotation, vector_product(w, self._normal))
        down = self._downward(rotation)
        moved = apply(self._turned, self._shape.point_rate(down, apply(self._turned.T, turning)))
        return np.asarray(vector_product(w, arm) + apply(rotation, moved))

    def _wide(self, rotation: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self._normal, rotation.shape[:-1])

    def _contact_arm(self, at: PositionKinematics) -> np.ndarray:
        seen_at, arm = self._seen
        if seen_at is not at.q:
            rotation = at.rotation(self._frame)
            regularity = self._shape.regularity(self._downward(rotation))
            check_defined("a body touches the ground at more than one point", at, regularity, _FLAT, self.names)
            arm = self._arm(rotation)
            self._seen = at.q, arm  # the Jacobian and the bias acceleration share it
        return arm

    def _ground_velocity(self, contact: np.ndarray) -> np.ndarray:
        return np.asarray(self._sliding + self._spin * vector_product(self._normal, contact - self._point))

    # ------------------------------------------------------------------ rows

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._rows(at.jacobian(self._frame), self._contact_arm(at))

    def _rows(self, J: np.ndarray, arm: np.ndarray) -> np.ndarray:
        contact = J[..., :3, :] - cross_columns(arm, J[..., 3:, :])
        rows = self._axes @ contact
        return rows if self._pivots else np.concatenate([rows, self._turns(J)], axis=-2)

    def _turns(self, J: np.ndarray) -> np.ndarray:
        return np.asarray((self._normal @ J[..., 3:, :])[..., None, :])

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        rotation, arm, J = at.rotation(self._frame), self._contact_arm(at), at.jacobian(self._frame)
        arm_rate = self._arm_rate(rotation, arm, at.velocity(self._frame)[..., 3:])
        rows = self._rows(at.jacobian_dot(self._frame), arm)
        rows[..., :3, :] -= self._axes @ cross_columns(arm_rate, J[..., 3:, :])
        return rows

    def rate(self, at: PositionKinematics) -> np.ndarray:
        out = self._zeros(at)
        if self.affine:
            contact = at.placement(self._frame).translation + self._contact_arm(at)
            out[..., :3] = apply(self._axes, self._ground_velocity(contact))
            out[..., 3:] = self._spin
        return out

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        out = self._zeros(at)
        if self.affine:
            velocity, rotation = at.velocity(self._frame), at.rotation(self._frame)
            moved = velocity[..., :3] + self._arm_rate(rotation, self._contact_arm(at), velocity[..., 3:])
            out[..., :3] = apply(self._axes, self._spin * vector_product(self._normal, moved))
        return out

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        self._contact_arm(at)  # raises an error if it is not one point
        return self._bias(at.rotation(self._frame), at.velocity(self._frame), at.acceleration(self._frame))

    def _bias(self, rotation: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        w, arm = velocity[..., 3:], self._arm(rotation)
        arm_rate = self._arm_rate(rotation, arm, w)
        linear = acceleration[..., :3] + vector_product(acceleration[..., 3:], arm) + vector_product(w, arm_rate)
        if self.affine:
            linear = linear - self._spin * vector_product(self._normal, velocity[..., :3] + arm_rate)
        rows = apply(self._axes, linear)
        if self._pivots:
            return rows
        return np.concatenate([rows, (acceleration[..., 3:] * self._normal).sum(axis=-1, keepdims=True)], axis=-1)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        motion, rotation = at.frame_gradients(self._frame), at.rotation(self._frame)
        turned = np.cross(at.jacobian(self._frame)[3:, None, :], rotation[:, :, None], axis=0)  # (3, 3, nv)
        return complex_step(
            lambda flat, *others: self._bias(flat.reshape(3, 3), *others),
            (rotation.ravel(), turned.reshape(9, -1)),
            (at.velocity(self._frame), np.vstack([motion.velocity, motion.angular_velocity])),
            (at.acceleration(self._frame), np.vstack([motion.acceleration, motion.angular_acceleration])),
        )

    def residual(self, at: PositionKinematics) -> np.ndarray:
        contact = at.placement(self._frame).translation + self._contact_arm(at)
        return ((contact - self._point) @ self._normal)[..., None] * self.holonomic

    # ------------------------------------------------------------------ descriptions

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        """Rows of the kernel; None for a shape of the user."""
        shape, placement = kernel_shape(self._shape), pin.SE3(self._turned, self._center)
        motion = plane_motion(self._sliding, self._spin, self._normal, self._point)
        frame = attached(model, self._frame, placement)
        if isinstance(self._shape, Apex) and not self._spin:  # a point of the body: rows of its velocity
            wrenches = np.hstack([self._axes, np.zeros((3, 3))]).tolist()
            rates = (self._axes @ self._sliding).tolist()
            return [KernelRow(Form.WORLD, (frame,), (), *each) for each in zip(wrenches, rates, strict=True)]
        return None if shape is None else rolling_rows(shape, frame, self._axes, motion)[: len(self.names)]

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact = at.placement(self._frame).translation + self._contact_arm(at)
        points = np.full((*contact.shape[:-1], len(self.names), 3), np.nan)
        directions = points.copy()
        points[..., :3, :], directions[..., :3, :] = contact[..., None, :], self._axes
        return points, directions

    def phrases(self) -> Phrases:
        return Phrases("rolling body", prevents="slip at", where=self._body)
