"""Reference trajectories and path planning for outputs."""

from rnc_pin.planning.car_path import CarPath
from rnc_pin.planning.chained_form import FireTruckChart
from rnc_pin.planning.geodesic import Geodesic
from rnc_pin.planning.inverse_kinematics import IkResult, solve_ik
from rnc_pin.planning.leg import Leg
from rnc_pin.planning.references import (
    Harmonic,
    Hold,
    InTurn,
    Joined,
    MinimumJerk,
    Reference,
    ReferencePoint,
    Slowed,
    TaskReference,
    ViaPoints,
)
from rnc_pin.planning.steering_geometry import SteeringGeometry

__all__ = [
    "CarPath",
    "FireTruckChart",
    "Geodesic",
    "Harmonic",
    "Hold",
    "IkResult",
    "InTurn",
    "Joined",
    "Leg",
    "MinimumJerk",
    "Reference",
    "ReferencePoint",
    "Slowed",
    "SteeringGeometry",
    "TaskReference",
    "ViaPoints",
    "solve_ik",
]
