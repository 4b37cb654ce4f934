"""Controllers in a scenario file: one settings class for each ``type``. The settings only hold and check values.

``rnc_pin.scenario.controllers`` constructs the controllers. To add a type, write its class here, add it to
``_AnyType``, and register its builder there.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, get_args

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from rnc_pin.control import Preset
from rnc_pin.errors import nearest
from rnc_pin.scenario.schema.base import Numbers, Positive, Strict, wrong
from rnc_pin.scenario.schema.outputs import OutputItem
from rnc_pin.scenario.schema.secondary_objectives import SecondarySettings
from rnc_pin.scenario.schema.unknown_parameters import Unknown
from rnc_pin.scenario.schema.whole_body_settings import LimitSettings, TaskItem

GainSetting = float | Numbers | None
"""One number, one for each output, or None for the value of the preset."""


class ControllerSettings(Strict):
    """Settings of one type of controller."""

    follows: ClassVar[frozenset[str]]
    """References of the task that the controller reads."""
    advice: ClassVar[str] = ""
    """Hint for error messages: a setting that reads the other references."""
    scaled_only: ClassVar[tuple[str, ...]] = ()
    """Settings that only the preset ``scaled`` reads."""

    type: str
    """Type of the controller."""
    preset: Preset = "scaled"
    """Default gains. "paper": gains of the paper. "normalised": gains for an ``inertia_bound``. "scaled": gains scaled
    to the reduced inertia H along the reference. Only "scaled" reads H. With unknown masses it reads H of the first
    estimates."""

    @property
    def followed(self) -> frozenset[str]:
        """References that the controller reads with these settings."""
        return self.follows

    @model_validator(mode="before")
    @classmethod
    def _name_missing_setting(cls, raw: object) -> object:
        for name, info in cls.model_fields.items():
            if isinstance(raw, dict) and info.is_required() and name not in raw:
                what = cls.key_descriptions()[name]
                raise wrong(name, f"is missing; expected {what[0].lower()}{what[1:].rstrip('.')}")
        return raw

    @model_validator(mode="after")
    def _check_preset(self) -> ControllerSettings:
        for name in self.scaled_only:
            if self.preset != "scaled" and getattr(self, name) is not None:
                raise wrong(name, "belongs to the preset 'scaled'")
        return self


class InertiaBoundSettings(ControllerSettings):
    """Settings of controllers with an adaptive tracker, whose gains depend on the inertia."""

    inertia_bound: GainSetting = None
    """Upper bound of the reduced inertia, ``diag(inertia_bound) - H >= 0`` [kg, kg m^2], for the preset ``normalised``.
    One number, or one for each reducing output."""

    @model_validator(mode="after")
    def _check_inertia_bound(self) -> InertiaBoundSettings:
        if self.preset == "normalised" and self.inertia_bound is None:
            raise wrong("inertia_bound", "is missing; the preset 'normalised' needs a bound on the reduced inertia")
        if self.preset != "normalised" and self.inertia_bound is not None:
            raise wrong("inertia_bound", "belongs to the preset 'normalised'")
        if self.inertia_bound is not None and np.min(self.inertia_bound) <= 0:
            raise wrong("inertia_bound", f"expected positive numbers, found {self.inertia_bound}")
        return self


class AdaptationSettings(InertiaBoundSettings):
    """Settings of controllers that learn disturbance forces, and unknown parameters of the kinematics."""

    scaled_only: ClassVar[tuple[str, ...]] = ("adaptation", "delay")

    gravity_compensation: bool | None = None
    """True if the actuators hold the robot against gravity before the run. Trackers then start with that force."""
    adaptation: Positive | None = None
    """Adaptation rate ``beta / k`` of the preset ``scaled`` [1/s]."""
    delay: Annotated[float, Field(ge=0)] | None = None
    """Delay from a measurement to its force, not counting sampling [s]. The preset ``scaled`` uses it."""
    dead_zone: GainSetting = None
    """Velocity error below which adaptation stops, because of noise [m/s or rad/s]. One number, or one for each
    reducing output."""
    unknown: Unknown | None = None
    """Masses, or radii and tracks of wheels, to estimate."""
    alpha: Annotated[float, Field(ge=0)] | None = None
    """Adaptation gain of the parameter estimates (20); 0 for constant estimates."""

    @model_validator(mode="after")
    def _check_alpha(self) -> AdaptationSettings:
        if self.alpha is not None and self.unknown is None:
            raise wrong("alpha", "needs 'unknown', which is missing")
        return self

    @model_validator(mode="after")
    def _check_dead_zone(self) -> AdaptationSettings:
        if self.dead_zone is not None and np.min(self.dead_zone) < 0:
            raise wrong("dead_zone", f"expected numbers of at least 0, found {self.dead_zone}")
        return self


class VelocityTrackerSettings(AdaptationSettings):
    """Settings of controllers that compute rates of the reducing outputs, which a tracker follows."""

    scaled_only: ClassVar[tuple[str, ...]] = (*AdaptationSettings.scaled_only, "bandwidth")

    tracker: Literal["adaptive", "computed_torque", "velocity"] = "adaptive"
    """Velocity tracker: adaptive (10), or computed torque with the model. Computed torque uses only ``k``. It ignores
    ``beta``, ``sigma``, ``dead_zone``, ``bandwidth``, ``adaptation`` and ``delay``. "velocity": none; the rates become
    velocity commands of the actuators, for a plant with ``servo_time``. It uses no gain of a tracker."""
    k: GainSetting = None
    """Gain of the velocity tracker; one number, or one for each reducing output."""
    k21: GainSetting = None
    """Outer gain on primary outputs [1/s]; one number, or one for each. The paper uses 0."""
    beta: GainSetting = None
    """Adaptation gain (10); one number, or one for each reducing output."""
    sigma: Annotated[float, Field(ge=0)] | None = None
    """Leak rate of the adapted values [1/s]."""
    bandwidth: Positive | None = None
    """Bandwidth of the velocity tracker with the preset ``scaled`` [rad/s]."""

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


class Class1Settings(VelocityTrackerSettings):
    """Settings of controllers that move the vertical outputs by the redundant ones."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "vertical"})

    k3: GainSetting = None
    """Outer gain on vertical outputs (12) [1/s]; one number, or one for each."""


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


class ReducingOutputsSettings(VelocityTrackerSettings):
    """Each reducing output follows its own reference; the vertical outputs are not controlled."""

    # Comparisons show the error of vertical outputs without control, so their reference is accepted.
    follows: ClassVar[frozenset[str]] = frozenset({"primary", "redundant", "vertical"})

    type: Literal["reducing_outputs"]
    """Tracking of all reducing outputs, over a velocity tracker."""


class JacobianTransposeSettings(InertiaBoundSettings):
    """Tracking of the primary outputs by the ``active`` actuators, without velocity measurements: (8)-(9)."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary"})

    type: Literal["jacobian_transpose"]
    """Position tracker (8)-(9) on the ``active`` actuators; the others are off."""
    active: list[str]
    """Actuators that are on."""
    k1: GainSetting = None
    """Gain k1 of the position tracker (8); one number, or one for each primary output."""
    k2: GainSetting = None
    """Gain k2 of the position tracker (8); one number, or one for each primary output."""
    gamma: Positive | None = None
    """Filter rate of the position tracker (8) [1/s]."""
    beta: GainSetting = None
    """Adaptation gain (9); one number, or one for each primary output."""
    sigma: Annotated[float, Field(ge=0)] | None = None
    """Leak rate of the adapted values [1/s]."""


class UncertainRedundancySettings(Class1Settings):
    """Class 1 with unknown masses or wheels: (16) with the estimates of (20), over a velocity tracker."""

    type: Literal["uncertain_redundancy"]
    """Class 1 with unknown masses or wheels: (16) and (20) over a velocity tracker."""
    unknown: Unknown
    """Masses, or radii and tracks of wheels, to estimate."""


class SteeringSettings(VelocityTrackerSettings):
    """Class 2s: the angles of redundant outputs, not their rates, move the vertical ones; over a velocity tracker."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "vertical"})

    type: Literal["steering"]
    """Class 2s: backstepping through the steering angle, over a velocity tracker."""
    k3: GainSetting = None
    """Outer gain on vertical outputs [1/s]; one number, or one for each."""
    k4: Positive | None = None
    """Rate at which the steering angle follows its desired value [1/s]."""


class StateFeedbackSettings(ControllerSettings):
    """Linear-quadratic regulator about the equilibrium or steady motion nearest to the initial configuration."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "redundant"})

    type: Literal["state_feedback"]
    """Linear-quadratic regulator, for systems with fewer actuators than velocities. It uses the model."""
    coordinates: list[str | OutputItem] | None = None
    """States that describe the configuration: names of entries of v, or outputs; by default all entries of v."""
    rates: list[str] | None = None
    """Reducing outputs whose rates are states; all by default."""
    state_cost: float | Numbers | dict[str, float]
    """Weights of the states: one number, one for each, or a mapping by name. Names of rates end in ``_dot``."""
    input_cost: float | Numbers | dict[str, float] = 1.0
    """Weights of the actuators' inputs: one number, one for each, or a mapping by name."""
    v2: dict[str, float] | None = None
    """Rates of reducing outputs in the steady motion, by name; the initial rates by default."""
    hold: list[str] = []
    """Joints whose equilibrium position is their initial position."""
    cyclic: list[str] = []
    """Joints that may move in the steady motion although the dynamics depend on them, such as an unbalanced wheel."""


class PlanFeedbackSettings(ControllerSettings):
    """Feedback along the plan of ``planner``: its own gains, or those of a time-varying linear-quadratic regulator."""

    follows: ClassVar[frozenset[str]] = frozenset()
    advice: ClassVar[str] = ", which follows the plan of 'planner'"

    type: Literal["plan_feedback"]
    """Planned inputs with feedback. It uses the model."""
    gains: Literal["tvlqr", "plan"] = "tvlqr"
    """Gains: "tvlqr", a regulator with the weights below; or "plan", a regulator with the costs of the plan."""
    state_cost: float | Numbers | dict[str, float] = 1.0
    """Weights of the states for "tvlqr": one number, one for each, or a mapping by name. States are the entries of v
    and, with "(rate)" after the name, the reduced velocities."""
    input_cost: float | Numbers | dict[str, float] = 1.0
    """Weights of the inputs of the plan for "tvlqr": one number, one for each, or a mapping by name."""
    bandwidth: Positive = 20.0
    """Decay rate of velocity errors for plans of the form "kinematic" [1/s]."""
    end: Literal["stop", "continue"] = "stop"
    """Motion after a plan that does not end at rest: "stop" brakes within the accelerations of the plan; "continue"
    keeps its last reduced velocities."""

    @model_validator(mode="after")
    def _weights_belong_to_tvlqr(self) -> PlanFeedbackSettings:
        for name in ("state_cost", "input_cost"):
            if self.gains == "plan" and name in self.model_fields_set:
                raise wrong(name, "belongs to gains 'tvlqr'")
        return self


class PlatformGoal(Strict):
    """Goal of a unicycle platform in the second phase."""

    position: Annotated[list[str], Field(min_length=2, max_length=2)]
    """Names of the vertical outputs x and y of the platform."""
    to: Annotated[list[float], Field(min_length=3, max_length=3)]
    """Goal pose: x, y [m] and heading [rad]."""
    begin: Annotated[float, Field(ge=0)]
    """Start time of the second phase [s]."""


class TwoPhaseSettings(AdaptationSettings):
    """Class 3: (8)-(9) moves the primary outputs and then holds them while a point stabiliser drives the platform."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary"})

    type: Literal["two_phase"]
    """Class 3: (8)-(9) for the primary outputs, then a point stabiliser for the platform."""
    platform: PlatformGoal
    """Goal pose and start time of the platform: position, to, begin."""


class WholeBodySettings(ControllerSettings):
    """Tasks and limits of whole-body control."""

    follows: ClassVar[frozenset[str]] = frozenset()
    advice: ClassVar[str] = "; each task has its own reference"

    tasks: Annotated[list[TaskItem], Field(min_length=1)]
    """Tasks, each with weight, gain and priority. References start at the initial values."""
    limits: LimitSettings = LimitSettings()
    """Limits; by default position and velocity limits of the robot's file, and distances to obstacles."""
    solver: str = "daqp"
    """Solver of the quadratic program: "daqp", or another solver of qpsolvers."""


class VelocityProgramSettings(WholeBodySettings, VelocityTrackerSettings):
    """Whole-body control: tasks within limits as a quadratic program, over a velocity tracker."""

    type: Literal["qp"]
    """Tasks within limits as a quadratic program in the reduced velocities, over a velocity tracker."""
    damping: Annotated[float, Field(ge=0)] = 0.0
    """Cost of the velocity at every level, which bounds it near singular configurations."""


class InverseDynamicsSettings(WholeBodySettings):
    """Whole-body control with efforts: tasks within limits as a quadratic program in the inputs, with the model."""

    type: Literal["inverse_dynamics"]
    """Tasks within limits of motion, effort and grip as a quadratic program in the inputs. It uses the model."""
    velocity_gain: Positive = 20.0
    """Rate at which velocity errors of tasks decay [1/s]; the rest of the motion comes to rest at the same rate."""
    friction: Positive | None = None
    """Coefficient of friction of the ground, for the friction cone of each contact; without it, only normal forces
    have a limit."""


class NoControlSettings(ControllerSettings):
    """No control: the robot moves freely."""

    follows: ClassVar[frozenset[str]] = frozenset()

    type: Literal["none"]
    """Free motion: all actuator inputs are zero, and no output has a goal."""


_AnyType = (
    RedundancySettings
    | ReducingOutputsSettings
    | JacobianTransposeSettings
    | UncertainRedundancySettings
    | SteeringSettings
    | StateFeedbackSettings
    | VelocityProgramSettings
    | InverseDynamicsSettings
    | PlanFeedbackSettings
    | TwoPhaseSettings
    | NoControlSettings
)

TYPES: dict[str, type[ControllerSettings]] = {
    get_args(each.model_fields["type"].annotation)[0]: each for each in get_args(_AnyType)
}
"""Name of each type to its settings class."""


def _check_keys(raw: object) -> object:
    """Refuse settings that belong to another type.

    Such a setting is dropped if it is null. A comparison can therefore change the type alone.
    """
    kind = raw.get("type") if isinstance(raw, dict) else None
    own = TYPES.get(kind) if isinstance(kind, str) else None
    if own is None or not isinstance(raw, dict):
        return raw
    kept = {}
    for key, value in raw.items():
        others = [name for name, each in TYPES.items() if key in each.model_fields]
        if key in own.model_fields or not others:
            kept[key] = value
        elif value is not None:
            whose, hint = ", ".join(others), nearest(key, own.model_fields)
            raise wrong(key, f"does not belong to type '{kind}' (but to {whose}){hint}")
    return kept


ControllerItem = Annotated[_AnyType, Field(discriminator="type"), BeforeValidator(_check_keys)]
