"""Plant that integrates the reduced model."""

from rnc_pin.plants.reduced.constrained_dynamics import ConstrainedDynamics, integrated_outputs
from rnc_pin.plants.reduced.reduced_plant import ReducedPlant

__all__ = ["ConstrainedDynamics", "ReducedPlant", "integrated_outputs"]
