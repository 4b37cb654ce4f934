"""Plants that move as the reduced model."""

from rnc_pin.plants.reduced.constrained_dynamics import ConstrainedDynamics, integrated_outputs
from rnc_pin.plants.reduced.contact_plant import ContactEvent, ContactPlant
from rnc_pin.plants.reduced.plant_batch import ReducedPlantBatch
from rnc_pin.plants.reduced.reduced_plant import Checkpoint, ReducedPlant
from rnc_pin.plants.reduced.unilateral_contact import UnilateralContact
from rnc_pin.plants.reduced.velocity_plant import VelocityPlant

__all__ = [
    "Checkpoint",
    "ConstrainedDynamics",
    "ContactEvent",
    "ContactPlant",
    "ReducedPlant",
    "ReducedPlantBatch",
    "UnilateralContact",
    "VelocityPlant",
    "integrated_outputs",
]
