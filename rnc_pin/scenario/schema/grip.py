"""Friction between wheels and ground in a scenario file."""

from __future__ import annotations

from rnc_pin.scenario.schema.base import Positive, Strict


class GripSettings(Strict):
    """Friction of the ground. A reference that needs more friction causes a warning, is refused, or is slowed down."""

    friction: Positive
    """Coefficient of friction."""
    loads: dict[str, Positive] = {}
    """Frame of a wheel or blade to its normal load [N]. Statics gives the loads that are not listed."""
    slow: bool = False
    """True to slow down all references by one factor until no wheel slips."""
