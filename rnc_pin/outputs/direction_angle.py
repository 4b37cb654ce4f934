"""Angles of a frame's axis: outputs whose rate is a linear form on the frame's angular velocity."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rnc_pin.math.components import Component, components, cross, dot, packed
from rnc_pin.math.linear_algebra import complex_step
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot

Vector = Sequence[Component]


class DirectionAngleRow(OutputRows):
    """Output with ``rate = c(d) . w``: direction d of a frame's own axis, angular velocity w, both in world axes.

    Args:
        robot: the robot that has the frame.
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".
    """

    units = ("rad/s",)

    def __init__(self, robot: Robot, frame: str, axis: str) -> None:
        self._frame, self._axis = robot.frame_id(frame), axis_index(axis)

    @abstractmethod
    def _form(self, direction: Vector) -> Vector:
        """Covector c of a direction."""

    @abstractmethod
    def _form_rate(self, direction: Vector, rate: Vector) -> Vector:
        """Rate of the covector c for a rate of the direction."""

    @abstractmethod
    def _check_defined(self, at: PositionKinematics, direction: Vector) -> None:
        """Raise ``SingularityError`` at states where the angle has no rate."""

    def _direction(self, at: PositionKinematics) -> np.ndarray:
        return at.rotation(self._frame)[..., self._axis]

    def _turning(self, at: PositionKinematics) -> np.ndarray:
        """Jacobian (..., 3, nv) of the angular velocity w."""
        return at.jacobian(self._frame)[..., 3:, :]

    def _turning_dot(self, at: VelocityKinematics) -> np.ndarray:
        """Rate of this Jacobian along v."""
        return at.jacobian_dot(self._frame)[..., 3:, :]

    def _velocity(self, at: VelocityKinematics) -> np.ndarray:
        """Angular velocity w (..., 3)."""
        return at.velocity(self._frame)[..., 3:]

    def _acceleration(self, at: VelocityKinematics) -> np.ndarray:
        """Rate of the angular velocity (..., 3)."""
        return at.acceleration(self._frame)[..., 3:]

    def _gradients(self, at: VelocityKinematics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives (3, nv) of direction, angular velocity and angular acceleration by q."""
        motion, turning = at.frame_gradients(self._frame), at.jacobian(self._frame)[3:]
        return -pin.skew(self._direction(at)) @ turning, motion.angular_velocity, motion.angular_acceleration

    def _defined(self, at: PositionKinematics) -> Vector:
        direction = components(self._direction(at))
        self._check_defined(at, direction)
        return direction

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        direction = self._defined(at)
        return packed([self._form(direction)], direction[0]) @ self._turning(at)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        direction = self._defined(at)
        rate = cross(components(self._velocity(at)), direction)
        form, form_rate = (
            packed([each], direction[0]) for each in (self._form(direction), self._form_rate(direction, rate))
        )
        return form @ self._turning_dot(at) + form_rate @ self._turning(at)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        velocity, acceleration = components(self._velocity(at)), components(self._acceleration(at))
        return np.asarray(self._bias_acceleration(self._defined(at), velocity, acceleration))[..., None]

    def _bias_acceleration(self, direction: Vector, velocity: Vector, acceleration: Vector) -> Component:
        """Second derivative of the angle, ``c . wdot + cdot . w``."""
        form_rate = self._form_rate(direction, cross(velocity, direction))
        return dot(self._form(direction), acceleration) + dot(form_rate, velocity)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        parts = self._direction(at).copy(), self._velocity(at), self._acceleration(at)
        pairs = zip(parts, self._gradients(at), strict=True)
        return complex_step(lambda *shifted: np.array([self._bias_acceleration(*shifted)]), *pairs)
