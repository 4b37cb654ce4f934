"""Simulation and friction of the ground in a scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rnc_pin.scenario.schema.base import Positive, Strict
from rnc_pin.simulation import Stop


class SimulationSettings(Strict):
    """Duration and steps of the simulation, and the effects of a real robot that it includes."""

    duration: Positive
    """Simulated time [s]."""
    dt: Positive = 0.002
    """Sampling period of the controller [s]."""
    substeps: Annotated[int, Field(ge=1)] = 1
    """Number of integration steps in one sampling period."""
    joint_damping: bool = False
    """True to include the viscous joint damping of the robot's file."""
    joint_friction: bool = False
    """True to include the dry joint friction of the robot's file, with stiction."""
    actuator_limits: bool = False
    """True to clip inputs to the limits of the actuators."""
    position_limits: bool = False
    """True to end the run when a joint reaches its position limit."""

    on_lift_off: Literal["ignore", "stop"] = "ignore"
    """Action if a contact with the ground would have to pull: "ignore" only reports it, "stop" ends the run."""

    @property
    def stop(self) -> Stop:
        """Conditions that end the run early."""
        return Stop(position_limits=self.position_limits, lift_off=self.on_lift_off == "stop")


class GripSettings(Strict):
    """Friction of the ground. A reference that needs more friction causes a warning, is refused, or is slowed down."""

    friction: Positive
    """Coefficient of friction."""
    loads: dict[str, Positive] = {}
    """Frame of a wheel or blade to its normal load [N]. Statics gives the loads that are not listed."""
    slow: bool = False
    """True to slow down all references by one factor until no wheel slips."""
