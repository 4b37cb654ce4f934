"""Deviations of outputs from their references."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin.errors import InputError
from rnc_pin.math.coordinates import Coordinates
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


def fed_back(gain: float | np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return ``gain * error`` (..., k); an output with zero gain needs no value.

    Raises:
        InputError: a quasi-velocity has a nonzero gain, but its integral is not given.
    """
    product = gain * error
    if np.isfinite(product).all():
        return product
    if np.isnan(np.where(np.broadcast_to(gain, error.shape) == 0, 0.0, error)).any():
        raise InputError(
            "a feedback gain acts on an output without a value: it is a quasi-velocity, and its integral is not given; "
            "pass it to measure(q, v2, integrals)"
        )
    return np.asarray(np.where(np.broadcast_to(gain, error.shape) == 0, 0.0, product))
