"""Plants: controlled systems with actuator inputs and measured states, and wrappers for faults and mid-run changes."""

from rnc_pin.plants.changing import ChangingPlant
from rnc_pin.plants.faults import Faults, FaultyPlant
from rnc_pin.plants.plant import Plant
from rnc_pin.plants.reduced import (
    ContactEvent,
    ContactPlant,
    ReducedPlant,
    ReducedPlantBatch,
    UnilateralContact,
    VelocityPlant,
)

__all__ = [
    "ChangingPlant",
    "ContactEvent",
    "ContactPlant",
    "Faults",
    "FaultyPlant",
    "Plant",
    "ReducedPlant",
    "ReducedPlantBatch",
    "UnilateralContact",
    "VelocityPlant",
]
