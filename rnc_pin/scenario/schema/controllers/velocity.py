"""Kinematic controllers over a velocity tracker: adaptive (10), or computed torque."""

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
_ROLLOUT_STEP = 0.05  # [s]; a coarse step is enough, because the inertia varies smoothly
_COMPUTED_TORQUE_GAIN = 20.0  # [1/s]
_THIN = 0.01  # smallest singular value below which a warning is given


class VelocitySettings(HeldSettings):
    """Settings of controllers that compute rates of the reducing outputs, which a tracker follows."""

    scaled_only: ClassVar[tuple[str, ...]] = (*HeldSettings.scaled_only, "bandwidth")

    tracker: Literal["adaptive", "computed_torque"] = "adaptive"
    """Velocity tracker: adaptive (10), or computed torque with the model."""
    k: Gain = None
    """Gain of the velocity tracker; one number, or one for each reducing output."""
    k21: Gain = None
    """Outer gain on primary outputs [1/s]; one number, or one for each. The paper uses 0."""
    beta: Gain = None
    """Adaptation gain (10); one number, or one for each reducing output."""
    sigma: Annotated[float, Field(ge=0)] | None = None
    """Leak rate of the adapted values [1/s]."""
    bandwidth: Positive | None = None
    """Bandwidth of the velocity tracker with the preset ``scaled`` [rad/s]."""

    @model_validator(mode="after")
    def _suit_the_tracker(self) -> VelocitySettings:
        if self.tracker == "computed_torque" and self.held:
            raise wrong("held", "is not available with tracker 'computed_torque', which takes gravity from its model")
        return self

    @property
    def primary_gain(self) -> float:
        """Gain k21 of the preset [1/s]; zero for the paper, which uses x21d_dot in open loop."""
        return 0.0 if self.preset == "paper" else OUTER_GAIN

    def tracked(
        self,
        context: Context,
        kinematic: KinematicController,
        task: Task | None = None,
    ) -> Built:
        """Check the reference and build the velocity tracker under a kinematic controller.

        Args:
            context: inputs for building the controller.
            kinematic: computes the rates of the reducing outputs.
            task: task whose A4 the kinematic controller inverts, if any.

        Raises:
            InfeasibleError: no gains fit the motion, or it is near a singular configuration and preflight refuses that.
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
            # The results of a run are useful even if it ends in a singular configuration.
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
