"""How far numbers of a file may be from what they are meant to be: files write lengths and angles to few digits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

ALIGNED = 1e-3
"""Angle [rad], or sine of one, below which two directions are one: ``1.57`` stands for a right angle."""
SAME = 1e-3
"""Share of a length, such as the radius of a wheel, or of a range below which two places or values are one."""
PLACED = 1e-4
"""Distance [m] that is none where no length is known beside it: wheels are larger than a centimetre."""
DRIVEN = 1e-3
"""Sine of the angle between actuators, or outputs, below which one more adds no force, or no motion."""


def first_smallest(values: Sequence[float] | np.ndarray, slack: float) -> int:
    """Position of the first value that is within ``slack`` of the smallest one: what rounding cannot change."""
    array = np.asarray(values)
    return int(np.flatnonzero(array <= array.min() + slack)[0])
