"""Angles of a frame's axis: outputs whose rate is a linear form on the frame's angular velocity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rnc_pin.math.components import Entry
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.rows import OutputRows
from rnc_pin.model.wrench_rows import DirectionRows
from rnc_pin.robots.robot import Robot


def level(direction: Sequence[Entry]) -> Entry:
    """Length of the part of a direction along the first two axes."""
    x, y, _ = direction
    return (x * x + y * y) ** 0.5


def yaw_wrench(direction: Sequence[Entry]) -> list[Entry]:
    """Wrench (6,) whose power is the rate of the angle of a direction in the plane of the first two axes."""
    x, y, z = direction
    square = x * x + y * y
    return [0.0, 0.0, 0.0, -z * x / square, -z * y / square, 1.0]


def tilt_wrench(direction: Sequence[Entry]) -> list[Entry]:
    """Wrench (6,) whose power is the rate of the angle of a direction above this plane.

    It is a torque about the line in the plane that is perpendicular to the direction: ``rate = (w x d)_z / level``.
    """
    x, y, _ = direction
    length = level(direction)
    return [0.0, 0.0, 0.0, y / length, -x / length, 0.0]


class DirectionAngleRow(DirectionRows, OutputRows):
    """Output whose rate is the power of a wrench, a function of the direction of a frame's own axis.

    Args:
        robot: the robot that has the frame.
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".
    """

    units = ("rad/s",)

    def __init__(self, robot: Robot, frame: str, axis: str) -> None:
        self.frame, self._axis = robot.frame_id(frame), axis_index(axis)
        self.directions = np.eye(3)[:, [self._axis]]

    def regularity(self, *directions: Sequence[Entry]) -> Entry:
        return level(directions[0])

    def _direction(self, at: PositionKinematics) -> np.ndarray:
        return at.rotation(self.frame)[..., self._axis]
