"""Exports of ``rnc_pin.planning``, which ``__init__.py`` imports at their first use."""

from rnc_pin.model.task import OutputTarget as OutputTarget

from .car_path import CarPath as CarPath
from .car_path import Leg as Leg
from .car_path import continued_back as continued_back
from .car_path import path_distances as path_distances
from .inverse_kinematics import IkResult as IkResult
from .inverse_kinematics import IkSearch as IkSearch
from .inverse_kinematics import solve_ik as solve_ik
from .reference_kinds import RELATIVE_REFERENCES as RELATIVE_REFERENCES
from .reference_kinds import Geodesic as Geodesic
from .reference_kinds import Harmonic as Harmonic
from .reference_kinds import Hold as Hold
from .reference_kinds import MinimumJerk as MinimumJerk
from .reference_kinds import RelativeCircle as RelativeCircle
from .reference_kinds import RelativeHarmonic as RelativeHarmonic
from .reference_kinds import RelativeHold as RelativeHold
from .reference_kinds import RelativeMinimumJerk as RelativeMinimumJerk
from .reference_kinds import RelativeReference as RelativeReference
from .reference_kinds import RelativeTable as RelativeTable
from .reference_kinds import RelativeViaPoints as RelativeViaPoints
from .reference_kinds import ViaPoints as ViaPoints
from .references import InTurn as InTurn
from .references import Joined as Joined
from .references import Reference as Reference
from .references import ReferencePoint as ReferencePoint
from .references import TaskReference as TaskReference
from .steering_detection import SteeringGeometry as SteeringGeometry
from .steering_detection import find_steering as find_steering
from .way import Way as Way
from .way import WayInfo as WayInfo
from .way_checking import NarrowPlace as NarrowPlace
from .way_finding import WaySettings as WaySettings
from .way_finding import find_way as find_way
