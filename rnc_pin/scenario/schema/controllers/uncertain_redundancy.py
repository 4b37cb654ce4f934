"""Class 1 with masses or wheels that are not known."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rnc_pin.control import UncertainRedundancyController
from rnc_pin.scenario.schema.controllers.base import Built, Context, named
from rnc_pin.scenario.schema.controllers.class_1 import Class1Settings
from rnc_pin.scenario.schema.controllers.unknown import Unknown

_ALPHA = {"paper": 1.0, "scaled": 20.0}


class UncertainRedundancySettings(Class1Settings):
    """Class 1 while masses or wheels are estimated: (16) with estimates from (20) over a velocity tracker."""

    type: Literal["uncertain_redundancy"]
    """Class 1 with unknown masses or wheels: (16) and (20) over a velocity tracker."""
    unknown: Unknown
    """Masses, or radii and tracks of wheels, that are estimated."""
    alpha: Annotated[float, Field(ge=0)] | None = None
    """Adaptation of what is estimated (20); 0 for none."""

    def make(self, context: Context) -> Built:
        reduced, unknown = context.reduced, self.unknown
        exact = self.class_1(context)
        alpha = _ALPHA[self.preset] if self.alpha is None else self.alpha
        low, high = unknown.bounds
        with named("controller.unknown"):
            regressor = unknown.build(reduced)
            estimating = UncertainRedundancyController(
                reduced, exact, regressor, unknown.estimates, (low, high), alpha, unknown.dead_zone
            )
        notes = {
            "estimates": dict(zip(regressor.names, regressor.units, strict=True)),
            "predicted": dict(zip(regressor.predicted, regressor.predicted_units, strict=True)),
        }
        # Gains are scaled along the way that exact kinematics would take: the way that is meant.
        return self.tracked(context, estimating, context.task, exact, notes)
