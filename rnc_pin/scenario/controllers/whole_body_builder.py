"""Builder of whole-body controllers over a velocity tracker."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.control.whole_body import VelocityQP
from rnc_pin.control.whole_body.limits import CollisionAvoidance, ControlLimit
from rnc_pin.control.whole_body.tasks import BasePoseTask, CenterOfMassTask, ControlTask
from rnc_pin.errors import RncError
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.row_stack import OutputStack
from rnc_pin.model.rows import OutputKind
from rnc_pin.outputs import FramePosition, FrameYaw
from rnc_pin.scenario.controllers.context import BuiltController, ControllerContext, build_type
from rnc_pin.scenario.controllers.over_velocity_tracker import track
from rnc_pin.scenario.schema.controllers import WholeBodySettings
from rnc_pin.scenario.schema.whole_body_settings import LimitSettings, TaskDraft


@build_type.register
def _whole_body(settings: WholeBodySettings, context: ControllerContext) -> BuiltController:
    tasks, durations = [], [0.0]
    for index, item in enumerate(settings.tasks):
        try:
            task = item if isinstance(item, ControlTask) else _task(item, context)
            task.bind(context.reduced)
        except RncError as error:
            raise type(error)(f"controller.tasks.{index}: {error}") from None
        tasks.append(task)
        durations.append(getattr(getattr(task, "reference", None), "duration", 0.0))
    try:
        program = VelocityQP(
            context.reduced,
            tasks,
            _limits(settings.limits, context),
            damping=settings.damping,
            solver=settings.solver,
        )
    except RncError as error:
        raise type(error)(f"controller.limits: {error}") from None
    horizon = min(context.simulation.duration, max(durations) + 1.0)
    return track(settings, context, program, horizon=horizon)


def _task(draft: TaskDraft, context: ControllerContext) -> ControlTask:
    """Task whose reference starts at the initial values of its outputs."""
    start, coordinates = _initial_values(draft, context)
    reference = draft.given["reference"].build(start, coordinates)
    return draft.kind(**{**draft.given, "reference": reference})


def _initial_values(draft: TaskDraft, context: ControllerContext) -> tuple[np.ndarray, Coordinates]:
    reduced, given = context.reduced, draft.given
    robot = reduced.robot
    if draft.kind is CenterOfMassTask:
        axes = [axis_index(axis) for axis in given.get("axes", CenterOfMassTask.axes)]
        center = pin.centerOfMass(robot.model, robot.model.createData(), context.q0)
        return np.array(center[axes]), Coordinates([False] * len(axes))
    kinds: list[OutputKind]
    if draft.kind is BasePoseTask:
        kinds = [FramePosition(given["frame"], "xy"), FrameYaw(given["frame"])]
    else:
        kinds = [given["output"]]
    stack = OutputStack([kind.bind(robot) for kind in kinds])
    return stack.value(reduced.at(context.q0).position), stack.coordinates


def _limits(settings: LimitSettings, context: ControllerContext) -> list[ControlLimit]:
    single = (settings.joint_position, settings.joint_velocity, settings.acceleration, settings.wheel_speed)
    found: list[ControlLimit] = [limit for limit in single if limit is not None]
    found += settings.regions
    if settings.collision is not None:
        wanted = settings.collision
        found.append(CollisionAvoidance(wanted.clearance, wanted.influence, wanted.rate, q0=context.q0))
    return found
