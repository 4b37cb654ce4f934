"""Builder of the feedback along a plan."""

from __future__ import annotations

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.optimal import PlanFeedback, tvlqr
from rnc_pin.scenario.controllers.context import (
    MIN_SINGULAR_VALUE,
    BuiltController,
    ControllerContext,
    at_key,
    build_type,
    refuse_or_warn,
)
from rnc_pin.scenario.schema.controllers import PlanFeedbackSettings
from rnc_pin.simulation import obstacles_passed


@build_type.register
def _plan_feedback(settings: PlanFeedbackSettings, context: ControllerContext) -> BuiltController:
    reduced, plan = context.reduced, context.plan
    if plan is None:
        raise ConfigurationError("controller.type: 'plan_feedback' requires a plan: set 'planner'")
    with at_key("controller"):
        if settings.gains == "plan":
            controller = PlanFeedback(reduced, plan, bandwidth=settings.bandwidth, end=settings.end)
        else:
            gains = tvlqr(reduced, plan, settings.state_cost, settings.input_cost).K
            controller = PlanFeedback(reduced, plan, gains, settings.bandwidth, settings.end)
    smallest = float(np.min(reduced.at(plan.q).smallest_singular_value))
    near = f"the plan is near a singular configuration: smallest singular value {smallest:.2g}"
    passed = obstacles_passed(reduced.robot, plan.time, plan.q, context.obstacles)
    complaints = (
        *([f"{near}, limit {MIN_SINGULAR_VALUE:g}"] if smallest < MIN_SINGULAR_VALUE else []),
        *(f"the plan passes through obstacle '{each.names[1]}': {each}" for each in passed),
    )
    return BuiltController(controller, refuse_or_warn(context.preflight, complaints))
