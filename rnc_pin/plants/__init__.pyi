"""Exports of ``rnc_pin.plants``, which ``__init__.py`` imports at their first use."""

from ..lab.contacts.contact_impulses import UnilateralContact as UnilateralContact
from ..lab.contacts.contact_plant import ContactPlant as ContactPlant
from ..lab.faults import ChangingPlant as ChangingPlant
from ..lab.faults import Faults as Faults
from ..lab.faults import FaultyPlant as FaultyPlant
from ..lab.faults import MassErrors as MassErrors
from ..lab.faults import StuckJoint as StuckJoint
from . import mujoco as mujoco
from .plant import ContactEvent as ContactEvent
from .plant import Plant as Plant
from .plant import PlantReport as PlantReport
from .reduced_plant import ReducedPlant as ReducedPlant
from .velocity_plant import VelocityPlant as VelocityPlant
