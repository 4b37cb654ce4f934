"""Controllers: one file each, one protocol, gains beside them."""

from rnc_pin.control.computed_torque import ComputedTorque
from rnc_pin.control.gains import PositionGains, VelocityGains
from rnc_pin.control.jacobian_transpose import JacobianTransposeController
from rnc_pin.control.position_tracker import PositionState, PositionTracker
from rnc_pin.control.protocol import Command, Controller, KinematicController, VelocityTarget
from rnc_pin.control.reducing import ReducingOutputController
from rnc_pin.control.redundancy import RedundancyController
from rnc_pin.control.velocity_tracker import TrackerState, VelocityTracker

__all__ = [
    "Command",
    "ComputedTorque",
    "Controller",
    "JacobianTransposeController",
    "KinematicController",
    "PositionGains",
    "PositionState",
    "PositionTracker",
    "ReducingOutputController",
    "RedundancyController",
    "TrackerState",
    "VelocityGains",
    "VelocityTarget",
    "VelocityTracker",
]
