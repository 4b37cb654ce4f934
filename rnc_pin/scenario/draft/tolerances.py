"""Tolerances for numbers of a file: files round lengths and angles to a few digits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

ALIGNED = 1e-3
"""Angle [rad], or its sine, below which two directions are equal: ``1.57`` means a right angle."""
SAME = 1e-3
"""Share of a length (such as a wheel radius) or of a range, below which two positions or values are equal."""
PLACED = 1e-4
"""Distance [m] below which two positions are equal if no reference length is known; wheels are larger than 1 cm."""
DRIVEN = 1e-3
"""Sine of the angle between actuators (or outputs) below which they are linearly dependent."""


def first_smallest(values: Sequence[float] | np.ndarray, slack: float) -> int:
    """Return the index of the first value within ``slack`` of the smallest; rounding does not change it."""
    array = np.asarray(values)
    return int(np.flatnonzero(array <= array.min() + slack)[0])
