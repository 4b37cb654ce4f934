"""Null motion: motion of the robot that leaves the outputs with goals unchanged."""

from __future__ import annotations

import numpy as np

from rnc_pin.errors import DivergenceError, SingularityError
from rnc_pin.integrators import LieRungeKutta4
from rnc_pin.model.reduced_model import ReducedModel

_STEPS = 5
_DISTANCE = 0.35  # change of the output [its unit]
_NOTHING_ELSE = np.zeros(0)


class NullMotion:
    """Motion of one reducing output while all others are constant: ``v = R e_j``, integrated over a short distance.

    Args:
        reduced: reduced model.
        output: name of the reducing output.
    """

    def __init__(self, reduced: ReducedModel, output: str) -> None:
        self._reduced, self._step = reduced, _DISTANCE / _STEPS
        self._column = list(reduced.reducing.names).index(output)
        self._integrator = LieRungeKutta4(reduced.robot)

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Return the configuration at the end of the motion, or the last one before a singularity."""
        for _ in range(_STEPS):
            try:
                q, _ = self._integrator.step(self._rate, q, _NOTHING_ELSE, self._step)
            except (SingularityError, DivergenceError):
                break
        return q

    def _rate(self, q: np.ndarray, nothing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._reduced.at(q).R[:, self._column], nothing
