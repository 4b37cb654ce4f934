"""Secondary objectives of redundant outputs, for a wide A4."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from rnc_pin.scenario.schema.base import Numbers, Strict


class PostureSettings(Strict):
    """Posture: redundant outputs stay near ``reference.redundant``, by default their initial values."""

    k: float | Numbers = 1.0
    """Gain [1/s]; one number, or one for each redundant output."""


class JointLimitSettings(Strict):
    """Repulsion of joints from their limits."""

    k: float | Numbers = 0.1
    """Gain [m^2/s or rad^2/s]; one number, or one for each redundant output."""
    margin: Annotated[float, Field(gt=0, le=0.5)] = 0.1
    """Width of the repulsion zone at each end, as a fraction of the joint's range."""
    joints: Annotated[list[str], Field(min_length=1)] | None = None
    """Joints with repulsion; by default all that have limits."""


class SingularitySettings(Strict):
    """Repulsion from singular configurations."""

    k: float | Numbers = 0.1
    """Gain [m^2/s or rad^2/s]; one number, or one for each redundant output."""


class SecondarySettings(Strict):
    """Secondary objectives, for tasks with more redundant than vertical outputs. The controller adds them."""

    posture: PostureSettings | None = None
    """Stay near a posture."""
    joint_limits: JointLimitSettings | None = None
    """Stay away from joint limits."""
    singularity: SingularitySettings | None = None
    """Stay away from singular configurations."""

    @model_validator(mode="after")
    def _check_any(self) -> SecondarySettings:
        if (self.posture, self.joint_limits, self.singularity) == (None, None, None):
            raise ValueError("expected at least one of posture, joint_limits, singularity; {} takes their defaults")
        return self
