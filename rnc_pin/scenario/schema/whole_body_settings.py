"""Tasks and limits of whole-body control in a scenario file, derived from their classes.

To add a task or a limit, add its class to ``TaskItem`` or ``LimitSettings``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Annotated

import numpy as np

from rnc_pin.collision import Obstacle, PairSelection
from rnc_pin.control.whole_body.limits import (
    AccelerationLimit,
    CollisionAvoidance,
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
from rnc_pin.scenario.schema.base import Strict
from rnc_pin.scenario.schema.derived import Draft, Entry, one_of
from rnc_pin.scenario.schema.outputs import OutputItem
from rnc_pin.scenario.schema.reference_settings import HOLD, ReferenceItem

_task = partial(Entry, forms={"output": OutputItem, "reference": ReferenceItem})
_following = partial(_task, defaults={"reference": HOLD}, draft=True)
"""Entry of a task with a reference, which starts at the initial configuration."""

TaskItem = Annotated[
    ControlTask | Draft[ControlTask],
    one_of(
        output=_following(OutputTask),
        posture=_task(PostureTask),
        base_pose=_following(BasePoseTask),
        center_of_mass=_following(CenterOfMassTask),
        look_at=_task(LookAtTask),
        damping=_task(DampingTask),
        manipulability=_task(ManipulabilityTask),
        singularity=_task(SingularityTask),
    ),
]


_AVOIDANCE = Entry(CollisionAvoidance, late=("obstacles", "selection", "q0", "priority"))
_PAIRS = Entry(PairSelection, late=("pairs", "disabled"))


class CollisionSettings(_AVOIDANCE.model, _PAIRS.model):  # type: ignore[name-defined, misc]
    """Distances between links of the robot, and to the obstacles of the scenario."""

    def build(self, obstacles: Sequence[Obstacle], q0: np.ndarray) -> CollisionAvoidance:
        """Limit of a robot that is free of collisions at a configuration (nq,)."""
        return _AVOIDANCE.build(self, obstacles=obstacles, selection=_PAIRS.build(self), q0=q0)


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
