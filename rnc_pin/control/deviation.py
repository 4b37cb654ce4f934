"""Where outputs should be against where they are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin.errors import InputError
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.planning.references import ReferencePoint


class Deviation(NamedTuple):
    """What feedback of k outputs is made of, (..., k) each; of rotations all are angular rates in world axes."""

    velocity: np.ndarray
    """Of the reference, (k,)."""
    acceleration: np.ndarray
    """Of the reference, (k,)."""
    error: np.ndarray
    """Desired less actual."""
    error_rate: np.ndarray


def deviation(coordinates: Coordinates, desired: ReferencePoint, actual: np.ndarray, rate: np.ndarray) -> Deviation:
    """A reference against outputs (..., k) and their rates (..., k)."""
    velocity, acceleration = coordinates.to_rates(desired.position, desired.velocity, desired.acceleration)
    error = coordinates.difference(desired.position, actual)
    return Deviation(velocity, acceleration, error, coordinates.difference_rate(error, velocity, rate))


def fed_back(gain: float | np.ndarray, error: np.ndarray) -> np.ndarray:
    """``gain * error`` (..., k); an output that has no value needs none where its gain is zero.

    Raises:
        InputError: there is a gain on a quasi-velocity whose integral nobody gave.
    """
    product = gain * error
    if np.isfinite(product).all():
        return product
    if np.isnan(np.where(np.broadcast_to(gain, error.shape) == 0, 0.0, error)).any():
        raise InputError(
            "an output that has to be fed back has no value: it is a quasi-velocity, and its integral was not given; "
            "measure(q, v2, integrals) takes it"
        )
    return np.asarray(np.where(np.broadcast_to(gain, error.shape) == 0, 0.0, product))
