"""Exports of ``rnc_pin.outputs``, which ``__init__.py`` imports at their first use."""

from .center_of_mass import CenterOfMass as CenterOfMass
from .custom import Output as Output
from .distance import Distance as Distance
from .frame_angular_velocity import FrameAngularVelocity as FrameAngularVelocity
from .frame_orientation import FrameOrientation as FrameOrientation
from .frame_position import FramePosition as FramePosition
from .frame_speed import FrameSpeed as FrameSpeed
from .frame_tilt import FrameTilt as FrameTilt
from .frame_yaw import FrameYaw as FrameYaw
from .joint_position import JointPosition as JointPosition
from .relative_angle import RelativeAngle as RelativeAngle
from .relative_angular_velocity import RelativeAngularVelocity as RelativeAngularVelocity
