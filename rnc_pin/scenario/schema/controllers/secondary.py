"""What the freedom is for that a wide A4 leaves."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from rnc_pin.control import Combined, JointLimits, Posture, Secondary, SingularityDistance
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.planning import Reference
from rnc_pin.scenario.schema.base import Numbers, Strict


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
        if (self.posture, self.joint_limits, self.singularity) == (None, None, None):
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
