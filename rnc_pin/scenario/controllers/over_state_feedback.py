"""Builder of the linear-quadratic regulator."""

from __future__ import annotations

import numpy as np

from rnc_pin.analysis import equilibrium, linearize, lqr
from rnc_pin.analysis.regulator import check_sampling
from rnc_pin.control import StateFeedback
from rnc_pin.errors import RncError
from rnc_pin.planning import Joined, Reference
from rnc_pin.scenario.controllers.context import (
    MIN_SINGULAR_VALUE,
    BuiltController,
    ControllerContext,
    build_type,
    reduced_velocity,
    refuse_or_warn,
)
from rnc_pin.scenario.schema.controllers import StateFeedbackSettings


@build_type.register
def _state_feedback(settings: StateFeedbackSettings, context: ControllerContext) -> BuiltController:
    reduced = context.reduced
    v2 = context.v2_0 if settings.v2 is None else reduced_velocity(reduced, settings.v2, "controller.v2")
    try:
        found = equilibrium(reduced, context.q0, settings.hold, v2, settings.cyclic)
        linear = linearize(reduced, found.q, v2, found.T, settings.coordinates, settings.rates, settings.cyclic)
        K = lqr(linear, settings.state_cost, settings.input_cost)
        check_sampling(linear, K, context.simulation.dt)
    except RncError as error:
        raise error.within("controller") from None
    parts: list[Reference] = []
    names: list[str] = []
    for which in context.given:
        parts.append(getattr(context, which))
        names += getattr(context.task, f"{which}_names")
    reference = Joined(parts) if parts else None
    smallest = float(np.min(reduced.at(np.stack([context.q0, found.q])).smallest_singular_value))
    limit = MIN_SINGULAR_VALUE
    near = f"start is near a singular configuration: smallest singular value {smallest:.2g}, limit {limit:g}"
    complaints = refuse_or_warn(context.preflight, () if smallest > limit else (near,))
    return BuiltController(StateFeedback(linear, K, reference, names), complaints)
