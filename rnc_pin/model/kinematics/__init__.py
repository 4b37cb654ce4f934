"""Kinematics at states, as arrays over leading batch axes."""

from rnc_pin.model.kinematics.kinematics import Kinematics
from rnc_pin.model.kinematics.quantities import (
    ALL,
    OWN_AXES,
    WORLD_AXES,
    Components,
    Placement,
    PositionKinematics,
    RateKinematics,
    VelocityKinematics,
    over_states,
)
from rnc_pin.model.kinematics.single_state import FrameDerivatives, KinematicDerivatives

__all__ = [
    "ALL",
    "OWN_AXES",
    "WORLD_AXES",
    "Components",
    "FrameDerivatives",
    "KinematicDerivatives",
    "Kinematics",
    "Placement",
    "PositionKinematics",
    "RateKinematics",
    "VelocityKinematics",
    "over_states",
]
