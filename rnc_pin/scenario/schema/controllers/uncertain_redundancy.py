"""Class 1 with masses or wheels that are not known."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field

from rnc_pin.control import Estimator, UncertainController
from rnc_pin.scenario.schema.controllers.base import Built, Context, named
from rnc_pin.scenario.schema.controllers.class_1 import Class1Settings
from rnc_pin.scenario.schema.controllers.unknown import Unknown

_ALPHA = {"paper": 1.0, "normalised": 20.0, "scaled": 20.0}


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
        alpha = _ALPHA[self.preset] if self.alpha is None else self.alpha
        low, high = unknown.bounds
        with named("controller.unknown"):
            regressor = unknown.build(reduced)
            estimator = Estimator(reduced, regressor, unknown.estimates, (low, high), alpha, unknown.dead_zone)
        notes = {
            "estimates": dict(zip(regressor.names, regressor.units, strict=True)),
            "predicted": dict(zip(regressor.predicted, regressor.predicted_units, strict=True)),
        }
        # All that is decided beforehand, margins and gains, is decided on what is believed: the truth is not known.
        believed = replace(context, reduced=estimator.model)
        built = self.tracked(believed, self.class_1(context), context.task, notes)
        return replace(built, controller=UncertainController(estimator, built.controller))
