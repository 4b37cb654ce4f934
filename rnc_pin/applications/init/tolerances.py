"""Tolerances for numbers of a file: files round to a few digits, and workshops build to a degree and a millimetre."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

ALIGNED = 0.0175
"""Angle [rad], or its sine, below which two directions are equal: 1 degree, e.g. toe-in or the lean of a kingpin."""
SAME = 1e-3
"""Share of a range, or of a radius, below which two values are equal; it bounds rounding, not workmanship."""
PLACED = 3e-3
"""Distance [m] below which two positions are equal, e.g. the axles of two wheels of one axle line."""
DRIVEN = 1e-3
"""Sine of the angle between actuators (or outputs) below which they are linearly dependent."""


def placed(length: float) -> float:
    """Return the distance [m] below which two positions on a part of this length are equal: a tenth of small parts."""
    return min(PLACED, 0.1 * length)


def first_smallest(values: Sequence[float] | np.ndarray, slack: float) -> int:
    """Return the index of the first value within ``slack`` of the smallest; rounding does not change it."""
    array = np.asarray(values)
    return int(np.flatnonzero(array <= array.min() + slack)[0])
