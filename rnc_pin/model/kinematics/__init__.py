"""Kinematics: from states to arrays over leading axes."""

from rnc_pin.model.kinematics.kinematics import Kinematics
from rnc_pin.model.kinematics.quantities import (
    ALL,
    OWN_AXES,
    WORLD_AXES,
    Components,
    Motion,
    Placement,
    Position,
    Rates,
    over_states,
)
from rnc_pin.model.kinematics.single_state import FrameGradients, Gradients

__all__ = [
    "ALL",
    "OWN_AXES",
    "WORLD_AXES",
    "Components",
    "FrameGradients",
    "Gradients",
    "Kinematics",
    "Motion",
    "Placement",
    "Position",
    "Rates",
    "over_states",
]
