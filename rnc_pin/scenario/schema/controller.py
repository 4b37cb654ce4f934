"""Which controller a scenario has, and with which gains."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from rnc_pin.control import (
    Combined,
    JointLimits,
    MomentumRegressor,
    Posture,
    Regressor,
    Secondary,
    SingularityDistance,
    UnknownMass,
    UnknownRadius,
    UnknownTrack,
    WheelRegressor,
)
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.planning import Reference
from rnc_pin.scenario.schema.base import Numbers, Positive, Strict


class UnknownMasses(Strict):
    """Bodies whose masses are estimated."""

    base: str
    """The joint whose momentum is conserved."""
    initial: Annotated[dict[str, float], Field(min_length=1)]
    """Joint that carries the body: first estimate, in ``unit``."""
    unit: Positive = 1.0
    """Mass that counts as 1 [kg]; the paper's parameters m_k / J have unit J."""
    bounds: Annotated[list[float], Field(min_length=2, max_length=2)] = [0.05, 20.0]
    """Estimates stay between these, in ``unit``."""

    def build(self, reduced: ReducedModel) -> Regressor:
        return MomentumRegressor(reduced.robot, self.base, [UnknownMass(joint, self.unit) for joint in self.initial])

    @property
    def estimates(self) -> list[float]:
        return list(self.initial.values())


class _Length(Strict):
    wheels: Annotated[list[str], Field(min_length=1)]
    """Frames of the wheels that share the length."""
    initial: Positive
    """First estimate [m]."""


class UnknownWheels(Strict):
    """Wheels whose radii or tracks are estimated."""

    radii: list[_Length] = []
    """Each a radius that its wheels share."""
    tracks: list[_Length] = []
    """Each the distance of its two wheels along their axle."""
    bounds: Annotated[list[float], Field(min_length=2, max_length=2)] = [0.01, 5.0]
    """Of all of them [m]."""

    @model_validator(mode="after")
    def _something_unknown(self) -> UnknownWheels:
        if not self.radii and not self.tracks:
            raise ValueError("name at least one radius or track")
        return self

    def build(self, reduced: ReducedModel) -> Regressor:
        radii = [UnknownRadius(each.wheels) for each in self.radii]
        return WheelRegressor(reduced, [*radii, *(UnknownTrack(each.wheels) for each in self.tracks)])

    @property
    def estimates(self) -> list[float]:
        return [each.initial for each in (*self.radii, *self.tracks)]


def _what_is_unknown(raw: Any) -> str:
    keys = raw if isinstance(raw, dict) else ()
    return "unknown_wheels" if "radii" in keys or "tracks" in keys else "unknown_masses"


Unknown = Annotated[
    Annotated[UnknownMasses, Tag("unknown_masses")] | Annotated[UnknownWheels, Tag("unknown_wheels")],
    Discriminator(_what_is_unknown),
]


class PlatformGoal(Strict):
    """Where a unicycle platform goes in the second phase."""

    position: Annotated[list[str], Field(min_length=2, max_length=2)]
    """Vertical outputs that are its x and y."""
    to: Annotated[list[float], Field(min_length=3, max_length=3)]
    """x, y [m] and heading [rad]."""
    begin: Annotated[float, Field(ge=0)]
    """When the second phase starts [s]."""


class PostureSettings(Strict):
    """Redundant outputs near ``reference.redundant``: where they start, unless it says otherwise."""

    k: float | Numbers = 1.0
    """[1/s]; a number or one for each redundant output."""


class JointLimitSettings(Strict):
    """Joints away from their limits."""

    k: float | Numbers = 0.1
    """[m^2/s or rad^2/s]; a number or one for each redundant output."""
    margin: Annotated[float, Field(gt=0, le=0.5)] = 0.1
    """Where it begins, as a share of a joint's range at each end."""
    joints: Annotated[list[str], Field(min_length=1)] | None = None
    """All that have limits by default."""


class SingularitySettings(Strict):
    """Away from singular configurations."""

    k: float | Numbers = 0.1
    """[m^2/s or rad^2/s]; a number or one for each redundant output."""


class SecondarySettings(Strict):
    """What the freedom that is left is for, where more outputs are redundant than vertical; they add up."""

    posture: PostureSettings | None = None
    joint_limits: JointLimitSettings | None = None
    singularity: SingularitySettings | None = None

    @model_validator(mode="after")
    def _something(self) -> SecondarySettings:
        if self.posture is self.joint_limits is self.singularity is None:
            raise ValueError("expected at least one of posture, joint_limits, singularity; {} takes their defaults")
        return self

    def build(self, reduced: ReducedModel, task: Task, reference: Reference) -> Secondary:
        parts: list[Secondary] = []
        if self.posture is not None:
            parts.append(Posture(task, reference, np.array(self.posture.k)))
        if self.joint_limits is not None:
            limits = self.joint_limits
            parts.append(JointLimits(reduced, task, np.array(limits.k), limits.margin, limits.joints))
        if self.singularity is not None:
            parts.append(SingularityDistance(reduced, task, np.array(self.singularity.k)))
        return Combined(parts)


class ControllerSettings(Strict):
    """Which controller, which preset of gains, and gains set by hand on top of it."""

    type: Literal[
        "redundancy", "reducing_outputs", "jacobian_transpose", "uncertain_redundancy", "steering", "two_phase"
    ]
    """``redundancy``: (12) over a velocity tracker. ``reducing_outputs``: references for all reducing outputs, the
    vertical ones go where they will. ``jacobian_transpose``: (8)-(9) on the ``active`` actuators, the others off.
    ``uncertain_redundancy``: (16) with what is ``unknown``, masses or wheels, estimated by (20).
    ``steering``: class 2s. ``two_phase``: class 3, (8)-(9) for the primary outputs, then a point stabiliser for the
    platform."""
    tracker: Literal["adaptive", "computed_torque"] = "adaptive"
    """Under the first two types: (10), or the model-based baseline."""
    preset: Literal["paper", "scaled"] = "scaled"
    """Gains of the paper, or gains scaled to the inertia along the way."""
    active: list[str] | None = None
    """Actuators that are on, for ``jacobian_transpose``."""
    unknown: Unknown | None = None
    """What is estimated, for ``uncertain_redundancy``."""
    secondary: SecondarySettings | None = None
    """What the freedom is for that a wide A4 leaves, for ``redundancy``."""
    platform: PlatformGoal | None = None
    """For ``two_phase``."""
    held: bool | None = None
    """Whether the robot starts held up by its actuators, so that trackers know the force that takes."""
    alpha: Annotated[float, Field(ge=0)] | None = None
    """Adaptation of estimated masses (20)."""
    k: float | Numbers | None = None
    """Gain of the velocity tracker (10): one number, or one for each reducing output."""
    k1: float | Numbers | None = None
    """Gain of the position tracker (8)."""
    k2: float | Numbers | None = None
    """Gain of the position tracker (8)."""
    k3: float | Numbers | None = None
    """Outer gain on vertical outputs (12) [1/s]."""
    k21: float | Numbers | None = None
    """Outer gain on primary outputs [1/s]; the paper has 0."""
    k4: Positive | None = None
    """How fast steering follows, for ``steering`` [1/s]."""
    gamma: Positive | None = None
    """Filter of the position tracker (8) [1/s]."""
    beta: float | Numbers | None = None
    """Adaptation rate (9), (10)."""
    sigma: Annotated[float, Field(ge=0)] | None = None
    """Leak of what is adapted [1/s]."""
    bandwidth: Positive | None = None
    """Of the preset ``scaled`` [rad/s]."""
    adaptation: Positive | None = None
    """Of scaled gains, beta / k [1/s]."""
