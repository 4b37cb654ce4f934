"""Goals of whole-body tasks: the references that a motion has to reach within a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.applications.scenario.schema.derived import PartialCall
from rnc_pin.array_shapes import Float
from rnc_pin.control.whole_body.tasks import BasePoseTask, CenterOfMassTask, ControlTask, DampingTask, PostureTask
from rnc_pin.model import Coordinates, OutputKind, OutputStack, ReducedModel, axis_index
from rnc_pin.outputs import FramePosition, FrameYaw
from rnc_pin.planning import Reference


class GoalError(NamedTuple):
    """Distance of a configuration to the goal of one task."""

    title: str
    """Number of the task, and the names of its rows."""
    errors: dict[str, float]
    """Absolute error of each row [m, rad; m/s, rad/s of a quasi-velocity]."""
    priority: int

    @property
    def largest(self) -> float:
        """Largest error of the task."""
        return max(self.errors.values())


class TaskGoals:
    """Goals of the tasks that follow references. Postures and the like are preferences: they have no goals.

    Where a program has nothing but postures and damping, the postures of the first priority are its goals.

    Args:
        items: tasks as in the scenario file.
        tasks: the tasks that were built of them.
        reduced: the model.
    """

    def __init__(
        self,
        items: Sequence[ControlTask | PartialCall[ControlTask]],
        tasks: Sequence[ControlTask],
        reduced: ReducedModel,
    ) -> None:
        self._reduced, self._first = reduced, min(task.priority for task in tasks)
        self._goals = [
            (index, call, task, task.bind(reduced).names)
            for index, (call, task) in enumerate(zip(items, tasks, strict=True))
            if isinstance(call, PartialCall)
        ]
        alone = all(isinstance(task, PostureTask | DampingTask) for task in tasks)
        first = [
            (k, task) for k, task in enumerate(tasks) if isinstance(task, PostureTask) and task.priority == self._first
        ]
        self._postures = first if alone else []

    def errors(self, t: float, q: Float[Array, " nq"], v: Float[Array, " nv"] | None = None) -> list[GoalError]:
        """Return the errors of all tasks at a time [s]; those of quasi-velocities need a velocity.

        A quasi-velocity has no position: its goal is the velocity of its reference.
        """
        found = []
        for index, call, task, names in self._goals:
            reference: Reference = getattr(task, "reference")  # noqa: B009 (a call of a task with a reference)
            stack = goal_stack(call, self._reduced)
            if stack is not None and stack.quasi.any():
                if v is None:
                    continue
                rates = stack.jacobian(self._reduced.at(q).position) @ v
                errors = reference.at(t).velocity - rates
            else:
                value, coordinates = goal_values(call, self._reduced, q)
                errors = coordinates.difference(reference.at(t).position, value)
            by_name = dict(zip(names, np.abs(errors).tolist(), strict=True))
            found.append(GoalError(f"task {index} ({', '.join(names)})", by_name, task.priority))
        robot = self._reduced.robot
        for index, posture in self._postures:
            away = np.abs(pin.difference(robot.model, q, robot.configuration(posture.joints)))
            by_name = {name: float(away[robot.velocity_indices(name)].max()) for name in posture.joints}
            found.append(GoalError(f"task {index} (posture of {', '.join(by_name)})", by_name, posture.priority))
        return found

    def doubts(self, t: float, q: Float[Array, " nq"], tolerance: float) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return doubts about goals of the first priority, and about lower ones, at the end of a coarse roll-out.

        Programs are local methods: at an obstacle ahead, another step or the dynamics can choose the other way.
        """
        missed, given_up = [], []
        for goal in self.errors(t, q):
            if goal.largest <= tolerance:
                continue
            error = f"a coarse roll-out ends {goal.largest:.2g} from it at t = {t:.2f} s"
            if goal.priority == self._first:
                missed.append(f"{goal.title} may miss its goal within the limits: {error}")
            else:
                given_up.append(f"{goal.title} of priority {goal.priority} may give its goal up: {error}")
        return tuple(missed), tuple(given_up)

    def misses(
        self, t: float, q: Float[Array, " nq"], v: Float[Array, " nv"] | None, tolerance: float
    ) -> tuple[str, ...]:
        """Return the goals of the first priority that a run misses at its end, a line each."""
        return tuple(
            f"{goal.title} misses its goal within the limits: error {goal.largest:.2g} at t = {t:.2f} s"
            for goal in self.errors(t, q, v)
            if goal.largest > tolerance and goal.priority == self._first
        )


def goal_values(call: PartialCall[ControlTask], reduced: ReducedModel, q: Array) -> tuple[Array, Coordinates]:
    """Values that the reference of a task describes, at a configuration (nq,)."""
    stack = goal_stack(call, reduced)
    if stack is not None:
        return stack.value(reduced.at(q).position), stack.coordinates
    robot = reduced.robot
    axes = [axis_index(axis) for axis in call.given.get("axes", CenterOfMassTask.axes)]
    center = pin.centerOfMass(robot.model, robot.model.createData(), q)
    return np.array(center[axes]), Coordinates(
        [False] * len(axes), names=[f"center_of_mass_{'xyz'[axis]}" for axis in axes]
    )


def goal_stack(call: PartialCall[ControlTask], reduced: ReducedModel) -> OutputStack | None:
    """Outputs that the reference of a task describes; None for the centre of mass."""
    given = call.given
    if call.kind is CenterOfMassTask:
        return None
    kinds: list[OutputKind]
    if call.kind is BasePoseTask:
        kinds = [FramePosition(given["frame"], "xy"), FrameYaw(given["frame"])]
    else:
        kinds = [given["output"]]
    return OutputStack([kind.bind(reduced.robot) for kind in kinds])
