"""Feedback along a plan."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from rnc_pin.applications.scenario.controllers.base import ControllerSettings
from rnc_pin.applications.scenario.controllers.context import (
    MIN_SINGULAR_VALUE,
    BuiltController,
    ControllerContext,
    at_key,
    refuse_or_warn,
)
from rnc_pin.applications.scenario.schema.base import Numbers, wrong
from rnc_pin.applications.scenario.schema.derived import part
from rnc_pin.errors import ConfigurationError
from rnc_pin.optimal import PlanFeedback, tvlqr
from rnc_pin.simulation import obstacles_passed

_Weights = float | Numbers | dict[str, float]
_STATES = """Weights of the states for "tvlqr": one number, one for each, or a mapping by name. States are the entries
of v and, with "(rate)" after the name, the reduced velocities."""
_INPUTS = 'Weights of the inputs of the plan for "tvlqr": one number, one for each, or a mapping by name.'
_FORMS = {
    "state_cost": Annotated[_Weights, Field(description=_STATES)],
    "input_cost": Annotated[_Weights, Field(description=_INPUTS)],
}
_REGULATOR = part(tvlqr, "state_cost", "input_cost", forms=_FORMS)
_FEEDBACK = part(PlanFeedback, "bandwidth", "end")


class PlanFeedbackSettings(ControllerSettings, _REGULATOR.model, _FEEDBACK.model):  # type: ignore[name-defined, misc]
    """Feedback along the plan of ``planner``: its own gains, or those of a time-varying linear-quadratic regulator."""

    follows: ClassVar[frozenset[str]] = frozenset()
    advice: ClassVar[str] = ", which follows the plan of 'planner'"

    type: Literal["plan_feedback"]
    """Planned inputs with feedback. It uses the model."""
    gains: Literal["tvlqr", "plan"] = "tvlqr"
    """Gains: "tvlqr", a regulator with ``state_cost`` and ``input_cost``; or "plan", those of the costs of the plan."""

    def _build(self, context: ControllerContext) -> BuiltController:
        reduced, plan = context.reduced, context.plan
        if plan is None:
            raise ConfigurationError("controller.type: 'plan_feedback' requires a plan: set 'planner'")
        with at_key("controller"):
            gains = None if self.gains == "plan" else _REGULATOR.build(self, reduced=reduced, plan=plan).K
            controller = _FEEDBACK.build(self, reduced=reduced, plan=plan, K=gains)
        smallest = float(np.min(reduced.at(plan.q).smallest_singular_value))
        near = f"the plan is near a singular configuration: smallest singular value {smallest:.2g}"
        passed = obstacles_passed(reduced.robot, plan.time, plan.q, context.obstacles)
        complaints = (
            *([f"{near}, limit {MIN_SINGULAR_VALUE:g}"] if smallest < MIN_SINGULAR_VALUE else []),
            *(f"the plan passes through obstacle '{each.names[1]}': {each}" for each in passed),
        )
        return BuiltController(controller, refuse_or_warn(context.preflight, complaints))

    @model_validator(mode="after")
    def _weights_belong_to_tvlqr(self) -> PlanFeedbackSettings:
        for name in ("state_cost", "input_cost"):
            if self.gains == "plan" and name in self.model_fields_set:
                raise wrong(name, "belongs to gains 'tvlqr'")
        return self
