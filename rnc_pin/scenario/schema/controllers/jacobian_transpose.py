"""Position tracking by some of the actuators; the others are off."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from rnc_pin.control import JacobianTransposeController, PositionGains, PositionTracker, effective_inertia
from rnc_pin.scenario.schema.base import Positive
from rnc_pin.scenario.schema.controllers.base import AdaptiveSettings, Built, Context, Gain, chosen, named


class JacobianTransposeSettings(AdaptiveSettings):
    """Tracking of the primary outputs by the ``active`` actuators, without velocity measurements: (8)-(9)."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary"})

    type: Literal["jacobian_transpose"]
    """Position tracker (8)-(9) on the ``active`` actuators; the others are off."""
    active: list[str]
    """Actuators that are on."""
    k1: Gain = None
    """Gain k1 of the position tracker (8); one number, or one for each primary output."""
    k2: Gain = None
    """Gain k2 of the position tracker (8); one number, or one for each primary output."""
    gamma: Positive | None = None
    """Filter rate of the position tracker (8) [1/s]."""
    beta: Gain = None
    """Adaptation gain (9); one number, or one for each primary output."""
    sigma: Annotated[float, Field(ge=0)] | None = None
    """Leak rate of the adapted values [1/s]."""

    def make(self, context: Context) -> Built:
        task, reduced = context.task, context.reduced
        tracker = PositionTracker(
            context.primary, self._gains(context), outputs=task.primary, angular=task.primary_coordinates
        )
        return Built(JacobianTransposeController(reduced, tracker, self.active))

    def _gains(self, context: Context) -> PositionGains:
        gains, outputs = PositionGains.paper(), context.task.primary
        if self.preset == "normalised":
            gains = PositionGains.normalised(self.bounds(context)[outputs])
        if self.preset == "scaled":
            # Undriven outputs drift, so the region of motion is unknown. Use the initial configuration.
            inertia = effective_inertia(context.reduced, context.q0, outputs, self.active)
            with named("controller"):
                gains = PositionGains.scaled(inertia[None], context.simulation.dt)
        return PositionGains(
            k1=chosen("k1", self.k1, gains.k1, len(outputs)),
            k2=chosen("k2", self.k2, gains.k2, len(outputs)),
            gamma=gains.gamma if self.gamma is None else self.gamma,
            beta=chosen("beta", self.beta, gains.beta, len(outputs)),
            sigma=gains.sigma if self.sigma is None else self.sigma,
        )
