"""A frame's velocity along its own axes: knife edges, forward speeds and forces on a frame share it."""

from __future__ import annotations

import numpy as np

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.model.kinematics import OWN_AXES, Kinematics

AXES = {"x": 0, "y": 1, "z": 2}


def axis_index(axis: str) -> int:
    """0, 1 or 2 for "x", "y" or "z"."""
    if axis not in AXES:
        raise ConfigurationError(f"axis '{axis}' is not known{nearest(str(axis), AXES)}")
    return AXES[axis]


class OwnAxisVelocity:
    """Velocity of a frame's origin along one of its own axes, as one row."""

    def __init__(self, frame: int, axis: str) -> None:
        self._frame = frame
        self._axis = axis_index(axis)
        self._row = slice(self._axis, self._axis + 1)

    def jacobian(self, state: Kinematics) -> np.ndarray:
        return state.jacobian(self._frame, OWN_AXES)[self._row]

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        return state.jacobian_dot(self._frame, OWN_AXES)[self._row]

    def drift(self, state: Kinematics) -> np.ndarray:
        return state.own_acceleration(self._frame).linear[self._row]

    def drift_gradient(self, state: Kinematics) -> np.ndarray:
        return state.own_acceleration_gradient(self._frame)[self._row]


class OwnAxisSpin(OwnAxisVelocity):
    """Angular velocity of a frame about one of its own axes, as one row."""

    def __init__(self, frame: int, axis: str) -> None:
        super().__init__(frame, axis)
        self._row = slice(self._axis + 3, self._axis + 4)

    def drift(self, state: Kinematics) -> np.ndarray:
        return state.own_acceleration(self._frame).angular[self._axis : self._axis + 1]
