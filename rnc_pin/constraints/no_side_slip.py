"""Knife edge: no velocity along one of a frame's own axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.model.frame_velocity import FrameVelocityRows, axis_index
from rnc_pin.model.kinematics import OWN_AXES, Position
from rnc_pin.model.rows import Rows
from rnc_pin.model.values import Axis
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class NoSideSlip:
    """The origin of a frame does not move along the frame's own axis: a skate, an axle without slip.

    Nonholonomic on a body that can turn.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> reduced.at(robot.configuration()).A.round(3)
        array([[0., 1., 0.]])
    """

    frame: str
    axis: Axis = "y"

    def bind(self, robot: Robot) -> Rows:
        return _NoSideSlipRow(self, robot)


class _NoSideSlipRow(FrameVelocityRows):
    def __init__(self, kind: NoSideSlip, robot: Robot) -> None:
        self._axis = axis_index(kind.axis)
        super().__init__(robot, kind.frame, (self._axis,), OWN_AXES)
        self.names = (f"no_side_slip({kind.frame}.{kind.axis})",)

    def lines_of_action(self, at: Position) -> tuple[np.ndarray, np.ndarray]:
        placement = at.placement(self._frame)
        return placement.translation[..., None, :].copy(), placement.rotation[..., :, self._axis][..., None, :].copy()
