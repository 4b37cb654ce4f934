"""Base settings of controllers of class 1."""

from __future__ import annotations

from typing import ClassVar

from rnc_pin.control import RedundancyController, Secondary
from rnc_pin.errors import ConfigurationError
from rnc_pin.scenario.schema.controllers.base import Context, Gain, chosen
from rnc_pin.scenario.schema.controllers.velocity import OUTER_GAIN, VelocitySettings


class Class1Settings(VelocitySettings):
    """Settings of controllers that move the vertical outputs by the redundant ones."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "vertical"})

    k3: Gain = None
    """Outer gain on vertical outputs (12) [1/s]; one number, or one for each."""

    def class_1(self, context: Context, secondary: Secondary | None = None) -> RedundancyController:
        """Build controller (12) with these gains.

        Raises:
            ConfigurationError: the task does not fit, or the reference has a trailer.
        """
        task = context.task
        if context.slithering is not None:
            raise ConfigurationError("reference.path.trailer: needs the controller type 'steering'")
        return RedundancyController(
            task,
            context.primary,
            context.vertical,
            k3=chosen("k3", self.k3, OUTER_GAIN, len(task.vertical)),
            k21=chosen("k21", self.k21, self.primary_gain, len(task.primary)),
            secondary=secondary,
        )
