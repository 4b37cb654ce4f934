"""Where a robot could be as well without moving its task: along the null space of the outputs that have goals."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.errors import SingularityError
from rnc_pin.reduction import ReducedModel

_STEPS = 8


class NullMotion:
    """Moves one reducing output by itself while all others rest: ``v = R e_j``, followed a little way.

    Args:
        reduced: the model.
        output: name of the reducing output.
        far: how far the output goes [its unit].
    """

    def __init__(self, reduced: ReducedModel, output: str, far: float = 0.35) -> None:
        self._reduced, self._step = reduced, far / _STEPS
        self._column = list(reduced.reducing.names).index(output)

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """The configuration at the end of it, or as far as it goes before a singularity (midpoint rule)."""
        model, step = self._reduced.robot.model, self._step
        for _ in range(_STEPS):
            try:
                half = pin.integrate(model, q, 0.5 * step * self._direction(q))
                q = pin.integrate(model, q, step * self._direction(half))
            except SingularityError:
                break
        return q

    def _direction(self, q: np.ndarray) -> np.ndarray:
        E_inverse, _, _ = self._reduced.stack(q)
        return E_inverse[:, self._reduced.m + self._column].copy()
