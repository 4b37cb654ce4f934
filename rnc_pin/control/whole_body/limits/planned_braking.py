"""Decelerations that the efforts of a robot's file allow, for limits that plan to stop in time."""

from __future__ import annotations

import numpy as np

from rnc_pin import _kernel
from rnc_pin.array_shapes import Float
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation

_BRAKING = 0.5  # share of the efforts that may be planned for stopping
_LEAST = 0.1  # of that deceleration remains where gravity takes more
_NO_EFFECT = 1e-9  # [m/s^2 or rad/s^2 per N m] below which an actuator does not change a row


class PlannedBraking:
    """Half of the efforts of a model, less the load at a state: gravity, velocity products and passive forces.

    The other half is left for other rows that brake at the same time, and for a load that grows while the robot stops.
    """

    def __init__(self, reduced: ReducedModel) -> None:
        efforts = reduced.actuation.limits
        self._unlimited = np.flatnonzero(~np.isfinite(efforts))
        self._efforts = np.where(np.isfinite(efforts), _BRAKING * efforts, 0.0)
        self._without_limit = (~np.isfinite(efforts)).astype(float)
        self._any = bool(self._efforts.any())

    def decelerations(self, jacobian: Float[np.ndarray, "k nv"], state: StateEvaluation) -> Float[np.ndarray, " k"]:
        """Accelerations (k,) of rows [m/s^2 or rad/s^2] in their positive direction; infinite without limits."""
        if not (self._any and len(jacobian)):
            return np.full(len(jacobian), np.inf)
        found, efforts = np.empty(len(jacobian)), (self._efforts, self._without_limit)
        known = jacobian, state.E_inverse, state.H, state.input_matrix, state.unforced
        if _kernel.library.decelerations(*known, *efforts, _LEAST, _NO_EFFECT, found):
            return found
        effects, adverse = state.row_accelerations(jacobian @ state.R)
        effects = np.abs(effects)
        planned = effects @ self._efforts
        found = np.maximum(planned + np.minimum(adverse, 0.0), _LEAST * planned)
        found[planned <= _NO_EFFECT] = np.inf
        if len(self._unlimited):
            found[(effects[:, self._unlimited] > _NO_EFFECT).any(axis=1)] = np.inf
        return found
