"""Exports of ``rnc_pin.planning``, which ``__init__.py`` imports at their first use."""

from .car_path import CarPath as CarPath
from .chained_form import FireTruckChart as FireTruckChart
from .geodesic import Geodesic as Geodesic
from .inverse_kinematics import IkResult as IkResult
from .inverse_kinematics import solve_ik as solve_ik
from .leg import Leg as Leg
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
from .steering_geometry import SteeringGeometry as SteeringGeometry
