"""Phases of a run in a scenario file: constraints that appear and vanish."""

from __future__ import annotations

from typing import Annotated, Literal

from rnc_pin.scenario.schema.base import Positive, Strict
from rnc_pin.scenario.schema.constraints import ConstraintItem
from rnc_pin.scenario.schema.controllers import ControllerItem
from rnc_pin.scenario.schema.derived import Entry, one_of
from rnc_pin.scenario.schema.outputs import OutputItem, Outputs, TaskOutputs
from rnc_pin.scenario.schema.reference_settings import References
from rnc_pin.simulation import ContactLoss, OutputCrossing
from rnc_pin.simulation.phase_events import Event

EventItem = Annotated[
    Event,
    one_of(
        crossing=Entry(OutputCrossing, forms={"output": OutputItem}),
        contact_loss=Entry(ContactLoss, short="contact"),
    ),
]


class PhaseSettings(Strict):
    """Phase of a run. Its keys replace those of the scenario; times of its references start with the phase."""

    name: str = ""
    """Name in messages and results; its number by default."""
    duration: Positive | None = None
    """Duration [s]; with ``until`` the longest one. By default that of ``simulation``."""
    until: EventItem | None = None
    """Event that ends the phase: ``crossing`` of an output, or ``contact_loss``. The run fails without the event."""
    constraints: list[ConstraintItem] | None = None
    """Constraints of the phase; by default those of the scenario."""
    outputs: Outputs | None = None
    """Outputs of the phase; by default those of the scenario."""
    task: TaskOutputs | None = None
    """Roles of the outputs; by default those of the scenario."""
    reference: References | None = None
    """References of the phase; by default those of the scenario."""
    controller: ControllerItem | None = None
    """Controller of the phase; by default that of the scenario. Without both, there are no inputs."""
    impact: list[ConstraintItem] = []
    """Constraints that act only at the start of the phase, such as a contact that rebounds."""
    restitution: float | dict[str, float] = 0.0
    """Coefficient of restitution at the start of the phase, 0 to 1: of all rows, or row to coefficient."""
    capture_distance: Positive | None = None
    """Largest distance [m] of the frames of a loop closure at which it joins them in the pose that they then have. By
    default, frames have to coincide."""
    on_lift_off: Literal["ignore", "stop", "release"] = "ignore"
    """Action if a contact would have to pull: keep it, end the run, or start the next phase."""
    pushing: dict[str, Literal[1, -1]] = {}
    """Further constraint rows that only push: row to 1 (along its velocity) or -1."""
