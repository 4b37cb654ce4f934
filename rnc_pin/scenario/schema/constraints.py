"""Constraints in a scenario file: each kind knows what it builds."""

from __future__ import annotations

from typing import Annotated

from pydantic import Tag

from rnc_pin.constraints import MomentumConservation, NoSideSlip, RollingWheel
from rnc_pin.rows import ConstraintKind
from rnc_pin.scenario.schema.base import BY_KIND, Axis, Positive, Strict


class Momentum(Strict):
    """Zero momentum of an unactuated base joint."""

    momentum: str

    def build(self) -> ConstraintKind:
        return MomentumConservation(self.momentum)


class _SlipArguments(Strict):
    frame: str
    axis: Axis = "y"


class SideSlip(Strict):
    """A knife edge."""

    no_side_slip: _SlipArguments

    def build(self) -> ConstraintKind:
        return NoSideSlip(self.no_side_slip.frame, self.no_side_slip.axis)


class _WheelArguments(Strict):
    frame: str
    radius: Positive
    axis: Axis | None = None


class Wheel(Strict):
    """A wheel that rolls on the plane z = 0."""

    rolling_wheel: _WheelArguments

    def build(self) -> ConstraintKind:
        return RollingWheel(self.rolling_wheel.frame, self.rolling_wheel.radius, self.rolling_wheel.axis)


Constraint = Annotated[
    Annotated[Momentum, Tag("momentum")]
    | Annotated[SideSlip, Tag("no_side_slip")]
    | Annotated[Wheel, Tag("rolling_wheel")],
    BY_KIND,
]
