"""Exports of ``rnc_pin.motion.planning``, which ``__init__.py`` imports at their first use."""

from rnc_pin.model.task import OutputTarget as OutputTarget
from rnc_pin.references.reference import RELATIVE_REFERENCES as RELATIVE_REFERENCES
from rnc_pin.references.reference import Geodesic as Geodesic
from rnc_pin.references.reference import Harmonic as Harmonic
from rnc_pin.references.reference import Hold as Hold
from rnc_pin.references.reference import InTurn as InTurn
from rnc_pin.references.reference import Joined as Joined
from rnc_pin.references.reference import MinimumJerk as MinimumJerk
from rnc_pin.references.reference import Reference as Reference
from rnc_pin.references.reference import ReferencePoint as ReferencePoint
from rnc_pin.references.reference import RelativeCircle as RelativeCircle
from rnc_pin.references.reference import RelativeHarmonic as RelativeHarmonic
from rnc_pin.references.reference import RelativeHold as RelativeHold
from rnc_pin.references.reference import RelativeMinimumJerk as RelativeMinimumJerk
from rnc_pin.references.reference import RelativeReference as RelativeReference
from rnc_pin.references.reference import RelativeTable as RelativeTable
from rnc_pin.references.reference import RelativeViaPoints as RelativeViaPoints
from rnc_pin.references.reference import TaskReference as TaskReference
from rnc_pin.references.reference import ViaPoints as ViaPoints

from .car_path import CarPath as CarPath
from .car_path import Leg as Leg
from .car_path import SteeringGeometry as SteeringGeometry
from .car_path import continued_back as continued_back
from .car_path import path_distances as path_distances
from .inverse_kinematics import IkResult as IkResult
from .inverse_kinematics import IkSearch as IkSearch
from .inverse_kinematics import solve_ik as solve_ik
from .way import NarrowPlace as NarrowPlace
from .way import Way as Way
from .way import WayInfo as WayInfo
from .way_finding import WaySettings as WaySettings
from .way_finding import find_steering as find_steering
from .way_finding import find_way as find_way
