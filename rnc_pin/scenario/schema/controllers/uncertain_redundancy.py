"""Class 1 with unknown masses or wheels."""

from __future__ import annotations

from typing import Literal

from rnc_pin.scenario.schema.controllers.base import Built, Context
from rnc_pin.scenario.schema.controllers.class_1 import Class1Settings
from rnc_pin.scenario.schema.controllers.unknown import Unknown


class UncertainRedundancySettings(Class1Settings):
    """Class 1 with unknown masses or wheels: (16) with the estimates of (20), over a velocity tracker."""

    type: Literal["uncertain_redundancy"]
    """Class 1 with unknown masses or wheels: (16) and (20) over a velocity tracker."""
    unknown: Unknown
    """Masses, or radii and tracks of wheels, to estimate."""

    def make(self, context: Context) -> Built:
        return self.tracked(context, self.class_1(context), context.task)
