"""Nearest point of a polyhedron, by the dual active-set solver DAQP."""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float

_SETTINGS = {"primal_tol": 1e-10, "dual_tol": 1e-12, "iter_limit": 2000}
_COARSE = {"primal_tol": 1e-7, "dual_tol": 1e-9, "iter_limit": 10000}  # where rounding exceeds the tolerance
_SOLVED = 1


class NearestPoint(NamedTuple):
    """Solution of a least-distance program."""

    point: Float[Array, " n"]
    multipliers: Float[Array, " k"]
    """Multipliers of the rows: positive at an active upper bound, negative at an active lower one.
    ``point - goal + rows^T multipliers = 0``."""


def nearest_point(
    goal: Array, rows: Array, lower: Array, upper: Array, multipliers: Array | None = None, coarse: bool = True
) -> NearestPoint | None:
    """Return the point nearest to a goal (n,) with ``lower <= rows x <= upper``; None if there is none.

    Args:
        goal: (n,).
        rows: (k, n).
        lower, upper: bounds, (k,) each; infinite if there are none.
        multipliers: multipliers of a similar program, (k,), to start from.
        coarse: True to try a coarser tolerance too.
    """
    tried: list[tuple[Array | None, dict[str, float]]] = [(None, _SETTINGS)]
    if multipliers is not None and multipliers.any():
        tried.insert(0, (multipliers, _SETTINGS))
    if coarse:
        tried.append((None, _COARSE))
    identity, kinds = np.eye(len(goal)), np.zeros(len(rows), dtype=np.int32)
    for start, settings in tried:
        x, _, status, info = daqp.solve(identity, -goal, rows, upper, lower, kinds, dual_start=start, **settings)
        if status == _SOLVED:
            return NearestPoint(x, info["lam"])
    return None
