"""Builders of controllers over a position tracker (8)-(9)."""

from __future__ import annotations

from functools import partial

import numpy as np

from rnc_pin.control import (
    JacobianTransposeController,
    PositionGains,
    PositionTracker,
    SplitController,
    UnicycleStabilizer,
    VelocityGains,
    VelocityTracker,
    design_position_gains,
    design_velocity_gains,
    effective_inertia,
)
from rnc_pin.control.gain_design import OUTER_GAINS
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.task import Task
from rnc_pin.scenario.controllers.context import (
    BuiltController,
    ControllerContext,
    at_key,
    build_type,
    holding_force,
    inertia_bound,
    sized_gain,
    tracker_gains,
)
from rnc_pin.scenario.schema.controllers import JacobianTransposeSettings, TwoPhaseSettings


@build_type.register
def _jacobian_transpose(settings: JacobianTransposeSettings, context: ControllerContext) -> BuiltController:
    task, reduced, outputs = context.task, context.reduced, context.task.primary
    bound = inertia_bound(settings, reduced.r)
    with at_key("controller"):
        gains = design_position_gains(
            partial(effective_inertia, reduced, outputs=outputs, active=settings.active),
            context.q0,  # undriven outputs drift, so the region of motion is unknown
            context.simulation.dt,
            preset=settings.preset,
            inertia_bound=None if bound is None else bound[outputs],
            overrides=tracker_gains(settings, PositionGains, len(outputs)),
        )
    tracker = PositionTracker(context.primary, gains, outputs=outputs, angular=task.primary_coordinates)
    return BuiltController(JacobianTransposeController(reduced, tracker, settings.active))


@build_type.register
def _two_phase(settings: TwoPhaseSettings, context: ControllerContext) -> BuiltController:
    task, reduced, goal = context.task, context.reduced, settings.platform
    x2 = reduced.reducing
    if len(task.redundant) != 2 or not x2.quasi[task.redundant[0]] or not x2.angular[task.redundant[1]]:
        raise ConfigurationError("task.redundant: two_phase requires forward speed and yaw of the platform")
    position = Task.of(reduced, task.primary_names, task.redundant_names, goal.position).vertical
    hand_gains, platform_gains = _two_phase_gains(settings, context)
    force = holding_force(settings, context)
    hand = PositionTracker(
        context.primary,
        hand_gains,
        angular=task.primary_coordinates,
        gravity_compensation=None if force is None else force[task.primary],
    )
    outer = OUTER_GAINS[settings.preset]
    stabilizer = UnicycleStabilizer(
        np.array(goal.to),
        position,
        goal.begin,
        k=outer.k,
        rate=outer.rate,
        tolerance=outer.tolerance,
        max_speed=outer.max_speed,
    )
    platform = VelocityTracker(stabilizer, platform_gains, None if force is None else force[task.redundant])
    return BuiltController(SplitController([(hand, task.primary), (platform, task.redundant)], task.r))


def _two_phase_gains(settings: TwoPhaseSettings, context: ControllerContext) -> tuple[PositionGains, VelocityGains]:
    """Gains of the hand's tracker and of the platform's tracker, from the inertia at the initial configuration."""
    reduced, primary, redundant = context.reduced, context.task.primary, context.task.redundant
    start, dt, preset, delay = context.q0[None], context.simulation.dt, settings.preset, settings.delay
    dead_zone, bound = sized_gain("dead_zone", settings.dead_zone, reduced.r), inertia_bound(settings, reduced.r)
    with at_key("controller"):
        hand = design_position_gains(
            lambda q: reduced.at(q).H[..., primary, :][..., primary],
            start,
            dt,
            preset=preset,
            inertia_bound=None if bound is None else bound[primary],
            delay=delay,
        )
        platform = design_velocity_gains(
            reduced,
            start,
            dt,
            preset=preset,
            outputs=redundant,
            inertia_bound=None if bound is None else bound[redundant],
            adaptation=settings.adaptation,
            delay=delay,
            overrides={"dead_zone": dead_zone[redundant] if isinstance(dead_zone, np.ndarray) else dead_zone},
        )
    return hand, platform
