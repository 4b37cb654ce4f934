"""Class 1: redundant outputs move the vertical ones."""

from __future__ import annotations

from typing import ClassVar, Literal

from rnc_pin.control.redundancy import check_freedom
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.scenario.schema.controllers.base import Built, Context
from rnc_pin.scenario.schema.controllers.class_1 import Class1Settings
from rnc_pin.scenario.schema.controllers.secondary import SecondarySettings


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

    def make(self, context: Context) -> Built:
        secondary = None
        if self.secondary is not None:
            try:
                check_freedom(context.task)
                secondary = self.secondary.build(context.reduced, context.task, context.redundant)
            except RncError as error:
                raise ConfigurationError(f"controller.secondary: {error}") from None
        return self.tracked(context, self.class_1(context, secondary), context.task)
