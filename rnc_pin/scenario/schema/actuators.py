"""Actuators in a scenario file: a joint's name, or a force or torque on a frame."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Tag

from rnc_pin.model.actuation import Actuator, FrameForce, FrameTorque
from rnc_pin.scenario.schema.base import BY_KIND, NAME, Axis, Positive, Strict


class _FrameAxis(Strict):
    frame: str
    axis: Axis


class _ForceArguments(_FrameAxis):
    limit: Positive | None = None


class Force(Strict):
    """A force along a frame's own axis."""

    force: _ForceArguments

    def build(self) -> Actuator:
        return FrameForce(self.force.frame, self.force.axis, self.force.limit or np.inf)


class Torque(Strict):
    """A torque about a frame's own axis."""

    torque: _ForceArguments

    def build(self) -> Actuator:
        return FrameTorque(self.torque.frame, self.torque.axis, self.torque.limit or np.inf)


ActuatorItem = Annotated[
    Annotated[str, Tag(NAME)] | Annotated[Force, Tag("force")] | Annotated[Torque, Tag("torque")],
    BY_KIND,
]
