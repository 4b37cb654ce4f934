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
    BuiltController,
    ControllerContext,
    ControllerSettings,
    Gain,
    check_motion,
)
from rnc_pin.applications.scenario.schema.motions import Pose
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import Strict, wrong
from rnc_pin.model import NotNegative, Positive, Task
from rnc_pin.motion.planning import Joined, Reference, ReferencePoint


class PlatformSettings(Strict):
    """Goal of a unicycle platform in the second phase.

    Attributes:
        to: goal pose: x, y [m] and heading [rad].
        position: names of the vertical outputs x and y of the platform.
        begin: start time of the second phase [s].
    """

    to: Pose
    position: Annotated[list[str], Field(min_length=2, max_length=2)]
    begin: NotNegative = 0.0


class PostureSettings(Strict):
    """Objective that keeps redundant outputs near a reference: ``z = x22d_dot + k (x22d - x22)``.

    Attributes:
        k: gain [1/s]; a number or one for each output. 0 for outputs without a desired position.
    """

    k: Gain = 1.0


class JacobianTransposeSettings(ControllerSettings):
    """Tracking of the primary outputs by the ``active`` actuators, without velocity measurements: (8)-(9).

    Attributes:
        type: position tracker (8)-(9) on the ``active`` actuators; the others are off.
        active: actuators that are on, by name; at least as many as outputs.
        k1: gain of the filtered error w, which replaces the rate (8); one number, or one for each output.
        k2: gain of the error (8); one number, or one for each output.
        gamma: rate of the filter (8) [1/s].
        beta: adaptation gain (9); one number, or one for each output.
        sigma: leak rate of the adapted values [1/s].
    """

    follows: ClassVar[frozenset[str]] = frozenset({"primary"})

    type: Literal["jacobian_transpose"]
    active: list[str]
    k1: Gain | None = None
    k2: Gain | None = None
    gamma: Positive | None = None
    beta: Gain | None = None
    sigma: NotNegative | None = None

    def _build(self, context: ControllerContext) -> BuiltController:
        task, reduced, outputs = context.task, context.reduced, context.task.primary
        with ConfigurationError.at("controller"):
            own = self.given_gains(len(outputs), "k1", "k2", "gamma", "beta", "sigma")
            gains = control.design_position_gains(
                partial(control.effective_inertia, reduced, outputs=outputs, active=self.active),
                context.q0,  # undriven outputs drift, so the region of motion is unknown
                context.simulation.dt,
                control.GainDesign(self.preset, overrides=own),
            )
        tracker = control.PositionTracker(
            context.references["primary"], gains, outputs=outputs, angular=task.primary_coordinates
        )
        return BuiltController(control.JacobianTransposeController(reduced, tracker, self.active))


class TwoPhaseSettings(AdaptationSettings):
    """Class 3: (8)-(9) moves the primary outputs and then holds them while a point stabiliser drives the platform.

    Attributes:
        type: class 3: (8)-(9) for the primary outputs, then a point stabiliser for the platform.
        platform: goal pose and start time of the platform: position, to, begin.
    """

    follows: ClassVar[frozenset[str]] = frozenset({"primary"})

    type: Literal["two_phase"]
    platform: PlatformSettings

    def _build(self, context: ControllerContext) -> BuiltController:
        task, reduced, goal = context.task, context.reduced, self.platform
        x2 = reduced.reducing
        # The stabiliser is that of a unicycle: its two inputs are these two rates.
        if len(task.redundant) != 2 or not x2.quasi[task.redundant[0]] or not x2.angular[task.redundant[1]]:
            raise ConfigurationError("task.redundant: two_phase requires forward speed and yaw of the platform")
        # A task of its own: position need not be among the vertical outputs of the scenario's task.
        position = Task.of(reduced, task.primary_names, task.redundant_names, goal.position).vertical
        hand_gains, platform_gains = self._gains(context)
        force = self.holding_force(context)
        hand = control.PositionTracker(
            context.references["primary"],
            hand_gains,
            angular=task.primary_coordinates,
            gravity_compensation=None if force is None else force[task.primary],
        )
        outer, to = self.outer, np.array(goal.to)
        stabilizer = control.UnicycleStabilizer(
            to, position, goal.begin, k=outer.k, rate=outer.rate, tolerance=outer.tolerance, max_speed=outer.max_speed
        )
        platform = control.VelocityTracker(stabilizer, platform_gains, None if force is None else force[task.redundant])
        return BuiltController(control.SplitController([(hand, task.primary), (platform, task.redundant)], task.r))

    def _gains(self, context: ControllerContext) -> tuple[control.PositionGains, control.VelocityGains]:
        """Gains of the hand's tracker and of the platform's tracker, from the inertia at the initial configuration."""
        reduced, primary, redundant = context.reduced, context.task.primary, context.task.redundant
        start, dt = context.q0[None], context.simulation.dt  # the path of the platform is not known before the run
        dead_zone = self.given_gains(reduced.r, "dead_zone").get("dead_zone")
        design = control.GainDesign(self.preset, delay=self.delay)
        still = dead_zone[redundant] if isinstance(dead_zone, np.ndarray) else dead_zone
        driven = replace(design, adaptation=self.adaptation, overrides={"dead_zone": still})
        with ConfigurationError.at("controller"):
            hand = control.design_position_gains(
                lambda q: reduced.at(q).H[..., primary, :][..., primary], start, dt, design
            )
            platform = control.design_velocity_gains(reduced, start, dt, driven, outputs=redundant)
        return hand, platform


class VelocityTrackerSettings(AdaptationSettings):
    """Settings of controllers that compute rates of the reducing outputs, which a tracker follows.

    Attributes:
        tracker: velocity tracker: adaptive (10), or computed torque with the model. Computed torque uses only ``k``. It
            ignores ``beta``, ``sigma``, ``dead_zone``, ``bandwidth``, ``adaptation`` and ``delay``. "velocity": none;
            the rates become velocity commands of the actuators, for a plant with ``servo_time``. It uses no gain of a
            tracker.
        k21: gain on primary outputs [1/s]; one number, or one for each. Zero for the paper, which uses x21d_dot in open
            loop.
        k: gain of the velocity error [force per velocity]; one number, or one for each reducing output.
        beta: adaptation gain (10); one number, or one for each reducing output.
        sigma: leak rate of the adapted values [1/s].
        bandwidth: for "scaled": bandwidth of the velocity loop [rad/s]; by default the largest that sampling allows.
    """

    scaled_only: ClassVar[tuple[str, ...]] = (*AdaptationSettings.scaled_only, "bandwidth")

    tracker: Literal["adaptive", "computed_torque", "velocity"] = "adaptive"
    k21: Gain | None = None
    k: Gain | None = None
    beta: Gain | None = None
    sigma: NotNegative | None = None
    bandwidth: Positive | None = None

    def track(
        self,
        context: ControllerContext,
        kinematic: control.KinematicController,
        task: Task | None = None,
        horizon: float | None = None,
    ) -> BuiltController:
        """Check the reference and build the velocity tracker under a kinematic controller.

        Args:
            context: inputs for building the controller.
            kinematic, task, horizon: as for ``check_motion``.

        Raises:
            InfeasibleError: no gains fit the motion, or preflight refuses it.
        """
        reduced, q0 = context.reduced, context.q0
        margins, complaints = check_motion(context, kinematic, task, horizon)
        built = partial(BuiltController, warnings=complaints)
        if self.tracker == "computed_torque":
            return built(control.ComputedTorque(reduced, kinematic, **self.given_gains(reduced.r, "k")))
        if self.tracker == "velocity":
            with ConfigurationError.at("controller"):
                return built(control.ActuatorVelocityController(reduced, kinematic))
        # The results of a run are useful even if it ends in a singular configuration.
        region, times = (margins.q, margins.time) if margins.singular is None else (q0[None], None)
        # Gains for the inertia along the whole motion: those for the start would be unstable where H is small.
        with ConfigurationError.at("controller"):
            own = self.given_gains(reduced.r, "k", "beta", "sigma", "dead_zone")
            design = control.GainDesign(self.preset, self.bandwidth, self.adaptation, self.delay, overrides=own)
            designed = control.design_velocity_gains(reduced, region, context.simulation.dt, design, times=times)
        return built(control.VelocityTracker(kinematic, designed, self.holding_force(context)))

    @property
    def velocity_command(self) -> str:
        return "tracker: 'velocity'" if self.tracker == "velocity" else ""

    def _outer_gain(self, name: str, size: int) -> float | np.ndarray:
        """Gain that the settings give, or that of the preset."""
        usual: float = getattr(self.outer, name)
        return self.given_gains(size, name).get(name, usual)

    @model_validator(mode="after")
    def _check_tracker(self) -> VelocityTrackerSettings:
        reasons = {"computed_torque": "which takes gravity from its model", "velocity": "which gives no forces"}
        if self.gravity_compensation and self.tracker in reasons:
            why = f"is not available with tracker '{self.tracker}', {reasons[self.tracker]}"
            raise wrong("gravity_compensation", why)
        return self


class RedundancySettings(VelocityTrackerSettings):
    """Class 1: redundant outputs move so that the vertical ones follow their reference; (12), velocity tracker.

    Attributes:
        type: class 1: (12) over a velocity tracker; with unknown masses or wheels (16) and (20).
        posture: stay near a posture, for tasks with more redundant than vertical outputs (wide A4):
            ``reference.redundant``, by default the initial values of the redundant outputs.
        k3: gain on vertical outputs (12) [1/s]; one number, or one for each.
    """

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "vertical"})
    advice: ClassVar[str] = "; controller.posture follows it"

    type: Literal["redundancy"]
    posture: PostureSettings | None = None
    k3: Gain | None = None

    @property
    def followed(self) -> frozenset[str]:
        """References that the controller reads; with a posture the redundant one too."""
        return self.follows if self.posture is None else self.follows | {"redundant"}

    def _build(self, context: ControllerContext) -> BuiltController:
        """Build controller (12).

        Raises:
            ConfigurationError: the task does not fit, or the reference has a trailer.
        """
        if context.slithering is not None:  # a trailer's heading follows its angle, which (12) does not integrate
            raise ConfigurationError("reference.path.trailer: needs the controller type 'steering'")
        task, posture = context.task, None
        with ConfigurationError.at("controller.posture"):
            if self.posture is not None:
                posture = control.Posture(task, context.references["redundant"], self.posture.k)
        kinematic = control.RedundancyController(
            task,
            context.references["primary"],
            context.references["vertical"],
            k3=self._outer_gain("k3", len(task.vertical)),
            k21=self._outer_gain("k21", len(task.primary)),
            secondary=posture,
        )
        return self.track(context, kinematic, task)


class ReducingOutputsSettings(VelocityTrackerSettings):
    """Each reducing output follows its own reference; the vertical outputs are not controlled.

    Attributes:
        type: tracking of all reducing outputs, over a velocity tracker.
    """

    # Comparisons show the error of vertical outputs without control, so their reference is accepted.
    follows: ClassVar[frozenset[str]] = frozenset({"primary", "redundant", "vertical"})

    type: Literal["reducing_outputs"]

    def _build(self, context: ControllerContext) -> BuiltController:
        task = context.task
        # The controller wants the order of x2, and roles divide it.
        order = np.argsort(np.concatenate([task.primary, task.redundant]))
        reference = _Reordered(Joined([context.references["primary"], context.references["redundant"]]), order)
        k2 = self.given_gains(task.r, "k21").get("k21")
        own = {} if k2 is None else {"k2": k2}
        kinematic = control.ReducingOutputController(context.reduced, reference, **own, monitored=context.monitored)
        return self.track(context, kinematic)


class SteeringSettings(VelocityTrackerSettings):
    """Class 2s: the angles of redundant outputs, not their rates, move the vertical ones; over a velocity tracker.

    Attributes:
        type: class 2s: backstepping through the steering angle, over a velocity tracker.
        k4: rate at which a steering angle follows its desired value [1/s]; several times k3.
        k3: gain on vertical outputs [1/s]; one number, or one for each.
    """

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "vertical"})

    type: Literal["steering"]
    k4: Positive | None = None
    k3: Gain | None = None

    def _build(self, context: ControllerContext) -> BuiltController:
        task = context.task
        gains = control.OuterGains(
            k3=self._outer_gain("k3", len(task.vertical)),
            k4=self.outer.k4 if self.k4 is None else self.k4,
            k21=self._outer_gain("k21", len(task.primary)),
        )
        references = context.references["primary"], context.slithering or context.references["vertical"]
        kinematic = control.SteeringController(context.reduced, task, *references, gains, monitored=context.monitored)
        return self.track(context, kinematic)


class _Reordered:
    """Reference with its outputs in another order."""

    def __init__(self, reference: Reference, order: np.ndarray) -> None:
        self._reference, self._order = reference, order
        self.size, self.duration = reference.size, reference.duration

    def at(self, t: float) -> ReferencePoint:
        return ReferencePoint(*(each[self._order] for each in self._reference.at(t)))
