"""Angle of a frame's axis about an axis of another frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.math.components import Entry
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.relative_rows import RelativeOutputRows
from rnc_pin.model.rows import OutputRows
from rnc_pin.outputs.direction_angle import DirectionAngleRow, level, yaw_wrench
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class RelativeAngle:
    """Angle of a frame's own axis about an axis of another frame [rad], in (-pi, pi].

    It is measured in the plane normal to ``about``: zero along the reference's next axis (x for "z", y for "x", z for
    "y"), positive by the right-hand rule. For the world as reference and ``about="z"`` it is ``FrameYaw``.

    Args:
        frame: name of the frame.
        reference: name of the other frame, or "universe" for the world.
        axis: the frame's own axis, "x", "y" or "z".
        about: the axis of the reference, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(vertical=[rnc.RelativeAngle("tip", "platform_body")])
        >>> x1, _ = reduced.at(robot.configuration({"joint_1": 0.4, "joint_2": -1.0})).outputs()
        >>> x1.round(3)
        array([-0.6])
    """

    frame: str
    reference: str
    axis: Axis = "x"
    about: Axis = "z"

    def bind(self, robot: Robot) -> OutputRows:
        reference = robot.frame_id(self.reference)
        if reference == robot.frame_id(self.frame):
            raise ConfigurationError(f"angle of frame '{self.frame}' relative to itself: name another reference")
        return RelativeOutputRows(_AngleRow(self, robot), reference)


class _AngleRow(DirectionAngleRow):
    """Yaw of a direction if the axes are ordered so that the third is the axis ``about``."""

    angular = (True,)
    undefined = "an angle about an axis is not defined for a direction along it"

    def __init__(self, kind: RelativeAngle, robot: Robot) -> None:
        super().__init__(robot, kind.frame, kind.axis)
        last = axis_index(kind.about)
        self._order = [(last + 1) % 3, (last + 2) % 3, last]
        self.names = (f"{kind.frame}_angle_{kind.axis}_about_{kind.reference}_{kind.about}",)

    def _ordered(self, direction: Sequence[Entry]) -> list[Entry]:
        return [direction[k] for k in self._order]

    def regularity(self, *directions: Sequence[Entry]) -> Entry:
        return level(self._ordered(directions[0]))

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        wrench = yaw_wrench(self._ordered(directions[0]))
        return [[*wrench[:3], *(wrench[3 + self._order.index(k)] for k in range(3))]]

    def value(self, at: PositionKinematics) -> np.ndarray:
        x, y, _ = np.moveaxis(self._direction(at)[..., self._order], -1, 0)
        return np.arctan2(y, x)[..., None]
