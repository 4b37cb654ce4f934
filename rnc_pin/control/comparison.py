"""Where outputs should be against where they are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin.math.coordinates import Coordinates
from rnc_pin.planning.references import ReferencePoint


class Comparison(NamedTuple):
    """What feedback of k outputs is made of, (..., k) each; of rotations all are angular rates in world axes."""

    velocity: np.ndarray
    """Of the reference, (k,)."""
    acceleration: np.ndarray
    """Of the reference, (k,)."""
    error: np.ndarray
    """Desired less actual."""
    error_rate: np.ndarray


def compare(coordinates: Coordinates, desired: ReferencePoint, actual: np.ndarray, rate: np.ndarray) -> Comparison:
    """A reference against outputs (..., k) and their rates (..., k)."""
    velocity, acceleration = coordinates.to_rates(desired.position, desired.velocity, desired.acceleration)
    error = coordinates.difference(desired.position, actual)
    return Comparison(velocity, acceleration, error, coordinates.difference_rate(error, velocity, rate))
