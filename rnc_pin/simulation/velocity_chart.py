"""The plant's own reducing velocities: regular wherever the constraints have constant rank."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from rnc_pin.model.reduction_data import ReductionData
from rnc_pin.model.state_evaluation import StateEvaluation

_FAR = 3.0  # growth of the squared size of R at which another chart is laid: some velocity leans by 60 degrees


class VelocityChart:
    """Reducing velocities ``w = W v``, W an orthonormal basis of the velocities that the constraints allow at some q.

    There ``R = W^T``. W is constant, so its rows have no rate; where R has grown another chart is laid, and the full
    velocity goes over unchanged. A chart is laid by what A says alone: no output of a controller plays a part, and it
    fails only where the constraints lose rank.

    Args:
        parts: of any reduction of the system.
        q: where the chart is laid, (nq,).
    """

    def __init__(self, parts: ReductionData, q: np.ndarray) -> None:
        m, n = parts.m, parts.n
        A = StateEvaluation.at(parts.in_entries(range(parts.r), free=True), q).A
        self._scale = parts.lengths[:m]
        self.W = scipy.linalg.null_space(A / np.where(self._scale > 0, self._scale, 1.0)[:, None]).T if m else np.eye(n)
        self.reduction_data = parts.in_velocities(self.W)

    def at(self, q: np.ndarray, w: np.ndarray) -> StateEvaluation:
        """The system at a state in this chart."""
        return StateEvaluation.at(self.reduction_data, q, w)

    def is_left(self, state: StateEvaluation) -> bool:
        """Whether a state of this chart deserves one of its own."""
        size = state.R.ravel("K")
        return not size.dot(size) < self.reduction_data.r + _FAR
