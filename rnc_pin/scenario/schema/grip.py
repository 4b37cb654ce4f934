"""How well wheels hold on to the ground."""

from __future__ import annotations

from rnc_pin.scenario.schema.base import Positive, Strict


class GripSettings(Strict):
    """Friction of the ground: a reference that needs more of it is warned of, refused, or slowed."""

    friction: Positive
    """Coefficient of friction."""
    loads: dict[str, Positive] = {}
    """Frame of a wheel or blade: its load [N]; the others' are those of statics."""
    slow: bool = False
    """Whether references are slowed as a whole until every wheel holds on along the way."""
