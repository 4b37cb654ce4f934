"""Exports of ``rnc_pin.outputs``, which ``__init__.py`` imports at their first use."""

from .frame_outputs import FrameAngularVelocity as FrameAngularVelocity
from .frame_outputs import FrameOrientation as FrameOrientation
from .frame_outputs import FramePosition as FramePosition
from .frame_outputs import FrameSpeed as FrameSpeed
from .frame_outputs import FrameTilt as FrameTilt
from .frame_outputs import FrameYaw as FrameYaw
from .robot_outputs import CenterOfMass as CenterOfMass
from .robot_outputs import Distance as Distance
from .robot_outputs import JointPosition as JointPosition
from .robot_outputs import Output as Output
from .robot_outputs import velocity_outputs as velocity_outputs
