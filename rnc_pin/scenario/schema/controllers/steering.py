"""Class 2s: steering by redundant outputs."""

from __future__ import annotations

from typing import ClassVar, Literal

from rnc_pin.control import SteeringController
from rnc_pin.scenario.schema.base import Positive
from rnc_pin.scenario.schema.controllers.base import Built, Context, Gain, chosen
from rnc_pin.scenario.schema.controllers.velocity import OUTER_GAIN, VelocitySettings

_STEERING_GAIN = 10.0  # [1/s], several times k3


class SteeringSettings(VelocitySettings):
    """Class 2s: the angles of redundant outputs, not their rates, move the vertical ones; over a velocity tracker."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "vertical"})

    type: Literal["steering"]
    """Class 2s: backstepping through the steering angle, over a velocity tracker."""
    k3: Gain = None
    """Outer gain on vertical outputs [1/s]; one number, or one for each."""
    k4: Positive | None = None
    """Rate at which the steering angle follows its desired value [1/s]."""

    def make(self, context: Context) -> Built:
        task = context.task
        kinematic = SteeringController(
            context.reduced,
            task,
            context.primary,
            context.slithering or context.vertical,
            k3=chosen("k3", self.k3, OUTER_GAIN, len(task.vertical)),
            k4=_STEERING_GAIN if self.k4 is None else self.k4,
            k21=chosen("k21", self.k21, self.primary_gain, len(task.primary)),
            watched=context.watched,
        )
        return self.tracked(context, kinematic)
