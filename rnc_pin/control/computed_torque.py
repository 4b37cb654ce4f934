"""Computed torque: the model-based baseline for the adaptive trackers."""

from __future__ import annotations

import numpy as np

from rnc_pin.control.batches import accepts_batches
from rnc_pin.control.controller import Command, Description, KinematicController, command_towards, describe, listed
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import ReprMixin


class ComputedTorque(ReprMixin):
    """``F = H (v2d_dot + k (v2d - v2)) + V v2 + G``: the velocity error decays as exp(-k t).

    Unlike the adaptive trackers, it reads the model. Reads from the measurement: ``q, v2``, and the quantities that its
    kinematic controller reads.

    Args:
        reduced: the model.
        target: kinematic controller that computes ``v2d`` and its rate.
        k: [1/s]; a number or one for each output.
    """

    def __init__(self, reduced: ReducedModel, target: KinematicController, k: float | np.ndarray = 20.0) -> None:
        self._reduced, self.target, self.k = reduced, target, k

    @property
    def accepts_batches(self) -> bool:
        """True if the kinematic controller accepts batches."""
        return accepts_batches(self.target)

    def describe(self) -> Description:
        """Return the gain, and the kinematic controller."""
        return {
            "type": type(self).__name__,
            "k": listed(self.k),
            "target": describe(self.target),
        }

    def initial_state(self, measurement: Measurement) -> object:
        """Return the initial state of the kinematic controller."""
        return self.target.initial_state(measurement)

    def step(self, t: float, measurement: Measurement, state: object) -> tuple[Command, object]:
        target, state = self.target.step(t, measurement, state)
        rate = target.v2_dot + self.k * (target.v2 - measurement.v2)
        q, v2 = measurement.q, measurement.v2
        if v2.ndim == 2:  # one after the other, because products of stacked matrices round differently
            each = zip(q, v2, rate, strict=True)
            F = np.stack([self._reduced.at(q_i, v_i, t=t).inverse_dynamics(rate_i) for q_i, v_i, rate_i in each])
        else:
            F = self._reduced.at(q, v2, t=t).inverse_dynamics(rate)
        return command_towards(target, F), state
