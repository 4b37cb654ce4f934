"""Exports of ``rnc_pin.plants``, which ``__init__.py`` imports at their first use."""

from .faults import Faults as Faults
from .faults import FaultyPlant as FaultyPlant
from .plant import Plant as Plant
from .plant import PlantReport as PlantReport
from .reduced import ContactEvent as ContactEvent
from .reduced import ContactPlant as ContactPlant
from .reduced import ReducedPlant as ReducedPlant
from .reduced import UnilateralContact as UnilateralContact
from .reduced import VelocityPlant as VelocityPlant
from .robot_changes import ChangingPlant as ChangingPlant
from .robot_changes import MassErrors as MassErrors
from .robot_changes import StuckJoint as StuckJoint
