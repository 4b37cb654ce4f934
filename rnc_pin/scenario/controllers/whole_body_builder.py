"""Builders of whole-body controllers: programs in velocities over a velocity tracker, and programs in inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import pinocchio as pin

from rnc_pin.collision import PairSelection
from rnc_pin.control.whole_body import InverseDynamicsQP, VelocityQP
from rnc_pin.control.whole_body.limits import CollisionAvoidance, ControlLimit
from rnc_pin.control.whole_body.tasks import BasePoseTask, CenterOfMassTask, ControlTask
from rnc_pin.errors import RncError
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.row_stack import OutputStack
from rnc_pin.model.rows import OutputKind
from rnc_pin.outputs import FramePosition, FrameYaw
from rnc_pin.planning import Reference
from rnc_pin.scenario.controllers.context import BuiltController, ControllerContext, build_type
from rnc_pin.scenario.controllers.over_velocity_tracker import check_motion, track
from rnc_pin.scenario.schema.controllers import (
    InverseDynamicsSettings,
    VelocityProgramSettings,
    WholeBodySettings,
)
from rnc_pin.scenario.schema.whole_body_settings import CollisionSettings, LimitSettings, TaskDraft

_MISSED = 0.02
"""Distance to a goal at the end of the roll-out above which the goal is missed [m, rad]."""


@build_type.register
def _velocity_program(settings: VelocityProgramSettings, context: ControllerContext) -> BuiltController:
    tasks, limits = _tasks(settings, context), _limits(settings.limits, context)
    with _at_limits():
        program = VelocityQP(context.reduced, tasks, limits, damping=settings.damping, solver=settings.solver)
    horizon = context.simulation.duration
    return track(settings, context, program, horizon=horizon, missed=_missed_goals(settings, tasks, context))


@build_type.register
def _input_program(settings: InverseDynamicsSettings, context: ControllerContext) -> BuiltController:
    reduced, simulation = context.reduced, context.simulation
    tasks, limits = _tasks(settings, context), _limits(settings.limits, context)
    with _at_limits():
        program = InverseDynamicsQP(
            reduced,
            tasks,
            limits,
            dt=simulation.dt,
            velocity_gain=settings.velocity_gain,
            friction=settings.friction,
            solver=settings.solver,
        )
    complaints: tuple[str, ...] = ()
    if reduced.p >= reduced.r:  # with fewer actuators, the motion is not free to choose
        kinematic = VelocityQP(reduced, tasks, limits, solver=settings.solver)
        missed = _missed_goals(settings, tasks, context)
        _, complaints = check_motion(context, kinematic, horizon=simulation.duration, missed=missed)
    return BuiltController(program, complaints)


def _tasks(settings: WholeBodySettings, context: ControllerContext) -> list[ControlTask]:
    """Build the tasks, and raise errors with their place in the file."""
    tasks = []
    for index, item in enumerate(settings.tasks):
        try:
            task = item if isinstance(item, ControlTask) else _task(item, context)
            task.bind(context.reduced)
        except RncError as error:
            raise type(error)(f"controller.tasks.{index}: {error}") from None
        tasks.append(task)
    return tasks


@contextmanager
def _at_limits() -> Iterator[None]:
    """Prepend the key of the limits to errors: those of tasks were raised before."""
    try:
        yield
    except RncError as error:
        raise type(error)(f"controller.limits: {error}") from None


def _missed_goals(
    settings: WholeBodySettings, tasks: Sequence[ControlTask], context: ControllerContext
) -> Callable[[float, np.ndarray], tuple[tuple[str, ...], tuple[str, ...]]]:
    """Return the check for goals that a motion does not reach: those of the first priority, and lower ones."""
    first = min(task.priority for task in tasks)

    def missed(t: float, q: np.ndarray) -> tuple[tuple[str, ...], tuple[str, ...]]:
        complaints: list[str] = []
        given_up: list[str] = []
        for index, (draft, task) in enumerate(zip(settings.tasks, tasks, strict=True)):
            if not isinstance(draft, TaskDraft):
                continue
            stack = _goal_stack(draft, context.reduced)
            if stack is not None and stack.quasi.any():
                continue  # the position of a quasi-velocity is not a goal
            value, coordinates = _values(draft, context.reduced, q)
            reference: Reference = getattr(task, "reference")  # noqa: B009 (a draft's task has one)
            error = float(np.abs(coordinates.difference(reference.at(t).position, value)).max())
            if error <= _MISSED:
                continue
            title, found = (
                f"task {index} ({', '.join(task.bind(context.reduced).names)})",
                f"{error:.2g} at t = {t:.2f} s",
            )
            if task.priority == first:
                complaints.append(f"{title} misses its goal within the limits: error {found}")
            else:
                given_up.append(f"{title} of priority {task.priority} gives its goal up: error {found}")
        return tuple(complaints), tuple(given_up)

    return missed


def _task(draft: TaskDraft, context: ControllerContext) -> ControlTask:
    """Task whose reference starts at the initial values of its outputs."""
    start, coordinates = _values(draft, context.reduced, context.q0)
    reference = draft.given["reference"].build(start, coordinates)
    return draft.kind(**{**draft.given, "reference": reference})


def _values(draft: TaskDraft, reduced: ReducedModel, q: np.ndarray) -> tuple[np.ndarray, Coordinates]:
    """Values that the reference of a task describes, at a configuration (nq,)."""
    stack = _goal_stack(draft, reduced)
    if stack is not None:
        return stack.value(reduced.at(q).position), stack.coordinates
    robot = reduced.robot
    axes = [axis_index(axis) for axis in draft.given.get("axes", CenterOfMassTask.axes)]
    center = pin.centerOfMass(robot.model, robot.model.createData(), q)
    return np.array(center[axes]), Coordinates([False] * len(axes))


def _goal_stack(draft: TaskDraft, reduced: ReducedModel) -> OutputStack | None:
    """Outputs that the reference of a task describes; None for the centre of mass."""
    given = draft.given
    if draft.kind is CenterOfMassTask:
        return None
    kinds: list[OutputKind]
    if draft.kind is BasePoseTask:
        kinds = [FramePosition(given["frame"], "xy"), FrameYaw(given["frame"])]
    else:
        kinds = [given["output"]]
    return OutputStack([kind.bind(reduced.robot) for kind in kinds])


def _limits(settings: LimitSettings, context: ControllerContext) -> list[ControlLimit]:
    values = [getattr(settings, name) for name in type(settings).model_fields]
    items = [item for value in values for item in (value if isinstance(value, list) else [value])]
    found: list[ControlLimit] = [item for item in items if isinstance(item, ControlLimit)]
    wanted, geometry = settings.collision, context.reduced.robot.collision_model if context.obstacles else None
    if "collision" not in settings.model_fields_set and geometry is not None and len(geometry.geometryObjects):
        wanted = CollisionSettings()
    if wanted is not None:
        selection = PairSelection(links=wanted.links)
        found.append(
            CollisionAvoidance(
                wanted.clearance,
                wanted.influence,
                wanted.rate,
                context.obstacles,
                selection,
                q0=context.q0,
                corners=wanted.corners,
                deceleration=wanted.deceleration,
            )
        )
    return found
