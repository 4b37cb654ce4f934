"""Exports of ``rnc_pin.planning``, which ``__init__.py`` imports at their first use."""

from rnc_pin.model.task import OutputTarget as OutputTarget

from .car_path import CarPath as CarPath
from .car_path import Leg as Leg
from .car_path import continued_back as continued_back
from .car_path import path_distances as path_distances
from .chained_form import FireTruckChart as FireTruckChart
from .inverse_kinematics import IkResult as IkResult
from .inverse_kinematics import IkSearch as IkSearch
from .inverse_kinematics import solve_ik as solve_ik
from .references import Geodesic as Geodesic
from .references import Harmonic as Harmonic
from .references import Hold as Hold
from .references import InTurn as InTurn
from .references import Joined as Joined
from .references import MinimumJerk as MinimumJerk
from .references import Reference as Reference
from .references import ReferencePoint as ReferencePoint
from .references import Slowed as Slowed
from .references import TaskReference as TaskReference
from .references import ViaPoints as ViaPoints
from .relative_references import RelativeHarmonic as RelativeHarmonic
from .relative_references import RelativeHold as RelativeHold
from .relative_references import RelativeMinimumJerk as RelativeMinimumJerk
from .relative_references import RelativeReference as RelativeReference
from .relative_references import RelativeViaPoints as RelativeViaPoints
from .steering_detection import SteeringGeometry as SteeringGeometry
from .steering_detection import find_steering as find_steering
from .way import Way as Way
from .way import WayInfo as WayInfo
from .way_checking import NarrowPlace as NarrowPlace
from .way_finding import WaySettings as WaySettings
from .way_finding import find_way as find_way
