"""Angular velocity of a frame relative to another, about an axis of the first: a quasi-velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.math.components import Entry
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kernel_rows import Form, KernelRow, attached, component_rows
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.relative_rows import RelativeOutputRows
from rnc_pin.model.rows import OutputRows
from rnc_pin.model.wrench_rows import DirectionRows
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
        return RelativeOutputRows(_AngularVelocityRow(self, robot), robot.frame_id(self.reference))


class _AngularVelocityRow(DirectionRows, OutputRows):
    quasi = True
    units = ("rad/s",)
    angular = (False,)

    def __init__(self, kind: RelativeAngularVelocity, robot: Robot) -> None:
        self.names = (f"{kind.frame}_angular_velocity_{kind.axis}_of_{kind.reference}",)
        self.frame, self._axis = robot.frame_id(kind.frame), axis_index(kind.axis)
        self.directions = np.eye(3)[:, [self._axis]]

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        return [[0.0, 0.0, 0.0, *directions[0]]]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return component_rows(Form.OWN, attached(model, self.frame), [3 + self._axis])
