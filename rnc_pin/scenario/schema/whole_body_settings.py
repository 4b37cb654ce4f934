"""Tasks and limits of whole-body control in a scenario file, derived from their classes.

To add a task or a limit, add its class to ``TaskItem`` or ``LimitSettings``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from rnc_pin.control.whole_body.limits import (
    AccelerationLimit,
    JointPositionLimit,
    JointVelocityLimit,
    RegionLimit,
    WheelSpeedLimit,
)
from rnc_pin.control.whole_body.tasks import (
    BasePoseTask,
    CenterOfMassTask,
    ControlTask,
    DampingTask,
    LookAtTask,
    ManipulabilityTask,
    OutputTask,
    PostureTask,
    SingularityTask,
)
from rnc_pin.model.parameter_types import NotNegative, Positive
from rnc_pin.model.rows import OutputKind
from rnc_pin.planning.references import Reference
from rnc_pin.scenario.schema.base import Strict
from rnc_pin.scenario.schema.derived import Entry, one_of
from rnc_pin.scenario.schema.outputs import OutputItem
from rnc_pin.scenario.schema.reference_settings import HoldReference, ReferenceItem


@dataclass(frozen=True)
class TaskDraft:
    """Task whose reference starts at the initial configuration, so that only a builder can construct it.

    Attributes:
        kind: class of the task.
        given: its settings; ``reference`` holds the settings of the reference.
    """

    kind: type[ControlTask]
    given: Mapping[str, Any]


class TaskEntry(Entry):
    """Entry of a task: outputs and references are written as elsewhere in the file."""

    def build(self, said: object) -> object:
        """Build the task, or a draft of it if it follows a reference."""
        given = self._given(said)
        if not any(each.name == "reference" for each in dataclasses.fields(self.kind)):
            return super().build(said)
        return TaskDraft(self.kind, {"reference": HoldReference(), **given})

    def _field(self, each: dataclasses.Field[object], kind: object, text: str) -> tuple[object, object]:
        if kind is Reference:
            return ReferenceItem, Field(HoldReference(), description=text)
        return super()._field(each, OutputItem if kind is OutputKind else kind, text)


TaskItem = Annotated[
    ControlTask | TaskDraft,
    one_of(
        output=TaskEntry(OutputTask),
        posture=TaskEntry(PostureTask),
        base_pose=TaskEntry(BasePoseTask),
        center_of_mass=TaskEntry(CenterOfMassTask),
        look_at=TaskEntry(LookAtTask),
        damping=TaskEntry(DampingTask),
        manipulability=TaskEntry(ManipulabilityTask),
        singularity=TaskEntry(SingularityTask),
    ),
]


class CollisionSettings(Strict):
    """Distances between links of the robot, and to the obstacles of the scenario."""

    clearance: NotNegative = 0.02
    """Distance that remains [m]."""
    influence: Positive = 0.15
    """Distance from which a pair is slowed down [m]."""
    rate: Positive = 5.0
    """Largest rate of approach over remaining distance [1/s]."""
    links: bool = True
    """True for distances between links of the robot too; those to obstacles always count."""
    corners: bool = False
    """True for rows at the corners of parallel faces: a body that turns beside a wall loses no clearance."""
    deceleration: Positive | None = None
    """Deceleration with which an approach can stop [m/s^2]; by default half of what the effort limits give."""


class LimitSettings(Strict):
    """Limits of whole-body control. Null removes a limit."""

    joint_position: Annotated[JointPositionLimit, Entry(JointPositionLimit)] | None = JointPositionLimit()
    """Position limits of joints, from the robot's file by default."""
    joint_velocity: Annotated[JointVelocityLimit, Entry(JointVelocityLimit)] | None = JointVelocityLimit()
    """Velocity limits of joints, from the robot's file by default."""
    acceleration: Annotated[AccelerationLimit, Entry(AccelerationLimit)] | None = None
    """Accelerations of the reduced velocities or of joints."""
    wheel_speed: Annotated[WheelSpeedLimit, Entry(WheelSpeedLimit)] | None = None
    """Speed of rolling wheels."""
    regions: list[Annotated[RegionLimit, Entry(RegionLimit)]] = []
    """Convex regions in which frames stay."""
    collision: CollisionSettings | None = None
    """Distances between links of the robot, and to obstacles; by default they count if the scenario has obstacles."""
