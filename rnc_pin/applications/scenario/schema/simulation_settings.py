"""Simulation and friction of the ground in a scenario file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from rnc_pin.analysis import Grip
from rnc_pin.applications.scenario.schema.base import Positive
from rnc_pin.applications.scenario.schema.derived import Entry
from rnc_pin.model import ReducedModel
from rnc_pin.plants import ReducedPlant
from rnc_pin.simulation import Stop

_FORMS = {"substeps": Annotated[int, Field(ge=1)] | None, "tolerance": Positive}
_PLANT = Entry(ReducedPlant, late=("reduced",), forms=_FORMS)
_STOP = Entry(Stop, late=("speed", "lift_off"))
_GRIP = Entry(Grip, late=("reduced",), forms={"loads": dict[str, Positive]}, defaults={"loads": {}})


class SimulationSettings(_PLANT.model, _STOP.model):  # type: ignore[name-defined, misc]
    """Duration and steps of the simulation, and the effects of a real robot that it includes."""

    duration: Positive
    """Simulated time [s]."""
    dt: Positive = 0.002
    """Sampling period of the controller [s]."""
    on_lift_off: Literal["ignore", "stop"] = "ignore"
    """Action if a contact with the ground would have to pull: "ignore" only reports it, "stop" ends the run."""

    @property
    def plant_options(self) -> dict[str, Any]:
        """Arguments of ``ReducedPlant`` by name."""
        return _PLANT.given(self)

    @property
    def stop(self) -> Stop:
        """Conditions that end the run early."""
        return _STOP.build(self, lift_off=self.on_lift_off == "stop")


class GripSettings(_GRIP.model):  # type: ignore[name-defined, misc]
    """Friction of the ground. A reference that needs more friction causes a warning, is refused, or is slowed down.

    A run whose constraints need more friction fails.
    """

    slow: bool = False
    """True to slow down all references by one factor until no wheel slips. 5 % of the friction are for feedback."""

    def build(self, reduced: ReducedModel) -> Grip:
        """Friction limits of the contacts of a model."""
        return _GRIP.build(self, reduced=reduced)
