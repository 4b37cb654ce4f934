"""Actuators in a scenario file: the name of a joint, or a force or torque on a frame."""

from __future__ import annotations

from typing import Annotated

from rnc_pin.model.actuation import Actuator, FrameForce, FrameTorque
from rnc_pin.scenario.schema.derived import one_of

ActuatorItem = Annotated[Actuator, one_of(True, force=FrameForce, torque=FrameTorque)]
