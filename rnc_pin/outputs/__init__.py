"""Reducing and vertical outputs: one file for each kind."""

from rnc_pin.outputs.center_of_mass import CenterOfMass
from rnc_pin.outputs.custom import Output
from rnc_pin.outputs.distance import Distance
from rnc_pin.outputs.frame_angular_velocity import FrameAngularVelocity
from rnc_pin.outputs.frame_orientation import FrameOrientation
from rnc_pin.outputs.frame_position import FramePosition
from rnc_pin.outputs.frame_speed import FrameSpeed
from rnc_pin.outputs.frame_tilt import FrameTilt
from rnc_pin.outputs.frame_yaw import FrameYaw
from rnc_pin.outputs.joint_position import JointPosition
from rnc_pin.outputs.relative_angle import RelativeAngle
from rnc_pin.outputs.relative_angular_velocity import RelativeAngularVelocity

__all__ = [
    "CenterOfMass",
    "Distance",
    "FrameAngularVelocity",
    "FrameOrientation",
    "FramePosition",
    "FrameSpeed",
    "FrameTilt",
    "FrameYaw",
    "JointPosition",
    "Output",
    "RelativeAngle",
    "RelativeAngularVelocity",
]
