"""Forces that follow from the state: springs, dampers, friction, wrenches, laws of a user; one file for each kind."""

from rnc_pin.forces.damper import Damper
from rnc_pin.forces.force_function import ForceFunction
from rnc_pin.forces.force_law import ForceLaw
from rnc_pin.forces.smooth_friction import SmoothFriction
from rnc_pin.forces.spring import Spring
from rnc_pin.forces.wrench import Wrench

__all__ = ["Damper", "ForceFunction", "ForceLaw", "SmoothFriction", "Spring", "Wrench"]
