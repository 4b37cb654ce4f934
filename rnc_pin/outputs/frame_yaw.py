"""Heading of a frame in the world."""

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
from rnc_pin.outputs.direction_angle import DirectionAngleRow, yaw_wrench
from rnc_pin.robots.robot import Robot


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


class _FrameYawRow(DirectionAngleRow):
    angular = (True,)
    undefined = "a yaw is not defined for a vertical axis"

    def __init__(self, kind: FrameYaw, robot: Robot) -> None:
        super().__init__(robot, kind.frame, kind.axis)
        self.names = (f"{kind.frame}_yaw" + ("" if kind.axis == "x" else f"_{kind.axis}"),)

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        return [yaw_wrench(directions[0])]

    def value(self, at: PositionKinematics) -> np.ndarray:
        x, y, _ = np.moveaxis(self._direction(at), -1, 0)
        return np.arctan2(y, x)[..., None]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        numbers = self.directions[:, 0].tolist()
        return [KernelRow(Form.YAW, (attached(model, self.frame),), (self._axis,), numbers, value=(Value.HEADING, 0))]
