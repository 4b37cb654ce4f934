"""Actuators and passive forces in a scenario file: the key and the class of each kind."""

from __future__ import annotations

from typing import Annotated

from rnc_pin.applications.scenario.schema.derived import Entry, one_of
from rnc_pin.applications.scenario.schema.outputs import OutputItem
from rnc_pin.forces import Damper, SmoothFriction, Spring, Wrench
from rnc_pin.model import Actuator, ForceKind, FrameForce, FrameTorque, OutputForce

ActuatorItem = Annotated[
    Actuator,
    one_of(
        True,
        force=FrameForce,
        torque=FrameTorque,
        output_force=Entry(OutputForce, forms={"output": OutputItem}),
    ),
]


ForceItem = Annotated[
    ForceKind,
    one_of(
        spring=Entry(Spring, forms={"output": OutputItem}),
        damper=Entry(Damper, forms={"output": OutputItem}),
        smooth_friction=Entry(SmoothFriction, forms={"output": OutputItem}),
        wrench=Wrench,
    ),
]
