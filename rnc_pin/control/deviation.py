"""Deviations of outputs from their references."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin import _kernel
from rnc_pin.errors import InputError
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.planning.references import ReferencePoint


class Deviation(NamedTuple):
    """Errors and feedforward of k outputs, (..., k) each; for rotations, angular quantities in world axes."""

    velocity: np.ndarray
    """Velocity of the reference, (k,)."""
    acceleration: np.ndarray
    """Acceleration of the reference, (k,)."""
    error: np.ndarray
    """Desired minus actual output."""
    error_rate: np.ndarray


def deviation(coordinates: Coordinates, desired: ReferencePoint, actual: np.ndarray, rate: np.ndarray) -> Deviation:
    """Return the deviation of outputs (..., k) and their rates (..., k) from a reference."""
    velocity, acceleration = coordinates.to_rates(desired.position, desired.velocity, desired.acceleration)
    error = coordinates.difference(desired.position, actual)
    return Deviation(velocity, acceleration, error, coordinates.difference_rate(error, velocity, rate))


def fed_back(gain: float | np.ndarray, error: np.ndarray, actual: np.ndarray) -> np.ndarray:
    """Return ``gain * error`` (..., k) for outputs (..., k); an output with zero gain needs no value.

    Raises:
        InputError: an output with a nonzero gain has no desired value; or it is a quasi-velocity whose integral is not
            given.
    """
    product = gain * error
    if np.isfinite(product).all():
        return product
    missing = np.isnan(error) & (np.broadcast_to(gain, error.shape) != 0)
    without = missing & ~np.isnan(actual)
    if without.any():
        column = int(np.flatnonzero(without.any(axis=tuple(range(without.ndim - 1))))[0])
        raise InputError(
            f"the reference is NaN at output {column + 1} of {error.shape[-1]}: expected a number for each output with "
            "a feedback gain"
        )
    if missing.any():
        raise InputError(
            "a feedback gain acts on an output without a value: it is a quasi-velocity, and its integral is not given; "
            "pass it to measure(q, v2, integrals)"
        )
    return np.asarray(np.where(np.broadcast_to(gain, error.shape) == 0, 0.0, product))


class Feedback:
    """``xd_dot + gain (xd - x)`` and ``xd_ddot + gain (xd - x)_dot`` of k outputs.

    Args:
        coordinates: coordinate types of the outputs.
        gain: a number or one for each output.
    """

    def __init__(self, coordinates: Coordinates, gain: float | np.ndarray) -> None:
        self._coordinates, self._gain = coordinates, gain

    @cached_property
    def _table(self) -> np.ndarray:
        """Gains and kinds (2, k) of the outputs for the kernel."""
        kinds = self._coordinates.kinds
        return np.stack([np.broadcast_to(self._gain, kinds.shape), kinds]).astype(float)

    def __call__(self, desired: ReferencePoint, actual: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return both sums (..., k) for outputs (..., k) and their rates (..., k)."""
        if actual.ndim <= 2:
            found = np.empty((2, *actual.shape))
            if actual.ndim == 2:  # selected columns of many runs are stored by columns
                actual, rate = np.ascontiguousarray(actual), np.ascontiguousarray(rate)
            point = desired.position, desired.velocity, desired.acceleration
            if _kernel.library.feedback(*point, actual, rate, self._table, found):
                return found[0], found[1]
            if actual.ndim == 2:  # each run alone: NumPy would round a stack differently
                rows = [self(desired, *row) for row in zip(actual, rate, strict=True)]
                return np.stack([row[0] for row in rows]), np.stack([row[1] for row in rows])
        seen = deviation(self._coordinates, desired, actual, rate)
        return seen.velocity + fed_back(
            self._gain, seen.error, actual
        ), seen.acceleration + self._gain * seen.error_rate
