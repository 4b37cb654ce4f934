"""Angular velocity of a frame about its own axis: a quasi-velocity."""

from __future__ import annotations

from dataclasses import dataclass

from rnc_pin.model.frame_velocity import FrameVelocityRows, axis_index
from rnc_pin.model.kinematics import OWN_AXES
from rnc_pin.model.rows import OutputRows
from rnc_pin.model.values import Axis
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class FrameSpin:
    """Angular velocity of a frame about the frame's own axis [rad/s], e.g. the roll rate of a bicycle.

    It is a quasi-velocity, not the rate of a coordinate: in a trajectory, ``x2`` contains its integral over time.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", 0.3)])
        >>> reduced = system.reduce([rnc.FrameSpin("ball", axis) for axis in "xyz"])
        >>> reduced.reducing.names
        ('ball_spin_x', 'ball_spin_y', 'ball_spin_z')
    """

    frame: str
    axis: Axis = "z"

    def bind(self, robot: Robot) -> OutputRows:
        return _SpinRow(self, robot)


class _SpinRow(FrameVelocityRows, OutputRows):
    quasi = True

    def __init__(self, kind: FrameSpin, robot: Robot) -> None:
        super().__init__(robot, kind.frame, (3 + axis_index(kind.axis),), OWN_AXES)
        self.names = (f"{kind.frame}_spin_{kind.axis}",)
        self.angular = (False,)
