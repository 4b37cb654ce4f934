"""A model mounted on a frame of another model."""

from __future__ import annotations

import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.robots.names import ToldApart


class Mounted:
    """Two models joined into one, with their geometry. Gravity is that of the carrier.

    Args:
        carrier: model that carries the other.
        other: mounted model.
        frame: index of the carrier's frame.
        placement: pose of the other model's base in that frame; None for identity.

    Raises:
        ModelError: both have a joint or frame of the same name.
    """

    def __init__(self, carrier: pin.Model, other: pin.Model, frame: int, placement: pin.SE3 | None) -> None:
        for what, first, second in (
            ("joint", list(carrier.names)[1:], list(other.names)[1:]),
            ("frame", [each.name for each in carrier.frames][1:], [each.name for each in other.frames][1:]),
        ):
            for name in second:
                if name in first:
                    raise ModelError(f"robots '{carrier.name}' and '{other.name}' both have a {what} '{name}'")
        self._frame, self._where = frame, pin.SE3.Identity() if placement is None else placement
        self._apart = ToldApart(carrier, other)
        self.model = pin.appendModel(*self._apart.models, frame, self._where)
        self._apart.restore(self.model)
        self.model.name = f"{carrier.name} with {other.name}"
        self.model.gravity = carrier.gravity  # appendModel takes the gravity of the second

    def geometry(self, carrier: pin.GeometryModel, other: pin.GeometryModel) -> pin.GeometryModel:
        """Geometry of both models, attached to the joined model."""
        return pin.appendModel(*self._apart.models, carrier, other, self._frame, self._where)[1]
