"""Heading of a frame in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.model.kernel_rows import Form, KernelRow, Value, attached
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.rows import OutputRows, check_defined
from rnc_pin.outputs.direction_angle import DirectionAngleRow, Vector
from rnc_pin.robots.robot import Robot

_VERTICAL = 1e-6


@dataclass(frozen=True)
class FrameYaw:
    """Angle of a frame's own axis in the world's x-y plane [rad], in (-pi, pi].

    It is exact in three dimensions too, if the axis is not vertical.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z"; for a wheel that turns with its frame, the axle.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce(vertical=[rnc.FrameYaw("sleigh")])
        >>> x1, _ = reduced.at(robot.configuration({"root_joint": [0.0, 0.0, 0.7]})).outputs()
        >>> x1.round(3)
        array([0.7])
    """

    frame: str
    axis: Axis = "x"

    def bind(self, robot: Robot) -> OutputRows:
        return _FrameYawRow(self, robot)


class YawRow(DirectionAngleRow):
    """Angle of a direction in the plane of the first two axes."""

    angular = (True,)

    def value(self, at: PositionKinematics) -> np.ndarray:
        x, y, _ = np.moveaxis(self._direction(at), -1, 0)
        return np.arctan2(y, x)[..., None]

    def _form(self, direction: Vector) -> Vector:
        x, y, z = direction
        square = x * x + y * y
        return -z * x / square, -z * y / square, 1.0

    def _form_rate(self, direction: Vector, rate: Vector) -> Vector:
        x, y, z = direction
        dx, dy, dz = rate
        square = x * x + y * y
        grows = 2 * (x * dx + y * dy) / square
        return (z * x * grows - dz * x - z * dx) / square, (z * y * grows - dz * y - z * dy) / square, 0.0


class _FrameYawRow(YawRow):
    def __init__(self, kind: FrameYaw, robot: Robot) -> None:
        super().__init__(robot, kind.frame, kind.axis)
        self.names = (f"{kind.frame}_yaw" + ("" if kind.axis == "x" else f"_{kind.axis}"),)

    def _check_defined(self, at: PositionKinematics, direction: Vector) -> None:
        level = (direction[0] * direction[0] + direction[1] * direction[1]) ** 0.5
        check_defined("a yaw is not defined for a vertical axis", at, level, _VERTICAL, self.names)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return [KernelRow(Form.YAW, (attached(model, self._frame),), (self._axis,), value=(Value.HEADING, 0))]
