"""Tilt of a frame's own axis above the horizontal plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.math.components import Entry
from rnc_pin.model.kernel_rows import Form, KernelRow, Value, attached
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.rows import OutputRows
from rnc_pin.outputs.direction_angle import DirectionAngleRow, tilt_wrench
from rnc_pin.robots.robot import Robot


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
    angular = (False,)
    undefined = "the tilt of a vertical axis has no rate"

    def __init__(self, kind: FrameTilt, robot: Robot) -> None:
        super().__init__(robot, kind.frame, kind.axis)
        self.names = (f"{kind.frame}_tilt_{kind.axis}",)

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        return [tilt_wrench(directions[0])]

    def value(self, at: PositionKinematics) -> np.ndarray:
        x, y, z = np.moveaxis(self._direction(at), -1, 0)
        return np.arctan2(z, np.hypot(x, y))[..., None]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        numbers = self.directions[:, 0].tolist()
        return [
            KernelRow(Form.TILT, (attached(model, self.frame),), (self._axis,), numbers, value=(Value.ELEVATION, 0))
        ]
