"""Builders of whole-body controllers: programs in velocities over a velocity tracker, and programs in inputs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rnc_pin.control.whole_body import InverseDynamicsQP, VelocityQP
from rnc_pin.control.whole_body.limits import ControlLimit
from rnc_pin.control.whole_body.tasks import ControlTask
from rnc_pin.errors import RncError
from rnc_pin.scenario.controllers.context import BuiltController, ControllerContext, build_type
from rnc_pin.scenario.controllers.over_velocity_tracker import check_motion, track
from rnc_pin.scenario.controllers.task_goals import TaskGoals, goal_values
from rnc_pin.scenario.schema.controllers import (
    InverseDynamicsSettings,
    VelocityProgramSettings,
    WholeBodySettings,
)
from rnc_pin.scenario.schema.derived import Draft
from rnc_pin.scenario.schema.whole_body_settings import CollisionSettings, LimitSettings


@build_type.register
def _velocity_program(settings: VelocityProgramSettings, context: ControllerContext) -> BuiltController:
    tasks, limits = _tasks(settings, context), _limits(settings.limits, context)
    with _at_limits():
        program = VelocityQP(context.reduced, tasks, limits, damping=settings.damping, solver=settings.solver)
    horizon = context.simulation.duration
    return track(settings, context, program, horizon=horizon, goals=TaskGoals(settings.tasks, tasks, context.reduced))


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
    doubts: tuple[str, ...] = ()
    goals = TaskGoals(settings.tasks, tasks, reduced)
    if reduced.p >= reduced.r:  # with fewer actuators, the motion is not free to choose
        kinematic = VelocityQP(reduced, tasks, limits, solver=settings.solver)
        _, complaints, doubts = check_motion(
            context, kinematic, horizon=simulation.duration, goals=goals, stands_in=True
        )
    return BuiltController(program, complaints, goals=goals, doubts=doubts)


def _tasks(settings: WholeBodySettings, context: ControllerContext) -> list[ControlTask]:
    """Build the tasks, and raise errors with their place in the file."""
    tasks = []
    for index, item in enumerate(settings.tasks):
        try:
            task = item if isinstance(item, ControlTask) else _task(item, context)
            task.bind(context.reduced)
        except RncError as error:
            raise error.within(f"controller.tasks.{index}") from None
        tasks.append(task)
    return tasks


@contextmanager
def _at_limits() -> Iterator[None]:
    """Prepend the key of the limits to errors: those of tasks were raised before."""
    try:
        yield
    except RncError as error:
        raise error.within("controller.limits") from None


def _task(draft: Draft[ControlTask], context: ControllerContext) -> ControlTask:
    """Task whose reference starts at the initial values of its outputs."""
    start, coordinates = goal_values(draft, context.reduced, context.q0)
    reference = draft.given["reference"].from_start(start, coordinates)
    return draft.build(reference=reference)


def _limits(settings: LimitSettings, context: ControllerContext) -> list[ControlLimit]:
    values = [getattr(settings, name) for name in type(settings).model_fields]
    items = [item for value in values for item in (value if isinstance(value, list) else [value])]
    found: list[ControlLimit] = [item for item in items if isinstance(item, ControlLimit)]
    wanted, geometry = settings.collision, context.reduced.robot.collision_model if context.obstacles else None
    if "collision" not in settings.model_fields_set and geometry is not None and len(geometry.geometryObjects):
        wanted = CollisionSettings()
    if wanted is not None:
        found.append(wanted.build(context.obstacles, context.q0))
    return found
