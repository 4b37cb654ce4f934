"""Speed of a frame along its own axis: a quasi-velocity."""

from __future__ import annotations

from dataclasses import dataclass

from rnc_pin.model.frame_velocity import FrameVelocityRows, axis_index
from rnc_pin.model.kinematics import OWN_AXES
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class FrameSpeed:
    """Velocity of a frame's origin along the frame's own axis [m/s], e.g. a vehicle's forward speed.

    It is a quasi-velocity, not the rate of a coordinate: in a trajectory, ``x2`` contains its integral over time.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> reduced.reducing.names, reduced.reducing.quasi  # a speed is the rate of no coordinate, a yaw rate is
        (('sleigh_speed_x', 'sleigh_yaw'), array([ True, False]))
    """

    frame: str
    axis: Axis = "x"

    def bind(self, robot: Robot) -> OutputRows:
        return _SpeedRow(self, robot)


class _SpeedRow(FrameVelocityRows, OutputRows):
    quasi = True

    def __init__(self, kind: FrameSpeed, robot: Robot) -> None:
        super().__init__(robot, kind.frame, (axis_index(kind.axis),), OWN_AXES)
        self.names = (f"{kind.frame}_speed_{kind.axis}",)
        self.angular = (False,)
