"""No control: the robot moves freely."""

from __future__ import annotations

import numpy as np

from rnc_pin.control.controller import Command, Description
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import ReprMixin


class ZeroInput(ReprMixin):
    """All actuator inputs are zero, and no output has a goal.

    Args:
        reduced: the model.
    """

    def __init__(self, reduced: ReducedModel) -> None:
        self.inputs = np.zeros(reduced.p)
        self.inputs.setflags(write=False)

    def describe(self) -> Description:
        """Return the type."""
        return {"type": type(self).__name__}

    def initial_state(self, measurement: Measurement) -> None:
        """Return None: the controller has no state."""

    def step(self, t: float, measurement: Measurement, state: None = None) -> tuple[Command, None]:
        return Command(T=self.inputs), None
