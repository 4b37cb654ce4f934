"""Phases of a run in a scenario file: constraints that appear and vanish."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rnc_pin.applications.scenario.controllers import ControllerItem
from rnc_pin.applications.scenario.schema.base import Positive
from rnc_pin.applications.scenario.schema.constraints import ConstraintItem
from rnc_pin.applications.scenario.schema.derived import Entry, one_of
from rnc_pin.applications.scenario.schema.outputs import OutputItem, Outputs, TaskOutputs
from rnc_pin.applications.scenario.schema.reference_settings import References
from rnc_pin.model import ReducedModel
from rnc_pin.simulation import ContactLoss, Event, OutputCrossing, Phase

EventItem = Annotated[
    Event,
    one_of(
        crossing=Entry(OutputCrossing, forms={"output": OutputItem}),
        contact_loss=Entry(ContactLoss, short="contact"),
    ),
]


_PHASE = Entry(
    Phase,
    late=("reduced", "controller", "impact", "plant"),
    forms={
        "duration": Annotated[
            Positive,
            Field(description="Duration [s]; with ``until`` the longest one. By default that of ``simulation``."),
        ],
        "until": EventItem | None,
        "pushing": dict[str, Literal[1, -1]],
    },
    optional=("duration",),
)


class PhaseSettings(_PHASE.model):  # type: ignore[name-defined, misc]
    """Phase of a run. Its keys replace those of the scenario; times of its references start with the phase."""

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
    capture_distance: Positive | None = None
    """Largest distance [m] of the frames of a loop closure at which it joins them in the pose that they then have. By
    default, frames have to coincide."""

    def build(self, reduced: ReducedModel, **others: object) -> Phase:
        """Phase of a model; the arguments are those of ``Phase`` that the file does not give."""
        return _PHASE.build(self, reduced=reduced, **others)
