"""Constraints ``A(q) v = 0``: one file a kind."""

from rnc_pin.constraints.momentum import MomentumConservation
from rnc_pin.constraints.no_side_slip import NoSideSlip
from rnc_pin.constraints.pfaffian import Pfaffian
from rnc_pin.constraints.rolling_wheel import RollingWheel

__all__ = ["MomentumConservation", "NoSideSlip", "Pfaffian", "RollingWheel"]
