"""Exports of ``rnc_pin.outputs``, which ``__init__.py`` imports at their first use."""

from .kinds import CenterOfMass as CenterOfMass
from .kinds import Distance as Distance
from .kinds import FrameAngularVelocity as FrameAngularVelocity
from .kinds import FrameOrientation as FrameOrientation
from .kinds import FramePosition as FramePosition
from .kinds import FrameSpeed as FrameSpeed
from .kinds import FrameTilt as FrameTilt
from .kinds import FrameYaw as FrameYaw
from .kinds import JointPosition as JointPosition
from .kinds import Output as Output
from .kinds import velocity_outputs as velocity_outputs
