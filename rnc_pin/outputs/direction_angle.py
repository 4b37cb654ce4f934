"""Angles of a frame's axis: outputs whose rate is a linear form on the frame's angular velocity."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from rnc_pin.math.components import Component, components, cross, packed
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
    def _second(self, direction: Vector, first: Vector, second: Vector) -> Component:
        """Second derivative of the angle from the first and second derivatives of the direction."""

    @abstractmethod
    def _check_defined(self, at: PositionKinematics, direction: Vector) -> None:
        """Raise ``SingularityError`` at states where the angle has no rate."""

    def _direction(self, at: PositionKinematics) -> np.ndarray:
        return at.rotation(self._frame)[..., self._axis]

    def _defined(self, at: PositionKinematics) -> Vector:
        direction = components(self._direction(at))
        self._check_defined(at, direction)
        return direction

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        direction = self._defined(at)
        form = packed([self._form(direction)], direction[0])
        return form @ at.jacobian(self._frame)[..., 3:, :]

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        direction = self._defined(at)
        rate = cross(components(at.velocity(self._frame)[..., 3:]), direction)
        form, form_rate = (
            packed([each], direction[0]) for each in (self._form(direction), self._form_rate(direction, rate))
        )
        return form @ at.jacobian_dot(self._frame)[..., 3:, :] + form_rate @ at.jacobian(self._frame)[..., 3:, :]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        direction = self._defined(at)
        velocity, acceleration = (
            components(each[..., 3:]) for each in (at.velocity(self._frame), at.acceleration(self._frame))
        )
        return np.asarray(self._bias_acceleration(direction, velocity, acceleration))[..., None]

    def _bias_acceleration(self, direction: Vector, velocity: Vector, acceleration: Vector) -> Component:
        """Second derivative of the angle, from the angular velocity and acceleration of the frame."""
        first = cross(velocity, direction)
        second = [a + b for a, b in zip(cross(acceleration, direction), cross(velocity, first), strict=True)]
        return self._second(direction, first, second)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        direction, motion = self._direction(at).copy(), at.frame_gradients(self._frame)
        direction_q = -_skew(direction) @ at.jacobian(self._frame)[3:]
        return complex_step(
            lambda *parts: np.array([self._bias_acceleration(*parts)]),
            (direction, direction_q),
            (at.velocity(self._frame)[3:], motion.angular_velocity),
            (at.acceleration(self._frame)[3:], motion.angular_acceleration),
        )


def _skew(vector: np.ndarray) -> np.ndarray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
