"""Angular velocity of a frame relative to another, about an axis of the first: a quasi-velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.math.components import Component, components, cross, dot
from rnc_pin.math.linear_algebra import complex_step
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class RelativeAngularVelocity:
    """Angular velocity of a frame relative to another, about the first frame's own axis [rad/s].

    It is a quasi-velocity, not the rate of a coordinate: in a trajectory, ``x2`` contains its integral over time. With
    ``OutputForce`` it is the torque of a motor between two bodies, whatever joints are between them.

    Args:
        frame: name of the frame.
        reference: name of the other frame, or "universe" for the world.
        axis: the frame's own axis, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(vertical=[rnc.RelativeAngularVelocity("tip", "platform_body")])
        >>> reduced.at(robot.configuration()).J1.round(3)  # the sum of the three joint velocities
        array([[0., 1., 1., 1.]])
    """

    frame: str
    reference: str
    axis: Axis = "z"

    def bind(self, robot: Robot) -> OutputRows:
        return _RelativeRow(self, robot)


class _RelativeRow(OutputRows):
    """Row ``d . (w_a - w_b)``, with d an axis of frame a; all vectors in world axes."""

    quasi = True
    units = ("rad/s",)
    angular = (False,)

    def __init__(self, kind: RelativeAngularVelocity, robot: Robot) -> None:
        self._frame, self._reference = robot.frame_id(kind.frame), robot.frame_id(kind.reference)
        self._axis = axis_index(kind.axis)
        self.names = (f"{kind.frame}_angular_velocity_{kind.axis}_of_{kind.reference}",)

    def _direction(self, at: PositionKinematics) -> np.ndarray:
        return at.rotation(self._frame)[..., self._axis]

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        turning = (at.jacobian(self._frame) - at.jacobian(self._reference))[..., 3:, :]
        return self._direction(at)[..., None, :] @ turning

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        direction = self._direction(at)
        turning, turning_dot = (
            (each(self._frame) - each(self._reference))[..., 3:, :] for each in (at.jacobian, at.jacobian_dot)
        )
        rate = np.cross(at.velocity(self._frame)[..., 3:], direction)
        return direction[..., None, :] @ turning_dot + rate[..., None, :] @ turning

    def _motions(self, at: VelocityKinematics) -> tuple[np.ndarray, ...]:
        """Angular velocities of both frames, and their relative angular acceleration, (..., 3)."""
        velocity, other = (at.velocity(each)[..., 3:] for each in (self._frame, self._reference))
        return velocity, other, (at.acceleration(self._frame) - at.acceleration(self._reference))[..., 3:]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        parts = (components(each) for each in (self._direction(at), *self._motions(at)))
        return np.asarray(_bias_acceleration(*parts))[..., None]

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        direction = self._direction(at).copy()
        a, b = at.frame_gradients(self._frame), at.frame_gradients(self._reference)
        velocity, other, acceleration = self._motions(at)
        return complex_step(
            lambda *parts: np.array([_bias_acceleration(*parts)]),
            (direction, np.cross(at.jacobian(self._frame)[3:], direction, axisa=0).T),
            (velocity, a.angular_velocity),
            (other, b.angular_velocity),
            (acceleration, a.angular_acceleration - b.angular_acceleration),
        )


def _bias_acceleration(
    direction: Sequence[Component],
    velocity: Sequence[Component],
    other: Sequence[Component],
    acceleration: Sequence[Component],
) -> Component:
    """Rate of ``d . (w_a - w_b)``; d turns with frame a, so that ``ddot . w_a`` is zero."""
    return dot(direction, acceleration) - dot(cross(velocity, direction), other)
