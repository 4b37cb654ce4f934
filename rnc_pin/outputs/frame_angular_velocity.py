"""Angular velocity of a frame about its own axis or a world axis: a quasi-velocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.model.frame_velocity import FrameVelocityRows, axis_index
from rnc_pin.model.kinematics import OWN_AXES, WORLD_AXES
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class FrameAngularVelocity:
    """Angular velocity of a frame about its own axis [rad/s], e.g. the roll rate of a bicycle, or about a world axis.

    It is a quasi-velocity, not the rate of a coordinate: in a trajectory, ``x2`` contains its integral over time.

    Args:
        frame: name of the frame.
        axis: "x", "y" or "z".
        axes: "own" for the frame's own axis, "world" for an axis of the world.

    Raises:
        ConfigurationError: unknown axis or axes.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", 0.3)])
        >>> reduced = system.reduce([rnc.FrameAngularVelocity("ball", axis) for axis in "xyz"])
        >>> reduced.reducing.names
        ('ball_angular_velocity_x', 'ball_angular_velocity_y', 'ball_angular_velocity_z')
    """

    frame: str
    axis: Axis = "z"
    axes: Literal["own", "world"] = "own"

    def bind(self, robot: Robot) -> OutputRows:
        return _AngularVelocityRow(self, robot)


class _AngularVelocityRow(FrameVelocityRows, OutputRows):
    quasi = True

    def __init__(self, kind: FrameAngularVelocity, robot: Robot) -> None:
        if kind.axes not in ("own", "world"):
            found = nearest(str(kind.axes), ["own", "world"])
            raise ConfigurationError(f"angular velocity of '{kind.frame}': axes '{kind.axes}' is not known{found}")
        own = kind.axes == "own"
        super().__init__(robot, kind.frame, (3 + axis_index(kind.axis),), OWN_AXES if own else WORLD_AXES)
        self.names = (f"{kind.frame}_angular_velocity_{'' if own else 'world_'}{kind.axis}",)
        self.angular = (False,)
