"""Plants that move as the reduced model."""

from rnc_pin.plants.reduced.constrained_dynamics import ConstrainedDynamics, integrated_outputs
from rnc_pin.plants.reduced.plant_batch import ReducedPlantBatch
from rnc_pin.plants.reduced.reduced_plant import Checkpoint, ReducedPlant
from rnc_pin.plants.reduced.velocity_plant import VelocityPlant

__all__ = [
    "Checkpoint",
    "ConstrainedDynamics",
    "ReducedPlant",
    "ReducedPlantBatch",
    "VelocityPlant",
    "integrated_outputs",
]
