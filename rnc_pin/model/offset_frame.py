"""Frame with a constant placement on another frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.kernel_rows import AttachedFrame, attached
from rnc_pin.model.kinematics import (
    OWN_AXES,
    Placement,
    PositionKinematics,
    VelocityKinematics,
)
from rnc_pin.model.parameter_types import Vector
from rnc_pin.robots.robot import Robot

_UNIT = np.eye(3)


def point_name(frame: str, point: np.ndarray) -> str:
    """Name of a point (3,) in a frame's axes: that of the frame, with the coordinates unless it is the origin."""
    return f"{frame}[{' '.join(f'{each:g}' for each in point)}]" if point.any() else frame


class FrameMotion(NamedTuple):
    """Motion of a frame in world axes, at its origin; velocity and acceleration with their derivatives by q."""

    translation: np.ndarray
    """(3,) [m]"""
    rotation: np.ndarray
    """(3, 3)"""
    jacobian: np.ndarray
    """(6, nv)"""
    velocity: tuple[np.ndarray, np.ndarray]
    """(6,), (6, nv)"""
    acceleration: tuple[np.ndarray, np.ndarray]
    """Rate of the velocity at zero ``vdot`` (6,), (6, nv)."""


class OffsetFrame:
    """Kinematics of a frame with a constant offset and rotation relative to a parent frame.

    All components are along the axes of the offset frame: constant matrices times the parent's components in its own
    axes.

    Args:
        robot: the robot that has the frame.
        frame: name of the parent frame.
        at: origin of the offset frame in the parent's axes (3,) [m].
        rotation: rotation of the offset frame relative to the parent (3, 3); identity by default.

    Attributes:
        name: name of the parent frame, with the point if this is not its origin.
        index: index of the parent frame in the model.
        joint: index of the joint that supports the frame.
        offset: constant placement on the parent frame.

    Raises:
        ModelError: unknown frame.
        ConfigurationError: a point that is not three finite numbers.
    """

    def __init__(self, robot: Robot, frame: str, at: Vector, rotation: np.ndarray = _UNIT) -> None:
        point = triple(at, f"point on frame '{frame}'")
        self.index = robot.frame_id(frame)
        self.joint = robot.model.frames[self.index].parentJoint
        self.name = point_name(frame, point)
        self._point, self._rotation = point, rotation
        self.offset = pin.SE3(rotation, point)
        self._action = self.offset.toActionMatrixInverse()  # from the parent frame to the offset frame
        self._moved = not np.array_equal(self._action, np.eye(6))

    def placement(self, at: PositionKinematics) -> Placement:
        """Placement of the offset frame in the world."""
        place = at.placement(self.index)
        if not self._moved:
            return place
        return Placement(place.rotation @ self._rotation, place.translation + apply(place.rotation, self._point))

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        """Frame Jacobian (..., 6, nv)."""
        return self._of(at.jacobian(self.index, OWN_AXES))

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        """Time derivative of the Jacobian, (..., 6, nv)."""
        return self._of(at.jacobian_dot(self.index, OWN_AXES))

    def acceleration(self, at: VelocityKinematics) -> np.ndarray:
        """Rate (..., 6) of the components of the frame's velocity at zero ``vdot``."""
        found = at.acceleration(self.index, OWN_AXES)
        return apply(self._action, found) if self._moved else found

    def acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        """Derivative of ``acceleration`` with respect to q, (6, nv)."""
        return self._of(at.own_acceleration_gradient(self.index))

    def motion_gradients(self, at: VelocityKinematics) -> FrameMotion:
        """Motion of the frame's origin in world axes, with its derivatives with respect to q."""
        parent, place, J = at.frame_gradients(self.index), self.placement(at), at.jacobian(self.index)
        velocity, acceleration = at.velocity(self.index), at.acceleration(self.index)
        arm = place.translation - at.placement(self.index).translation
        moved = -pin.skew(arm) @ J[3:]  # derivative of the arm

        def at_arm(linear: np.ndarray, angular: np.ndarray) -> np.ndarray:
            return linear - pin.skew(arm) @ angular

        w, b = velocity[3:], acceleration[3:]
        swing, swing_q = np.cross(w, arm), pin.skew(w) @ moved - pin.skew(arm) @ parent.angular_velocity
        origin_v = at_arm(parent.velocity, parent.angular_velocity) + pin.skew(w) @ moved
        origin_a = at_arm(parent.acceleration, parent.angular_acceleration) + pin.skew(b) @ moved
        origin_a += pin.skew(w) @ swing_q - pin.skew(swing) @ parent.angular_velocity
        return FrameMotion(
            place.translation,
            place.rotation,
            np.vstack([at_arm(J[:3], J[3:]), J[3:]]),
            (np.concatenate([velocity[:3] + swing, w]), np.vstack([origin_v, parent.angular_velocity])),
            (
                np.concatenate([acceleration[:3] + np.cross(b, arm) + np.cross(w, swing), b]),
                np.vstack([origin_a, parent.angular_acceleration]),
            ),
        )

    def _of(self, motions: np.ndarray) -> np.ndarray:
        return self._action @ motions if self._moved else motions

    def attached(self, model: pin.Model) -> AttachedFrame:
        """Joint and constant placement of the offset frame."""
        return attached(model, self.index, pin.SE3(self._rotation, self._point))


def triple(values: Vector, what: str) -> np.ndarray:
    """Convert a value to three finite numbers (3,); the error message names it by ``what``."""
    found = np.asarray(values, dtype=float)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ConfigurationError(f"{what}: expected three finite numbers, found {values}")
    return found
