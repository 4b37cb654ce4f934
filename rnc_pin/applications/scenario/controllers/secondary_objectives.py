"""Secondary objectives of redundant outputs, for a wide A4."""

from __future__ import annotations

from typing import Annotated

from pydantic import model_validator

from rnc_pin.applications.scenario.controllers.context import ControllerContext
from rnc_pin.applications.scenario.schema.base import Strict
from rnc_pin.applications.scenario.schema.derived import Entry, PartialCall
from rnc_pin.control import Combined, JointLimits, Posture, Secondary, SingularityDistance, check_freedom


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
