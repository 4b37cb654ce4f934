"""Controllers over a position tracker (8)-(9), or over a velocity tracker: (10), computed torque, or servos."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from rnc_pin import control
from rnc_pin.applications.scenario.controllers.base import (
    AdaptationSettings,
    ControllerSettings,
    preset_gains,
    sized_gain,
)
from rnc_pin.applications.scenario.controllers.context import (
    BuiltController,
    ControllerContext,
    TaskGoals,
    check_motion,
)
from rnc_pin.applications.scenario.schema.derived import Entry, PartialCall, part
from rnc_pin.applications.scenario.schema.motions import GoalPose
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import wrong
from rnc_pin.model import NotNegative, Task
from rnc_pin.motion.planning import Joined, Reference, ReferencePoint

_POSITION_GAINS = preset_gains(control.PositionGains, "k1", "k2", "gamma", "beta", "sigma")
_ACTIVE = part(control.JacobianTransposeController, "active")
_POSITION = Field(min_length=2, max_length=2, description="Names of the vertical outputs x and y of the platform.")
_BEGIN = Annotated[NotNegative, Field(description="Start time of the second phase [s].")]
_FORMS = {"goal": GoalPose, "position": Annotated[list[str], _POSITION], "begin": _BEGIN}
_PLATFORM = part(control.UnicycleStabilizer, "goal", "position", "begin", keys={"goal": "to"}, forms=_FORMS)
PlatformItem = Annotated[PartialCall[control.UnicycleStabilizer], _PLATFORM]
"""Goal of a unicycle platform in the second phase."""


class JacobianTransposeSettings(ControllerSettings, _POSITION_GAINS.model, _ACTIVE.model):  # type: ignore[name-defined, misc]
    """Tracking of the primary outputs by the ``active`` actuators, without velocity measurements: (8)-(9)."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary"})

    type: Literal["jacobian_transpose"]
    """Position tracker (8)-(9) on the ``active`` actuators; the others are off."""

    def _build(self, context: ControllerContext) -> BuiltController:
        task, reduced, outputs = context.task, context.reduced, context.task.primary
        with ConfigurationError.at("controller"):
            gains = control.design_position_gains(
                partial(control.effective_inertia, reduced, outputs=outputs, active=self.active),
                context.q0,  # undriven outputs drift, so the region of motion is unknown
                context.simulation.dt,
                control.GainDesign(self.preset, overrides=self.tracker_gains(control.PositionGains, len(outputs))),
            )
        tracker = control.PositionTracker(context.primary, gains, outputs=outputs, angular=task.primary_coordinates)
        return BuiltController(control.JacobianTransposeController(reduced, tracker, self.active))


class TwoPhaseSettings(AdaptationSettings):
    """Class 3: (8)-(9) moves the primary outputs and then holds them while a point stabiliser drives the platform."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary"})

    type: Literal["two_phase"]
    """Class 3: (8)-(9) for the primary outputs, then a point stabiliser for the platform."""
    platform: PlatformItem
    """Goal pose and start time of the platform: position, to, begin."""

    def _build(self, context: ControllerContext) -> BuiltController:
        task, reduced, goal = context.task, context.reduced, self.platform
        x2 = reduced.reducing
        if len(task.redundant) != 2 or not x2.quasi[task.redundant[0]] or not x2.angular[task.redundant[1]]:
            raise ConfigurationError("task.redundant: two_phase requires forward speed and yaw of the platform")
        position = Task.of(reduced, task.primary_names, task.redundant_names, goal.given["position"]).vertical
        hand_gains, platform_gains = self._gains(context)
        force = self.holding_force(context)
        hand = control.PositionTracker(
            context.primary,
            hand_gains,
            angular=task.primary_coordinates,
            gravity_compensation=None if force is None else force[task.primary],
        )
        outer = control.OUTER_GAINS[self.preset]
        stabilizer = goal.build(
            goal=np.array(goal.given["goal"]),
            position=position,
            k=outer.k,
            rate=outer.rate,
            tolerance=outer.tolerance,
            max_speed=outer.max_speed,
        )
        platform = control.VelocityTracker(stabilizer, platform_gains, None if force is None else force[task.redundant])
        return BuiltController(control.SplitController([(hand, task.primary), (platform, task.redundant)], task.r))

    def _gains(self, context: ControllerContext) -> tuple[control.PositionGains, control.VelocityGains]:
        """Gains of the hand's tracker and of the platform's tracker, from the inertia at the initial configuration."""
        reduced, primary, redundant = context.reduced, context.task.primary, context.task.redundant
        start, dt = context.q0[None], context.simulation.dt
        dead_zone = sized_gain("dead_zone", self.dead_zone, reduced.r)
        design = control.GainDesign(self.preset, delay=self.delay)
        still = dead_zone[redundant] if isinstance(dead_zone, np.ndarray) else dead_zone
        driven = replace(design, adaptation=self.adaptation, overrides={"dead_zone": still})
        with ConfigurationError.at("controller"):
            hand = control.design_position_gains(
                lambda q: reduced.at(q).H[..., primary, :][..., primary], start, dt, design
            )
            platform = control.design_velocity_gains(reduced, start, dt, driven, outputs=redundant)
        return hand, platform


_BANDWIDTH = part(control.GainDesign, "bandwidth")
_VELOCITY_GAINS = preset_gains(control.VelocityGains, "k", "beta", "sigma")
_K21, _K3, _K4 = (preset_gains(control.OuterGains, name) for name in ("k21", "k3", "k4"))


class VelocityTrackerSettings(AdaptationSettings, _BANDWIDTH.model, _VELOCITY_GAINS.model, _K21.model):  # type: ignore[name-defined, misc]
    """Settings of controllers that compute rates of the reducing outputs, which a tracker follows."""

    scaled_only: ClassVar[tuple[str, ...]] = (*AdaptationSettings.scaled_only, "bandwidth")

    tracker: Literal["adaptive", "computed_torque", "velocity"] = "adaptive"
    """Velocity tracker: adaptive (10), or computed torque with the model. Computed torque uses only ``k``. It ignores
    ``beta``, ``sigma``, ``dead_zone``, ``bandwidth``, ``adaptation`` and ``delay``. "velocity": none; the rates become
    velocity commands of the actuators, for a plant with ``servo_time``. It uses no gain of a tracker."""

    def track(
        self,
        context: ControllerContext,
        kinematic: control.KinematicController,
        task: Task | None = None,
        horizon: float | None = None,
        goals: TaskGoals | None = None,
    ) -> BuiltController:
        """Check the reference and build the velocity tracker under a kinematic controller.

        Args:
            context: inputs for building the controller.
            kinematic, task, horizon: as for ``check_motion``.
            goals: goals of whole-body tasks.

        Raises:
            InfeasibleError: no gains fit the motion, or preflight refuses it.
        """
        reduced, q0 = context.reduced, context.q0
        margins, complaints = check_motion(context, kinematic, task, horizon)
        built = partial(BuiltController, warnings=complaints, goals=goals)
        if self.tracker == "computed_torque":
            gain = sized_gain("k", self.k, reduced.r)
            k = {} if gain is None else {"k": gain}
            return built(control.ComputedTorque(reduced, kinematic, **k))
        if self.tracker == "velocity":
            with ConfigurationError.at("controller"):
                return built(control.ActuatorVelocityController(reduced, kinematic))
        # The results of a run are useful even if it ends in a singular configuration.
        region, times = (margins.q, margins.time) if margins.singular is None else (q0[None], None)
        with ConfigurationError.at("controller"):
            design = control.GainDesign(
                self.preset,
                self.bandwidth,
                self.adaptation,
                self.delay,
                overrides=self.tracker_gains(control.VelocityGains, reduced.r),
            )
            gains = control.design_velocity_gains(reduced, region, context.simulation.dt, design, times=times)
        return built(control.VelocityTracker(kinematic, gains, self.holding_force(context)))

    @model_validator(mode="after")
    def _check_tracker(self) -> VelocityTrackerSettings:
        name = "gravity_compensation"
        if self.gravity_compensation and self.tracker == "computed_torque":
            raise wrong(name, "is not available with tracker 'computed_torque', which takes gravity from its model")
        if self.gravity_compensation and self.tracker == "velocity":
            raise wrong(name, "is not available with tracker 'velocity', which gives no forces")
        return self


class RedundancySettings(VelocityTrackerSettings, _K3.model):  # type: ignore[name-defined, misc]
    """Class 1: redundant outputs move so that the vertical ones follow their reference; (12), velocity tracker."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "vertical"})
    advice: ClassVar[str] = "; controller.posture follows it"

    type: Literal["redundancy"]
    """Class 1: (12) over a velocity tracker; with unknown masses or wheels (16) and (20)."""
    posture: Annotated[PartialCall[control.Posture], Entry(control.Posture, late=("task", "reference"))] | None = None
    """Stay near a posture, for tasks with more redundant than vertical outputs (wide A4): ``reference.redundant``, by
    default the initial values of the redundant outputs."""

    @property
    def followed(self) -> frozenset[str]:
        """References that the controller reads; with a posture the redundant one too."""
        return self.follows if self.posture is None else self.follows | {"redundant"}

    def _build(self, context: ControllerContext) -> BuiltController:
        """Build controller (12).

        Raises:
            ConfigurationError: the task does not fit, or the reference has a trailer.
        """
        if context.slithering is not None:
            raise ConfigurationError("reference.path.trailer: needs the controller type 'steering'")
        task, posture = context.task, None
        with ConfigurationError.at("controller.posture"):
            if self.posture is not None:
                posture = self.posture.build(task=task, reference=context.redundant)
        kinematic = control.RedundancyController(
            task,
            context.primary,
            context.vertical,
            k3=self.outer_gain("k3", len(task.vertical)),
            k21=self.outer_gain("k21", len(task.primary)),
            secondary=posture,
        )
        return self.track(context, kinematic, task)


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
        kinematic = control.ReducingOutputController(context.reduced, reference, **k2, monitored=context.monitored)
        return self.track(context, kinematic)


class SteeringSettings(VelocityTrackerSettings, _K3.model, _K4.model):  # type: ignore[name-defined, misc]
    """Class 2s: the angles of redundant outputs, not their rates, move the vertical ones; over a velocity tracker."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "vertical"})

    type: Literal["steering"]
    """Class 2s: backstepping through the steering angle, over a velocity tracker."""

    def _build(self, context: ControllerContext) -> BuiltController:
        kinematic = control.SteeringController(
            context.reduced,
            context.task,
            context.primary,
            context.slithering or context.vertical,
            control.OuterGains(
                k3=self.outer_gain("k3", len(context.task.vertical)),
                k4=float(self.outer_gain("k4")),
                k21=self.outer_gain("k21", len(context.task.primary)),
            ),
            monitored=context.monitored,
        )
        return self.track(context, kinematic)


TrackingTypes = (
    RedundancySettings | ReducingOutputsSettings | JacobianTransposeSettings | SteeringSettings | TwoPhaseSettings
)


class _Reordered:
    """Reference with its outputs in another order."""

    def __init__(self, reference: Reference, order: np.ndarray) -> None:
        self._reference, self._order = reference, order
        self.size, self.duration = reference.size, reference.duration

    def at(self, t: float) -> ReferencePoint:
        point = self._reference.at(t)
        return ReferencePoint(*(each[self._order] for each in point))
