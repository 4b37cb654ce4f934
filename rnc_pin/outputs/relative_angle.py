"""Angle of a frame's axis about an axis of another frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.rows import OutputRows, check_defined
from rnc_pin.outputs.direction_angle import Vector
from rnc_pin.outputs.frame_yaw import YawRow
from rnc_pin.robots.robot import Robot

_ALONG = 1e-6


@dataclass(frozen=True)
class RelativeAngle:
    """Angle of a frame's own axis about an axis of another frame [rad], in (-pi, pi].

    It is measured in the plane normal to ``about``: zero along the reference's next axis (x for "z", y for "x", z for
    "y"), positive by the right-hand rule. For the world as reference and ``about="z"`` it is ``FrameYaw``.

    Args:
        frame: name of the frame.
        reference: name of the other frame, or "universe" for the world.
        axis: the frame's own axis, "x", "y" or "z".
        about: the axis of the reference, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(vertical=[rnc.RelativeAngle("tip", "platform_body")])
        >>> x1, _ = reduced.at(robot.configuration({"joint_1": 0.4, "joint_2": -1.0})).outputs()
        >>> x1.round(3)
        array([-0.6])
    """

    frame: str
    reference: str
    axis: Axis = "x"
    about: Axis = "z"

    def bind(self, robot: Robot) -> OutputRows:
        return _RelativeAngleRow(self, robot)


class _RelativeAngleRow(YawRow):
    """Yaw of a direction in the axes of a reference that moves.

    Directions, angular velocities and accelerations are those relative to the reference, in its axes, which are ordered
    so that the third is the axis ``about``.
    """

    def __init__(self, kind: RelativeAngle, robot: Robot) -> None:
        super().__init__(robot, kind.frame, kind.axis)
        self._reference = robot.frame_id(kind.reference)
        last = axis_index(kind.about)
        self._order = [(last + 1) % 3, (last + 2) % 3, last]
        self.names = (f"{kind.frame}_angle_{kind.axis}_about_{kind.reference}_{kind.about}",)
        if self._reference == self._frame:
            raise ConfigurationError(f"angle of frame '{kind.frame}' relative to itself: name another reference")

    def _axes(self, at: PositionKinematics) -> np.ndarray:
        """Axes of the reference as rows, (..., 3, 3)."""
        return at.rotation(self._reference)[..., self._order].mT

    def _direction(self, at: PositionKinematics) -> np.ndarray:
        return apply(self._axes(at), super()._direction(at))

    def _turning(self, at: PositionKinematics) -> np.ndarray:
        return self._axes(at) @ (at.jacobian(self._frame) - at.jacobian(self._reference))[..., 3:, :]

    def _turning_dot(self, at: VelocityKinematics) -> np.ndarray:
        relative, relative_dot = (
            (each(self._frame) - each(self._reference))[..., 3:, :] for each in (at.jacobian, at.jacobian_dot)
        )
        # The axes turn with the reference: d/dt (axes x) = axes (xdot + x cross w).
        turned = np.cross(relative, at.velocity(self._reference)[..., 3:, None], axis=-2)
        return self._axes(at) @ (relative_dot + turned)

    def _velocity(self, at: VelocityKinematics) -> np.ndarray:
        return apply(self._axes(at), (at.velocity(self._frame) - at.velocity(self._reference))[..., 3:])

    def _acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return apply(self._axes(at), self._motion_in_world(at)[1])

    def _motion_in_world(self, at: VelocityKinematics) -> tuple[np.ndarray, np.ndarray]:
        """Relative angular velocity, and its rate as the reference sees it, in world axes (..., 3)."""
        velocity, acceleration = (
            (each(self._frame) - each(self._reference))[..., 3:] for each in (at.velocity, at.acceleration)
        )
        return velocity, acceleration + np.cross(velocity, at.velocity(self._reference)[..., 3:])

    def _gradients(self, at: VelocityKinematics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        axes, reference = self._axes(at), at.velocity(self._reference)[3:]
        a, b = at.frame_gradients(self._frame), at.frame_gradients(self._reference)
        turning = at.jacobian(self._reference)[3:]
        velocity, acceleration = self._motion_in_world(at)
        velocity_q = a.angular_velocity - b.angular_velocity
        acceleration_q = (
            a.angular_acceleration
            - b.angular_acceleration
            + _cross(velocity_q, reference[:, None])
            + _cross(velocity[:, None], b.angular_velocity)
        )
        # The axes turn with the reference, and the direction with the frame.
        return (
            _cross(self._turning(at), self._direction(at)[:, None]),
            axes @ (velocity_q + _cross(velocity[:, None], turning)),
            axes @ (acceleration_q + _cross(acceleration[:, None], turning)),
        )

    def _check_defined(self, at: PositionKinematics, direction: Vector) -> None:
        across = (direction[0] * direction[0] + direction[1] * direction[1]) ** 0.5
        check_defined("an angle about an axis is not defined for a direction along it", at, across, _ALONG, self.names)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products of columns, (3, k)."""
    return np.asarray(np.cross(a, b, axis=0))
