"""How a scenario is simulated."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rnc_pin.scenario.schema.base import Positive, Strict
from rnc_pin.simulation import Plant, Stop


class SimulationSettings(Strict):
    """How long, how finely, and what of the real machine takes part."""

    duration: Positive
    """[s]"""
    dt: Positive = 0.002
    """Period of the controller [s]."""
    substeps: Annotated[int, Field(ge=1)] = 1
    """Integration steps in a period."""
    joint_damping: bool = False
    """Viscous damping of the robot's file acts."""
    joint_friction: bool = False
    """Dry friction of the robot's file acts on its joints, with stiction."""
    actuator_limits: bool = False
    """Inputs are cut off at their limits."""
    position_limits: bool = False
    """The run ends where a joint reaches the end of its range."""

    @property
    def plant(self) -> Plant:
        """What a real machine has beside the model."""
        return Plant(self.joint_damping, self.actuator_limits, self.joint_friction)

    @property
    def stop(self) -> Stop:
        """What ends the run early."""
        return Stop(position_limits=self.position_limits)
