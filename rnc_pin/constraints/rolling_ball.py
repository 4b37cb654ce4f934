"""Ball that rolls without slip on a plane or on a curved surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.body_shapes import Sphere
from rnc_pin.constraints.carried_ground import on_carrier
from rnc_pin.constraints.curved_grounds import CurvedGround
from rnc_pin.constraints.ground_plane import GroundPlane
from rnc_pin.constraints.rolling_body import RollingBody
from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.kernel_rows import Form, KernelRow, attached, plane_motion, rolling_rows
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.mechanisms import GroundContact, Phrases
from rnc_pin.model.parameter_types import Positive
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot


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
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise ConstraintError(f"radius of ball '{self.frame}' has to be positive, found {self.radius}")
        if self.ground is None or isinstance(self.ground, GroundPlane):
            return on_carrier(_RollingBallRows(self, robot), self.frame, self.ground, robot)
        return RollingBody(self.frame, Sphere(self.radius), ground=self.ground).bind(robot)


class _RollingBallRows(Rows):
    holonomic = (False, False, True)
    on_ground = True

    def __init__(self, kind: RollingBall, robot: Robot) -> None:
        self.names = tuple(f"{part}({kind.frame})" for part in ("rolling_x", "rolling_y", "vertical"))
        self.units = ("m/s",) * 3
        self._ball, self._frame = kind, robot.frame_id(kind.frame)
        plane = kind.ground if isinstance(kind.ground, GroundPlane) and not kind.ground.is_default else None
        self.ground, self._plane = plane, plane or GroundPlane()
        self.affine = self._plane.moves
        self._axes = self._plane.axes
        self._below = kind.radius * self._axes[2]
        # Velocity of the contact point, from the velocity of the centre and the angular velocity.
        self._contact = np.hstack([np.eye(3), pin.skew(self._below)])
        if plane is not None:
            self._contact = self._axes @ self._contact
        # Acceleration of the material on the path of the centre, which is parallel to that of the contact point.
        self._turning = self._axes @ pin.skew(self._plane.angular_velocity)

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._contact @ at.jacobian(self._frame)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._contact @ at.jacobian_dot(self._frame)

    def rate(self, at: PositionKinematics) -> np.ndarray:
        if not self.affine:
            return self._zeros(at)
        return apply(self._axes, self._plane.material_velocity(self._touching(at)))

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        return apply(self._turning, at.velocity(self._frame)[..., :3]) if self.affine else self._zeros(at)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        bias = apply(self._contact, at.acceleration(self._frame))
        return bias - self.rate_dot(at) if self.affine else bias

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        motion = at.frame_gradients(self._frame)
        gradient = self._contact @ np.vstack([motion.acceleration, motion.angular_acceleration])
        return gradient - self._turning @ motion.velocity if self.affine else gradient

    def residual(self, at: PositionKinematics) -> np.ndarray:
        if self.ground is None:
            return self._touching(at) * [0.0, 0.0, 1.0]
        return ((self._touching(at) - self._plane.point) @ self._axes[2])[..., None] * [0.0, 0.0, 1.0]

    def _touching(self, at: PositionKinematics) -> np.ndarray:
        """Contact point (..., 3) in the world."""
        return np.asarray(at.placement(self._frame).translation - self._below)

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact = self._touching(at)[..., None, :]
        shape = (*contact.shape[:-2], 3, 3)
        return np.broadcast_to(contact, shape), np.broadcast_to(self._axes, shape)

    def mechanisms(self) -> tuple[GroundContact]:
        return (GroundContact(self._ball.frame, self._ball.radius),)

    def phrases(self) -> Phrases:
        return Phrases("rolling ball", prevents="slip at", where=self._ball.frame)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        if self._plane.spin:  # the velocity of the material depends on the place
            plane, axes = self._plane, self._axes
            motion = plane_motion(np.asarray(plane.velocity), plane.spin, axes[2], np.asarray(plane.point))
            squares = [self._ball.radius**2] * 3
            return rolling_rows((0, 0, squares), attached(model, self._frame), axes, motion)[:3]
        frame, rates = attached(model, self._frame), self._axes @ self._plane.velocity
        return [
            KernelRow(Form.WORLD, (frame,), (), wrench, rate)
            for wrench, rate in zip(self._contact.tolist(), rates.tolist(), strict=True)
        ]
