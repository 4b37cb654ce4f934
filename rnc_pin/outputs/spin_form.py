"""Angles of a frame's axis: outputs whose rate is a linear form on the frame's spin."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputRows


class SpinFormRow(OutputRows):
    """One output with ``rate = c(q) . spin``, spin in world axes.

    Attributes:
        _frame: index of the frame that spins.
    """

    _frame: int

    @abstractmethod
    def _form_rate(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray]:
        """The covector c (3,) and its rate (3,)."""

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        form, rate = self._form_rate(state)
        return (form @ state.jacobian_dot(self._frame)[3:] + rate @ state.jacobian(self._frame)[3:])[None]

    def drift(self, state: Kinematics) -> np.ndarray:
        form, rate = self._form_rate(state)
        spin = state.velocity(self._frame).angular
        return np.array([form @ state.acceleration(self._frame).angular + rate @ spin])
