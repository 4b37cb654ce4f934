"""Inputs and result of building a controller, the checks that types share, and the goals of whole-body tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.analysis import Grip
from rnc_pin.applications.scenario.schema.run_settings import SimulationSettings
from rnc_pin.array_shapes import Float
from rnc_pin.collision import Obstacle
from rnc_pin.control import Controller, KinematicController, SlitheringReference, VelocityQP, VelocityTarget
from rnc_pin.errors import ConfigurationError, InfeasibleError, nearest
from rnc_pin.io import Json
from rnc_pin.model import Measurement, OutputKind, OutputStack, ReducedModel, Task
from rnc_pin.motion.optimal import MotionPlan
from rnc_pin.motion.planning import Reference
from rnc_pin.motion.whole_body import ProgramState
from rnc_pin.motion.whole_body.tasks import ControlTask, DampingTask, PostureTask
from rnc_pin.simulation import Margins, margins_along, obstacles_passed

_LONGEST = 350  # letters of the reasons that one error names


class GoalError(NamedTuple):
    """Distance of a configuration to the goal of one task."""

    title: str
    """Number of the task, and the names of its rows."""
    errors: dict[str, float]
    """Absolute error of each row [m, rad; m/s, rad/s of a quasi-velocity]."""
    priority: int


@dataclass(frozen=True)
class FollowedGoal:
    """Goal of a task that follows a reference.

    Attributes:
        index: number of the task.
        priority: level of the task.
        reference: its reference.
        stack: outputs that the reference describes.
    """

    index: int
    priority: int
    reference: Reference
    stack: OutputStack

    def error(self, reduced: ReducedModel, t: float, q: Array, v: Array | None) -> GoalError | None:
        """Error at a time [s]. A quasi-velocity has no position: its goal is the velocity of its reference.

        Args:
            reduced: the model.
            t, q, v: time, configuration and velocity; None if the velocity is not known.
        """
        here, point = reduced.at(q).position, self.reference.at(t)
        if self.stack.quasi.any() and v is None:
            return None
        if self.stack.quasi.any():
            errors = point.velocity - self.stack.jacobian(here) @ v
        else:
            errors = self.stack.coordinates.difference(point.position, self.stack.value(here))
        names = self.stack.names
        by_name = dict(zip(names, np.abs(errors).tolist(), strict=True))
        return GoalError(f"task {self.index} ({', '.join(names)})", by_name, self.priority)


class TaskGoals:
    """Goals of the tasks that follow references. Postures and the like are preferences: they have no goals.

    Where a program has nothing but postures and damping, the postures of the first priority are its goals.

    Args:
        followed: goals of tasks with references.
        tasks: all tasks.
        reduced: the model.
    """

    def __init__(self, followed: Sequence[FollowedGoal], tasks: Sequence[ControlTask], reduced: ReducedModel) -> None:
        self._followed, self._reduced = followed, reduced
        first = min(task.priority for task in tasks)
        postures = [(k, task) for k, task in enumerate(tasks) if isinstance(task, PostureTask)]
        alone = all(isinstance(task, PostureTask | DampingTask) for task in tasks)
        self._postures = [(k, task) for k, task in postures if alone and task.priority == first]

    def errors(self, t: float, q: Float[Array, " nq"], v: Float[Array, " nv"] | None = None) -> list[GoalError]:
        """Return the errors of all tasks at a time [s]; those of quasi-velocities need a velocity."""
        errors = (each.error(self._reduced, t, q, v) for each in self._followed)
        found = [each for each in errors if each is not None]
        robot = self._reduced.robot
        for index, posture in self._postures:
            away = np.abs(pin.difference(robot.model, q, robot.configuration(posture.joints)))
            by_name = {name: float(away[robot.velocity_indices(name)].max()) for name in posture.joints}
            found.append(GoalError(f"task {index} (posture of {', '.join(by_name)})", by_name, posture.priority))
        return found


MIN_SINGULAR_VALUE = 0.01
"""Smallest singular value below which a warning is given."""


@dataclass(frozen=True)
class ControllerContext:
    """Inputs for building a controller.

    Attributes:
        reduced: the model.
        task: roles of the outputs.
        primary, redundant, vertical: references of the task's outputs; constant at the start if not given.
        given: names of the references that the scenario gives.
        q0: initial configuration, (nq,).
        v2_0: initial reduced velocity, (r,); None for rest.
        grip: friction of the wheels on the ground, if the scenario gives it.
        simulation: duration and steps.
        preflight: action if a singular configuration is ahead.
        slithering: reference of a trailer on the path of its tractor, which replaces ``vertical``.
        obstacles: bodies in the world, for the check before the run.
        plan: optimal motion of ``planner``, if the scenario has one.
        outputs: outputs of the scenario.
        monitored: indices in x1 and reference of vertical outputs that are not controlled; for the record only.
    """

    reduced: ReducedModel
    task: Task
    primary: Reference
    redundant: Reference
    vertical: Reference
    given: tuple[str, ...]
    q0: np.ndarray
    simulation: SimulationSettings
    preflight: Literal["warn", "refuse"] = "warn"
    slithering: SlitheringReference | None = None
    monitored: tuple[np.ndarray, Reference] | None = None
    v2_0: np.ndarray | None = None
    grip: Grip | None = None
    obstacles: tuple[Obstacle, ...] = ()
    plan: MotionPlan | None = None
    outputs: tuple[OutputKind, ...] = ()

    @property
    def horizon(self) -> float:
        """Time until all references are constant, plus 1 s, at most the duration of the simulation [s]."""
        longest = max(reference.duration for reference in (self.primary, self.redundant, self.vertical)) + 1.0
        return min(self.simulation.seconds, longest)


@dataclass(frozen=True)
class BuiltController:
    """Controller, with the warnings of the check before the run.

    Attributes:
        controller: ready to run.
        warnings: messages for the user.
        notes: entries for the record of the run.
        goals: goals of whole-body tasks.
    """

    controller: Controller
    warnings: tuple[str, ...] = ()
    notes: Mapping[str, Json] = field(default_factory=dict)
    goals: TaskGoals | None = None


def refuse_or_warn(preflight: Literal["warn", "refuse"], complaints: Sequence[str]) -> tuple[str, ...]:
    """Return the warnings of the check before a run.

    Args:
        preflight: action.
        complaints: reasons against the run.

    Raises:
        InfeasibleError: there are complaints, and ``preflight`` refuses such a run.
    """
    if complaints and preflight == "refuse":
        shown = 1 if sum(map(len, complaints)) > _LONGEST else len(complaints)
        more = f"; and {len(complaints) - shown} more: 'preflight: warn' shows all" if shown < len(complaints) else ""
        raise InfeasibleError("; ".join(complaints[:shown]) + more)
    return tuple(complaints)


def reduced_velocity(reduced: ReducedModel, rates: Mapping[str, float], key: str) -> np.ndarray:
    """Return the reduced velocity (r,) from rates by name of the reducing outputs; other rates are zero.

    Raises:
        ConfigurationError: no reducing output has this name.
    """
    names = reduced.reducing.names
    v2 = np.zeros(reduced.r)
    for name, rate in rates.items():
        if name not in names:
            raise ConfigurationError(f"{key}: no reducing output '{name}'{nearest(name, names)}")
        v2[names.index(name)] = rate
    return v2


_ROLLOUT_STEP = 0.05  # [s]; a coarse step is enough, because the inertia varies smoothly


def check_motion(
    context: ControllerContext, kinematic: KinematicController, task: Task | None = None, horizon: float | None = None
) -> tuple[Margins, tuple[str, ...]]:
    """Roll out a kinematic controller. Return the margins of the motion, and complaints.

    Args:
        context: inputs for building the controller.
        kinematic: computes the rates of the reducing outputs.
        task: task whose A4 the kinematic controller inverts, if any.
        horizon: duration of the motion to check [s]; by default that of the references of the scenario.

    Raises:
        InfeasibleError: there are complaints, and preflight refuses such a motion.
    """
    reduced, horizon = context.reduced, context.horizon if horizon is None else horizon
    if isinstance(kinematic, VelocityQP):
        kinematic = _OncePerSample(kinematic)
    margins = margins_along(reduced, kinematic, context.q0, horizon, _ROLLOUT_STEP, task, context.grip)
    passed = obstacles_passed(reduced.robot, margins.time, margins.q, context.obstacles)
    complaints = (
        *margins.complaints(MIN_SINGULAR_VALUE),
        *(f"the reference passes through obstacle '{each.names[1]}': {each}" for each in passed),
    )
    try:
        return margins, refuse_or_warn(context.preflight, complaints)
    except InfeasibleError as error:
        weakest = margins.stack
        if weakest.value < MIN_SINGULAR_VALUE:
            error.q, error.time, error.rows = weakest.q, weakest.time, weakest.rows
            error.singular_value = weakest.value
        raise


class _OncePerSample:
    """Program whose velocity is computed once per sample of a roll-out: within a sample it does not read q."""

    def __init__(self, program: VelocityQP) -> None:
        self._program = program
        self._last: tuple[ProgramState, tuple[VelocityTarget, ProgramState]] | None = None

    def initial_state(self, measurement: Measurement) -> ProgramState:
        return self._program.initial_state(measurement)

    def step(self, t: float, measurement: Measurement, state: ProgramState) -> tuple[VelocityTarget, ProgramState]:
        if self._last is None or self._last[0] is not state:
            self._last = state, self._program.step(t, measurement, state)
        return self._last[1]
