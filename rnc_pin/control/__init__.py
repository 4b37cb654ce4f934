"""Controllers: one file each, one protocol, gains beside them."""

from rnc_pin.control.gains import VelocityGains
from rnc_pin.control.protocol import Command, Controller, KinematicController, VelocityTarget
from rnc_pin.control.reducing import ReducingOutputController
from rnc_pin.control.redundancy import RedundancyController
from rnc_pin.control.velocity_tracker import TrackerState, VelocityTracker

__all__ = [
    "Command",
    "Controller",
    "KinematicController",
    "ReducingOutputController",
    "RedundancyController",
    "TrackerState",
    "VelocityGains",
    "VelocityTarget",
    "VelocityTracker",
]
