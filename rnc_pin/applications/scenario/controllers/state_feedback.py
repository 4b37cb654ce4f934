"""Linear-quadratic regulator about an equilibrium or a steady motion."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from rnc_pin.analysis import check_sampling, equilibrium, linearize, lqr
from rnc_pin.applications.scenario.controllers.base import ControllerSettings
from rnc_pin.applications.scenario.controllers.context import (
    MIN_SINGULAR_VALUE,
    BuiltController,
    ControllerContext,
    reduced_velocity,
    refuse_or_warn,
)
from rnc_pin.applications.scenario.schema.base import Numbers
from rnc_pin.applications.scenario.schema.derived import part
from rnc_pin.applications.scenario.schema.kinds import OutputItem
from rnc_pin.control import StateFeedback
from rnc_pin.errors import RncError
from rnc_pin.planning import Joined, Reference

_Weights = float | Numbers | dict[str, float]
_STATES = "Weights of the states: one number, one for each, or a mapping by name. Names of rates end in ``_dot``."
_INPUTS = "Weights of the actuators' inputs: one number, one for each, or a mapping by name."
_HELD = Field(description="Joints whose equilibrium position is their initial position.")
_EQUILIBRIUM = part(equilibrium, "hold", "cyclic", forms={"hold": Annotated[list[str], _HELD]})
_LINEAR = part(linearize, "coordinates", "rates", forms={"coordinates": list[str | OutputItem] | None})
_FORMS = {
    "state_cost": Annotated[_Weights, Field(description=_STATES)],
    "input_cost": Annotated[_Weights, Field(description=_INPUTS)],
}
_REGULATOR = part(lqr, "state_cost", "input_cost", forms=_FORMS)


class StateFeedbackSettings(ControllerSettings, _EQUILIBRIUM.model, _LINEAR.model, _REGULATOR.model):  # type: ignore[name-defined, misc]
    """Linear-quadratic regulator about the equilibrium or steady motion nearest to the initial configuration."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "redundant"})

    type: Literal["state_feedback"]
    """Linear-quadratic regulator, for systems with fewer actuators than velocities. It uses the model."""
    v2: dict[str, float] | None = None
    """Rates of reducing outputs in the steady motion, by name; the initial rates by default."""

    def _build(self, context: ControllerContext) -> BuiltController:
        reduced = context.reduced
        v2 = context.v2_0 if self.v2 is None else reduced_velocity(reduced, self.v2, "controller.v2")
        try:
            found = _EQUILIBRIUM.build(self, reduced=reduced, guess=context.q0, v2=v2)
            linear = _LINEAR.build(self, reduced=reduced, q=found.q, v2=v2, T=found.T, cyclic=self.cyclic)
            K = _REGULATOR.build(self, linear=linear)
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
