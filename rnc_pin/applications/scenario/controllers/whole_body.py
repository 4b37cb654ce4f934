"""Whole-body control: tasks within limits, as programs in velocities over a velocity tracker, or in inputs.

To add a task or a limit, add its class to ``TaskItem`` or ``LimitSettings``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from rnc_pin.applications.scenario.controllers.base import ControllerSettings
from rnc_pin.applications.scenario.controllers.context import (
    BuiltController,
    ControllerContext,
    TaskGoals,
    goal_values,
    refuse_or_warn,
)
from rnc_pin.applications.scenario.controllers.tracking import VelocityTrackerSettings
from rnc_pin.applications.scenario.schema.derived import Entry, PartialCall, one_of, part
from rnc_pin.applications.scenario.schema.kinds import OutputItem
from rnc_pin.applications.scenario.schema.motions import HOLD, ReferenceItem
from rnc_pin.collision import Obstacle, PairSelection
from rnc_pin.errors import RncError
from rnc_pin.io import Strict
from rnc_pin.motion.whole_body import InverseDynamicsQP, VelocityQP
from rnc_pin.motion.whole_body.limits import (
    AccelerationLimit,
    BaseSpeedLimit,
    CollisionAvoidance,
    ControlLimit,
    JointPositionLimit,
    JointVelocityLimit,
    RegionLimit,
)
from rnc_pin.motion.whole_body.tasks import (
    BasePoseTask,
    CenterOfMassTask,
    ControlTask,
    DampingTask,
    OutputTask,
    PostureTask,
    SingularityTask,
)

_VELOCITIES, _INPUTS = part(VelocityQP, "damping"), part(InverseDynamicsQP, "velocity_gain", "friction", "braking_time")
_entry = partial(Entry, forms={"output": OutputItem, "reference": ReferenceItem})
_following = partial(_entry, defaults={"reference": HOLD}, incomplete=True)
"""Entry of a task with a reference, which starts at the initial configuration."""

TaskItem = Annotated[
    ControlTask | PartialCall[ControlTask],
    one_of(
        output=_following(OutputTask),
        posture=_entry(PostureTask),
        base_pose=_following(BasePoseTask),
        center_of_mass=_following(CenterOfMassTask),
        damping=_entry(DampingTask),
        singularity=_entry(SingularityTask),
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
    base_speed: Annotated[BaseSpeedLimit, Entry(BaseSpeedLimit)] | None = None
    """Norm of the horizontal velocity of a base."""
    regions: list[Annotated[RegionLimit, Entry(RegionLimit)]] = []
    """Convex regions in which frames stay."""
    collision: CollisionSettings | None = None
    """Distances between links of the robot, and to obstacles; by default they count if the scenario has obstacles."""

    def build(self, context: ControllerContext) -> list[ControlLimit]:
        """Limits of a run. Distances count by default if there are obstacles, and the robot has shapes."""
        values = [getattr(self, name) for name in type(self).model_fields]
        items = [item for value in values for item in (value if isinstance(value, list) else [value])]
        found: list[ControlLimit] = [item for item in items if isinstance(item, ControlLimit)]
        wanted, geometry = self.collision, context.reduced.robot.collision_model if context.obstacles else None
        if "collision" not in self.model_fields_set and geometry is not None and len(geometry.geometryObjects):
            wanted = CollisionSettings()
        if wanted is not None:
            found.append(wanted.build(context.obstacles, context.q0))
        return found


class WholeBodySettings(ControllerSettings):
    """Tasks and limits of whole-body control."""

    follows: ClassVar[frozenset[str]] = frozenset()
    advice: ClassVar[str] = "; each task has its own reference"

    tasks: Annotated[list[TaskItem], Field(min_length=1)]
    """Tasks, each with weight, gain and priority. References start at the initial values."""
    limits: LimitSettings = LimitSettings()
    """Limits; by default position and velocity limits of the robot's file, and distances to obstacles."""

    def _tasks(self, context: ControllerContext) -> list[ControlTask]:
        """Build the tasks, and raise errors with their place in the file."""
        tasks = []
        for index, item in enumerate(self.tasks):
            with RncError.at(f"controller.tasks.{index}"):
                task = item if isinstance(item, ControlTask) else _task(item, context)
                task.bind(context.reduced)
            tasks.append(task)
        return tasks


class VelocityProgramSettings(WholeBodySettings, VelocityTrackerSettings, _VELOCITIES.model):  # type: ignore[name-defined, misc]
    """Whole-body control: tasks within limits as a quadratic program, over a velocity tracker."""

    type: Literal["qp"]
    """Tasks within limits as a quadratic program in the reduced velocities, over a velocity tracker."""

    def _build(self, context: ControllerContext) -> BuiltController:
        tasks, limits = self._tasks(context), self.limits.build(context)
        with RncError.at("controller.limits"):
            program = _VELOCITIES.build(self, reduced=context.reduced, tasks=tasks, limits=limits)
        goals = TaskGoals(self.tasks, tasks, context.reduced)
        return self.track(context, program, horizon=context.simulation.seconds, goals=goals)


class InverseDynamicsSettings(WholeBodySettings, _INPUTS.model):  # type: ignore[name-defined, misc]
    """Whole-body control with efforts: tasks within limits as a quadratic program in the inputs, with the model."""

    type: Literal["inverse_dynamics"]
    """Tasks within limits of motion, effort and grip as a quadratic program in the inputs. It uses the model."""

    def _build(self, context: ControllerContext) -> BuiltController:
        reduced, simulation = context.reduced, context.simulation
        tasks, limits = self._tasks(context), self.limits.build(context)
        with RncError.at("controller.limits"):
            program = _INPUTS.build(self, reduced=reduced, tasks=tasks, limits=limits, dt=simulation.dt)
        v2 = np.zeros(reduced.r) if context.v2_0 is None else context.v2_0
        problem = program.braking_problem(0.0, context.q0, v2)
        unsafe = () if problem is None else (f"no braking motion from the start keeps all limits: {problem}",)
        complaints = refuse_or_warn(context.preflight, unsafe)
        return BuiltController(program, complaints, goals=TaskGoals(self.tasks, tasks, reduced))


def _task(call: PartialCall[ControlTask], context: ControllerContext) -> ControlTask:
    """Task whose reference starts at the initial values of its outputs."""
    start, coordinates = goal_values(call, context.reduced, context.q0)
    reference = call.given["reference"].from_start(start, coordinates)
    return call.build(reference=reference)


WholeBodyTypes = VelocityProgramSettings | InverseDynamicsSettings
