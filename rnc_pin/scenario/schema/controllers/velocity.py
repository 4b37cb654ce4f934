"""Kinematic controllers and what is under them: the adaptive velocity tracker (10), or the model-based baseline."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from rnc_pin.control import ComputedTorque, KinematicController, VelocityGains, VelocityTracker
from rnc_pin.errors import InfeasibleError
from rnc_pin.model.task import Task
from rnc_pin.scenario.schema.base import Positive, wrong
from rnc_pin.scenario.schema.controllers.base import Built, Context, Gain, HeldSettings, chosen, named
from rnc_pin.simulation import margins_along

OUTER_GAIN = 2.0
"""The paper's k3 [1/s]."""
_ROLLOUT_STEP = 0.05  # [s]; the region that gains are scaled to is smooth
_COMPUTED_TORQUE_GAIN = 20.0  # [1/s]
_THIN = 0.01  # smallest singular value below which a reference deserves a warning


class VelocitySettings(HeldSettings):
    """Of controllers that decide rates of the reducing outputs, which a tracker follows."""

    scaled_only: ClassVar[tuple[str, ...]] = (*HeldSettings.scaled_only, "bandwidth")

    tracker: Literal["adaptive", "computed_torque"] = "adaptive"
    """What follows the rates: (10), or the model-based baseline."""
    k: Gain = None
    """Gain of the tracker: one number, or one for each reducing output."""
    k21: Gain = None
    """Outer gain on primary outputs [1/s]; the paper has 0."""
    beta: Gain = None
    """Adaptation rate (10)."""
    sigma: Annotated[float, Field(ge=0)] | None = None
    """Leak of what is adapted [1/s]."""
    bandwidth: Positive | None = None
    """Of the preset ``scaled`` [rad/s]."""

    @model_validator(mode="after")
    def _suit_the_tracker(self) -> VelocitySettings:
        if self.tracker == "computed_torque" and self.held:
            raise wrong("held", "computed torque knows what holds the robot from its model")
        return self

    @property
    def primary_gain(self) -> float:
        """k21 of the preset [1/s]: the paper feeds x21d_dot open loop."""
        return 0.0 if self.preset == "paper" else OUTER_GAIN

    def tracked(
        self,
        context: Context,
        kinematic: KinematicController,
        task: Task | None = None,
    ) -> Built:
        """A kinematic controller over the dynamic one, after a preflight.

        Args:
            context: what it is built from.
            kinematic: decides the rates.
            task: whose A4 the kinematic controller inverts, if any.

        Raises:
            InfeasibleError: no gains suit the way, or a singular configuration is on it and preflight refuses that.
        """
        reduced, r, simulation = context.reduced, context.reduced.r, context.simulation
        margins = margins_along(reduced, kinematic, context.q0, context.horizon, _ROLLOUT_STEP, task, context.grip)
        slower = 1.0 if margins.grip is None else margins.grip.slower
        complaints = tuple(margins.complaints(_THIN))
        if complaints and context.preflight == "refuse":
            raise InfeasibleError("; ".join(complaints))
        if self.tracker == "computed_torque":
            gain = chosen("k", self.k, _COMPUTED_TORQUE_GAIN, r)
            return Built(ComputedTorque(reduced, kinematic, gain), complaints, slower=slower)
        gains = VelocityGains.paper()
        if self.preset == "normalised":
            gains = VelocityGains.normalised(self.bounds(context))
        if self.preset == "scaled":
            # A run that will end in a singular configuration is wanted all the same, for its results until then.
            region = margins.q if margins.singular is None else context.q0[None]
            with named("controller"):
                gains = VelocityGains.scaled(
                    reduced,
                    region,
                    simulation.dt,
                    self.bandwidth,
                    adaptation=self.adaptation or 1.0,
                    delay=self.delay or 0.0,
                )
        gains = VelocityGains(
            k=chosen("k", self.k, gains.k, r),
            beta=chosen("beta", self.beta, gains.beta, r),
            sigma=gains.sigma if self.sigma is None else self.sigma,
            dead_zone=chosen("dead_zone", self.dead_zone, 0.0, r),
        )
        return Built(VelocityTracker(kinematic, gains, self.held_force(context)), complaints, slower=slower)
