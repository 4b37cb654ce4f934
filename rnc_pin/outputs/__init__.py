"""Reducing and vertical outputs: one file for each kind."""

from rnc_pin.outputs.custom import Output
from rnc_pin.outputs.distance import Distance
from rnc_pin.outputs.frame_orientation import FrameOrientation
from rnc_pin.outputs.frame_position import FramePosition
from rnc_pin.outputs.frame_speed import FrameSpeed
from rnc_pin.outputs.frame_spin import FrameSpin
from rnc_pin.outputs.frame_tilt import FrameTilt
from rnc_pin.outputs.frame_yaw import FrameYaw
from rnc_pin.outputs.joint_position import JointPosition

__all__ = [
    "Distance",
    "FrameOrientation",
    "FramePosition",
    "FrameSpeed",
    "FrameSpin",
    "FrameTilt",
    "FrameYaw",
    "JointPosition",
    "Output",
]
