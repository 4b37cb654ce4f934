"""Angular velocity of a frame relative to another, about an axis of the first: a quasi-velocity."""

from __future__ import annotations

from dataclasses import dataclass

from rnc_pin.model.frame_velocity import FrameVelocityRows, axis_index
from rnc_pin.model.kinematics import OWN_AXES
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.relative_rows import RelativeOutputRows
from rnc_pin.model.rows import OutputRows
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


class _AngularVelocityRow(FrameVelocityRows, OutputRows):
    quasi = True
    angular = (False,)

    def __init__(self, kind: RelativeAngularVelocity, robot: Robot) -> None:
        super().__init__(robot, kind.frame, (3 + axis_index(kind.axis),), OWN_AXES)
        self.names = (f"{kind.frame}_angular_velocity_{kind.axis}_of_{kind.reference}",)
