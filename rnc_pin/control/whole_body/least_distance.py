"""Least-distance programs: the point nearest to a goal within linear bounds. Every program here has this form."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.extras import missing_extra

_SETTINGS = {"primal_tol": 1e-10, "dual_tol": 1e-12, "iter_limit": 2000}
_SOLVED = 1
_Answer = tuple[Array, float, int, dict[str, Array]]  # of daqp


class NearestPoint(NamedTuple):
    """Solution of a least-distance program."""

    point: Float[Array, " n"]
    multipliers: Float[Array, " k"]
    """Multipliers of the rows: positive at an active upper bound, negative at an active lower one.
    ``point - goal + rows^T multipliers = 0``."""


class LeastDistanceSolver:
    """Solver of ``min |x - goal|^2 / 2`` subject to ``lower <= rows x <= upper``.

    Args:
        name: "daqp" (default), which is called directly, or another solver of ``qpsolvers``, by its name there.

    Raises:
        ConfigurationError: unknown solver, or a solver that is not installed.
    """

    def __init__(self, name: str = "daqp") -> None:
        self.name = name
        self._identities: dict[int, Array] = {}
        self._by_name = name != "daqp"
        if self._by_name:
            _check_installed(name)
        self._daqp: Callable[..., _Answer] | None = None if self._by_name else _imported("daqp").solve

    def solve(
        self, goal: Array, rows: Array, lower: Array, upper: Array, multipliers: Array | None = None
    ) -> NearestPoint | None:
        """Return the nearest point; None if no point satisfies the rows.

        Args:
            goal: (n,).
            rows: (k, n).
            lower, upper: bounds, (k,) each; infinite if there are none.
            multipliers: multipliers of a similar program, (k,), to start from.
        """
        if self._by_name:
            return self._solve_by_name(goal, rows, lower, upper)
        if multipliers is not None and multipliers.any():
            found = self._solve_directly(goal, rows, lower, upper, multipliers)
            if found is not None:
                return found
        return self._solve_directly(goal, rows, lower, upper, None)

    def _solve_directly(
        self, goal: Array, rows: Array, lower: Array, upper: Array, start: Array | None
    ) -> NearestPoint | None:
        kinds = np.zeros(len(rows), dtype=np.int32)
        identity = self._identities.get(len(goal))
        if identity is None:
            identity = self._identities[len(goal)] = np.eye(len(goal))
        assert self._daqp is not None
        x, _, status, info = self._daqp(identity, -goal, rows, upper, lower, kinds, dual_start=start, **_SETTINGS)
        return NearestPoint(x, info["lam"]) if status == _SOLVED else None

    def _solve_by_name(self, goal: Array, rows: Array, lower: Array, upper: Array) -> NearestPoint | None:
        above, below = np.isfinite(upper), np.isfinite(lower)
        G = np.vstack([rows[above], -rows[below]])
        h = np.concatenate([upper[above], -lower[below]])
        qpsolvers = _imported("qpsolvers")  # modules cannot be pickled with a solver
        problem = qpsolvers.Problem(np.eye(len(goal)), -goal, G, h)
        try:
            found = qpsolvers.solve_problem(problem, solver=self.name)
        except qpsolvers.exceptions.SolverError:
            return None
        if not found.found or found.x is None:
            return None
        multipliers = np.zeros(len(rows))
        z = np.zeros(len(h)) if found.z is None else found.z
        multipliers[above] += z[: above.sum()]
        multipliers[below] -= z[above.sum() :]
        return NearestPoint(found.x, multipliers)


def _imported(package: str) -> ModuleType:
    """Import a solver at its first use: most programs need none."""
    try:
        return import_module(package)
    except ImportError:
        missing = "daqp is not installed: pip install daqp" if package == "daqp" else missing_extra("qp")
        raise ConfigurationError(f"solver of the quadratic program: {missing}") from None


def _check_installed(name: str) -> None:
    available = list(_imported("qpsolvers").available_solvers)
    if name not in available:
        raise ConfigurationError(f"no installed solver '{name}'{nearest(name, available)}")
