"""Actuators in a scenario file: a joint, a force or torque on a frame, or a force conjugate to an output."""

from __future__ import annotations

from typing import Annotated

from rnc_pin.applications.scenario.schema.derived import Entry, one_of
from rnc_pin.applications.scenario.schema.outputs import OutputItem
from rnc_pin.model import Actuator, FrameForce, FrameTorque, OutputForce

ActuatorItem = Annotated[
    Actuator,
    one_of(
        True,
        force=FrameForce,
        torque=FrameTorque,
        output_force=Entry(OutputForce, forms={"output": OutputItem}),
    ),
]
