"""Kinematic controllers over a velocity tracker: adaptive (10), computed torque, or velocity servos."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import model_validator

from rnc_pin.applications.scenario.controllers.base import AdaptationSettings, Unknown, preset_gains, sized_gain
from rnc_pin.applications.scenario.controllers.context import (
    BuiltController,
    ControllerContext,
    TaskGoals,
    at_key,
    check_motion,
)
from rnc_pin.applications.scenario.schema.base import Strict, wrong
from rnc_pin.applications.scenario.schema.derived import Entry, PartialCall, part
from rnc_pin.control import (
    ActuatorVelocityController,
    Combined,
    ComputedTorque,
    GainDesign,
    JointLimits,
    KinematicController,
    OuterGains,
    Posture,
    ReducingOutputController,
    RedundancyController,
    Secondary,
    SingularityDistance,
    SteeringController,
    VelocityGains,
    VelocityTracker,
    check_freedom,
    design_velocity_gains,
)
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model import Task
from rnc_pin.planning import Joined, Reference, ReferencePoint


class SecondarySettings(Strict):
    """Secondary objectives, for tasks with more redundant than vertical outputs. The controller adds them."""

    posture: Annotated[PartialCall[Posture], Entry(Posture, late=("task", "reference"))] | None = None
    """Stay near a posture: ``reference.redundant``, by default the initial values of the redundant outputs."""
    joint_limits: Annotated[PartialCall[JointLimits], Entry(JointLimits, late=("reduced", "task"))] | None = None
    """Stay away from joint limits."""
    singularity: (
        Annotated[PartialCall[SingularityDistance], Entry(SingularityDistance, late=("reduced", "task"))] | None
    ) = None
    """Stay away from singular configurations."""

    def build(self, context: ControllerContext) -> Secondary:
        """Build the objectives.

        Raises:
            RncError: the task leaves no freedom, or an objective does not fit.
        """
        reduced, task = context.reduced, context.task
        check_freedom(task)
        parts: list[Secondary] = []
        if self.posture is not None:
            parts.append(self.posture.build(task=task, reference=context.redundant))
        if self.joint_limits is not None:
            parts.append(self.joint_limits.build(reduced=reduced, task=task))
        if self.singularity is not None:
            parts.append(self.singularity.build(reduced=reduced, task=task))
        return Combined(parts)

    @model_validator(mode="after")
    def _check_any(self) -> SecondarySettings:
        if (self.posture, self.joint_limits, self.singularity) == (None, None, None):
            raise ValueError("expected at least one of posture, joint_limits, singularity; {} takes their defaults")
        return self


_BANDWIDTH = part(GainDesign, "bandwidth")
_GAINS = preset_gains(VelocityGains, "k", "beta", "sigma")
_K21, _K3, _K4 = (preset_gains(OuterGains, name) for name in ("k21", "k3", "k4"))


class VelocityTrackerSettings(AdaptationSettings, _BANDWIDTH.model, _GAINS.model, _K21.model):  # type: ignore[name-defined, misc]
    """Settings of controllers that compute rates of the reducing outputs, which a tracker follows."""

    scaled_only: ClassVar[tuple[str, ...]] = (*AdaptationSettings.scaled_only, "bandwidth")

    tracker: Literal["adaptive", "computed_torque", "velocity"] = "adaptive"
    """Velocity tracker: adaptive (10), or computed torque with the model. Computed torque uses only ``k``. It ignores
    ``beta``, ``sigma``, ``dead_zone``, ``bandwidth``, ``adaptation`` and ``delay``. "velocity": none; the rates become
    velocity commands of the actuators, for a plant with ``servo_time``. It uses no gain of a tracker."""

    def track(
        self,
        context: ControllerContext,
        kinematic: KinematicController,
        task: Task | None = None,
        horizon: float | None = None,
        goals: TaskGoals | None = None,
    ) -> BuiltController:
        """Check the reference and build the velocity tracker under a kinematic controller.

        Args:
            context: inputs for building the controller.
            kinematic, task, horizon, goals: as for ``check_motion``.

        Raises:
            InfeasibleError: no gains fit the motion, or preflight refuses it.
        """
        reduced, q0 = context.reduced, context.q0
        margins, complaints, doubts = check_motion(context, kinematic, task, horizon, goals)
        time_scale = 1.0 if margins.grip is None else margins.grip.time_scale
        if self.tracker == "computed_torque":
            gain = sized_gain("k", self.k, reduced.r)
            k = {} if gain is None else {"k": gain}
            computed = ComputedTorque(reduced, kinematic, **k)
            return BuiltController(computed, complaints, time_scale=time_scale, goals=goals, doubts=doubts)
        if self.tracker == "velocity":
            with at_key("controller"):
                servos = ActuatorVelocityController(reduced, kinematic)
            return BuiltController(servos, complaints, time_scale=time_scale, goals=goals, doubts=doubts)
        # The results of a run are useful even if it ends in a singular configuration.
        region, times = (margins.q, margins.time) if margins.singular is None else (q0[None], None)
        with at_key("controller"):
            design = GainDesign(
                self.preset,
                self.bound(reduced.r),
                self.bandwidth,
                self.adaptation,
                self.delay,
                overrides=self.tracker_gains(VelocityGains, reduced.r),
            )
            gains = design_velocity_gains(reduced, region, context.simulation.dt, design, times=times)
        tracker = VelocityTracker(kinematic, gains, self.holding_force(context))
        return BuiltController(tracker, complaints, time_scale=time_scale, goals=goals, doubts=doubts)

    @model_validator(mode="after")
    def _check_tracker(self) -> VelocityTrackerSettings:
        if self.tracker == "computed_torque" and self.gravity_compensation:
            raise wrong(
                "gravity_compensation",
                "is not available with tracker 'computed_torque', which takes gravity from its model",
            )
        if self.tracker == "velocity" and self.gravity_compensation:
            raise wrong("gravity_compensation", "is not available with tracker 'velocity', which gives no forces")
        return self


class Class1Settings(VelocityTrackerSettings, _K3.model):  # type: ignore[name-defined, misc]
    """Settings of controllers that move the vertical outputs by the redundant ones."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "vertical"})

    def _class_1(self, context: ControllerContext, secondary: Secondary | None = None) -> BuiltController:
        """Build controller (12).

        Raises:
            ConfigurationError: the task does not fit, or the reference has a trailer.
        """
        if context.slithering is not None:
            raise ConfigurationError("reference.path.trailer: needs the controller type 'steering'")
        task = context.task
        kinematic = RedundancyController(
            task,
            context.primary,
            context.vertical,
            k3=self.outer_gain("k3", len(task.vertical)),
            k21=self.outer_gain("k21", len(task.primary)),
            secondary=secondary,
        )
        return self.track(context, kinematic, task)


class RedundancySettings(Class1Settings):
    """Class 1: redundant outputs move so that the vertical ones follow their reference; (12), velocity tracker."""

    advice: ClassVar[str] = "; controller.secondary.posture follows it"

    type: Literal["redundancy"]
    """Class 1: (12) over a velocity tracker."""
    secondary: SecondarySettings | None = None
    """Secondary objectives, for tasks with more redundant than vertical outputs (wide A4)."""

    @property
    def followed(self) -> frozenset[str]:
        """References that the controller reads; with a posture the redundant one too."""
        postured = self.secondary is not None and self.secondary.posture is not None
        return self.follows | {"redundant"} if postured else self.follows

    def _build(self, context: ControllerContext) -> BuiltController:
        secondary = None
        if self.secondary is not None:
            try:
                secondary = self.secondary.build(context)
            except RncError as error:
                raise ConfigurationError(f"controller.secondary: {error}") from None
        return self._class_1(context, secondary)


class ReducingOutputsSettings(VelocityTrackerSettings):
    """Each reducing output follows its own reference; the vertical outputs are not controlled."""

    # Comparisons show the error of vertical outputs without control, so their reference is accepted.
    follows: ClassVar[frozenset[str]] = frozenset({"primary", "redundant", "vertical"})

    type: Literal["reducing_outputs"]
    """Tracking of all reducing outputs, over a velocity tracker."""

    def _build(self, context: ControllerContext) -> BuiltController:
        task = context.task
        reference = _Reordered(
            Joined([context.primary, context.redundant]), np.argsort(np.concatenate([task.primary, task.redundant]))
        )
        gain = sized_gain("k21", self.k21, task.r)
        k2 = {} if gain is None else {"k2": gain}
        kinematic = ReducingOutputController(context.reduced, reference, **k2, monitored=context.monitored)
        return self.track(context, kinematic)


class UncertainRedundancySettings(Class1Settings):
    """Class 1 with unknown masses or wheels: (16) with the estimates of (20), over a velocity tracker."""

    type: Literal["uncertain_redundancy"]
    """Class 1 with unknown masses or wheels: (16) and (20) over a velocity tracker."""
    unknown: Unknown
    """Masses, or radii and tracks of wheels, to estimate."""

    def _build(self, context: ControllerContext) -> BuiltController:
        return self._class_1(context)


class SteeringSettings(VelocityTrackerSettings, _K3.model, _K4.model):  # type: ignore[name-defined, misc]
    """Class 2s: the angles of redundant outputs, not their rates, move the vertical ones; over a velocity tracker."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "vertical"})

    type: Literal["steering"]
    """Class 2s: backstepping through the steering angle, over a velocity tracker."""

    def _build(self, context: ControllerContext) -> BuiltController:
        kinematic = SteeringController(
            context.reduced,
            context.task,
            context.primary,
            context.slithering or context.vertical,
            OuterGains(
                k3=self.outer_gain("k3", len(context.task.vertical)),
                k4=float(self.outer_gain("k4")),
                k21=self.outer_gain("k21", len(context.task.primary)),
            ),
            monitored=context.monitored,
        )
        return self.track(context, kinematic)


class _Reordered:
    """Reference with its outputs in another order."""

    def __init__(self, reference: Reference, order: np.ndarray) -> None:
        self._reference, self._order = reference, order
        self.size, self.duration = reference.size, reference.duration

    def at(self, t: float) -> ReferencePoint:
        point = self._reference.at(t)
        return ReferencePoint(*(each[self._order] for each in point))
