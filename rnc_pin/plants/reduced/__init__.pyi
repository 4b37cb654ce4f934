"""Exports of ``rnc_pin.plants.reduced``, which ``__init__.py`` imports at their first use."""

from rnc_pin.model.integrators.runge_kutta import DEFAULT_TOLERANCE as DEFAULT_TOLERANCE

from .constrained_dynamics import ConstrainedDynamics as ConstrainedDynamics
from .constrained_dynamics import integrated_outputs as integrated_outputs
from .contact_plant import ContactEvent as ContactEvent
from .contact_plant import ContactPlant as ContactPlant
from .reduced_plant import Checkpoint as Checkpoint
from .reduced_plant import ReducedPlant as ReducedPlant
from .step_control import IntegrationErrors as IntegrationErrors
from .unilateral_contact import UnilateralContact as UnilateralContact
from .velocity_plant import VelocityPlant as VelocityPlant
