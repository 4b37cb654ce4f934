"""Tilt of a frame's own axis above the horizontal plane."""

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
class FrameTilt:
    """Angle of a frame's own axis above the horizontal plane [rad], in (-pi/2, pi/2), e.g. of a leaning wheel's axle.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".

    Raises:
        SingularityError: during evaluation, the axis is vertical, so that the tilt has no rate.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", 0.3, axis="y")])
        >>> reduced = system.reduce(vertical=[rnc.FrameTilt("disk", "y")])
        >>> lean = robot.configuration({"root_joint": [0, 0, 0.3, np.sin(0.1), 0, 0, np.cos(0.1)]})  # by 0.2 rad
        >>> reduced.at(lean).outputs()[0].round(3)
        array([0.2])
    """

    frame: str
    axis: Axis = "y"

    def bind(self, robot: Robot) -> OutputRows:
        return _TiltRow(self, robot)


class _TiltRow(DirectionAngleRow):
    def __init__(self, kind: FrameTilt, robot: Robot) -> None:
        super().__init__(robot, kind.frame, kind.axis)
        self.names = (f"{kind.frame}_tilt_{kind.axis}",)
        self.angular = (False,)

    def value(self, at: PositionKinematics) -> np.ndarray:
        x, y, z = np.moveaxis(self._direction(at), -1, 0)
        return np.arctan2(z, np.hypot(x, y))[..., None]

    def _form(self, direction: Vector) -> Vector:
        # Angular velocity about the horizontal line perpendicular to the axis: rate = (w x axis)_z / level.
        x, y, _ = direction
        level = (x * x + y * y) ** 0.5
        return y / level, -x / level, 0.0

    def _form_rate(self, direction: Vector, rate: Vector) -> Vector:
        x, y, z = direction
        dx, dy, dz = rate
        square = x * x + y * y
        level, grows = square**0.5, z * dz / square
        return (dy + y * grows) / level, -(dx + x * grows) / level, 0.0

    def _check_defined(self, at: PositionKinematics, direction: Vector) -> None:
        level = (direction[0] * direction[0] + direction[1] * direction[1]) ** 0.5
        check_defined("the tilt of a vertical axis has no rate", at, level, _VERTICAL, self.names)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return [KernelRow(Form.TILT, (attached(model, self._frame),), (self._axis,), value=(Value.ELEVATION, 0))]
