"""Interior-point method for linear-quadratic subproblems with elastic rows.

Rows ``lower <= G z <= upper`` may be violated at a cost of ``weight`` for each unit, in units of their typical size, so
every subproblem has a solution. The weight is exact: if it exceeds the multipliers, no row is violated that can hold.
Mehrotra's predictor and corrector share one Riccati factorization (Rao, Wright and Rawlings 1998). A subproblem without
active bounds is recognised first and costs one factorization.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import SimulationError
from rnc_pin.optimal.linear_quadratic import Direction, LinearQuadratic, input_scales, typical_sizes
from rnc_pin.optimal.riccati import RiccatiFactors

_MOST = 40
_BOUNDARY = 0.995  # part of the way to the boundary that a step may go
_PARALLEL = 1e-12
_STIFFEST = 1e11  # largest weight of a row in the Newton matrix, which rounding allows
_ENOUGH = 1e-5  # complementarity of a point that is of use


class _Scaled(NamedTuple):
    """Subproblem with scaled inputs and rows; G has rows that have a limit on one side, (N + 1, k, nz)."""

    AB: Array
    gap: Array
    H: Array
    g: Array
    H_end: Array
    g_end: Array
    G: Array
    limit: Array
    active: Array
    """Mask of the rows that have a limit, (N + 1, k)."""
    inputs: Array


class _Point(NamedTuple):
    """Iterate: variables with the last state as the last row, slacks, elastic slacks, multipliers."""

    z: Float[Array, "N1 nz"]
    s: Float[Array, "N1 k"]
    e: Float[Array, "N1 k"]
    y: Float[Array, "N1 k"]


class InteriorPointSolver:
    """Solver of subproblems.

    Args:
        tolerance: complementarity and residual of the scaled subproblem at which it ends, relative to the cost.
    """

    def __init__(self, tolerance: float = 1e-8) -> None:
        self._tolerance = tolerance

    def solve(self, problem: LinearQuadratic, damping: float, weight: float) -> Direction:
        """Return the solution.

        Args:
            problem: the subproblem.
            damping: addition to the weights of the scaled inputs.
            weight: cost of a violation of one unit of a scaled row.

        Raises:
            SimulationError: the subproblem is not convex, or its numbers are not finite.
        """
        scaled, equal = _scaled(problem, damping)
        with np.errstate(all="ignore"):
            found = _without_bounds(scaled, problem, equal, weight)
            z, costate, iterations = self._iterate(scaled, weight) if found is None else found
        nx = problem.A.shape[1]
        if not (np.isfinite(z).all() and np.isfinite(costate).all()):
            raise SimulationError("the linear-quadratic subproblem has no finite solution")
        return Direction(z[:, :nx], z[:-1, nx:] * scaled.inputs, costate, iterations)

    def _iterate(self, p: _Scaled, weight: float) -> tuple[Array, Array, int]:
        N, nx, _ = p.AB.shape
        count = max(1, int(p.active.sum()))
        point = _start(p, weight)
        costate = np.zeros((N + 1, nx))
        mu, scale = np.inf, 1.0 + float(np.abs(p.g).max(initial=0.0))
        for iteration in range(1, _MOST + 1):
            try:
                factors, W = _factors(p, point, weight)
            except SimulationError:
                if iteration > 1 and mu <= _ENOUGH * scale:  # rounding ends the iterations early
                    return point.z, costate, iteration
                raise
            flat = p.active * (point.s * point.y + point.e * (weight - point.y))
            mu = float(flat.sum()) / (2 * count)
            step, _ = _newton(p, point, weight, factors, W, 0.0, None)
            length = _length(p, point, step, weight)
            ahead = _moved(point, step, length)
            mu_ahead = float((p.active * (ahead.s * ahead.y + ahead.e * (weight - ahead.y))).sum()) / (2 * count)
            sigma = min(1.0, max(mu_ahead, 0.0) / max(mu, 1e-300)) ** 3
            step, costate = _newton(p, point, weight, factors, W, sigma * mu, step)
            length = min(1.0, _BOUNDARY * _length(p, point, step, weight))
            point = _moved(point, step, length)
            if mu <= self._tolerance * scale and length > 0.9:
                return point.z, costate, iteration
        return point.z, costate, _MOST


def _scaled(problem: LinearQuadratic, damping: float) -> tuple[_Scaled, Array]:
    """Scaled subproblem, and the mask of its equations at the end (k,)."""
    N, nx, nu = problem.B.shape
    inputs = input_scales(problem)
    rows, _ = typical_sizes(problem, inputs)
    scale = np.concatenate([np.ones((N, nx)), inputs], axis=1)
    H = problem.H * scale[:, :, None] * scale[:, None, :]
    H[:, np.arange(nx, nx + nu), np.arange(nx, nx + nu)] += damping
    D = problem.D.copy()
    D[:-1] *= inputs[:, None, :]
    G = np.concatenate([problem.C, D], axis=2) / rows[:, :, None]
    lower, upper = problem.lower / rows, problem.upper / rows
    limit = np.concatenate([upper, -lower], axis=1)
    active = np.isfinite(limit)
    scaled = _Scaled(
        AB=np.concatenate([problem.A, problem.B * inputs[:, None, :]], axis=2),
        gap=problem.gap,
        H=H,
        g=problem.g * scale,
        H_end=problem.H_end,
        g_end=problem.g_end,
        G=np.concatenate([G, -G], axis=1) * active[:, :, None],
        limit=np.where(active, limit, 1.0),
        active=active,
        inputs=inputs,
    )
    return scaled, problem.lower[-1] == problem.upper[-1]


def _without_bounds(
    p: _Scaled, problem: LinearQuadratic, equal: Array, weight: float
) -> tuple[Array, Array, int] | None:
    """Solution under the equations at the end alone; None if it violates a bound or needs a larger multiplier."""
    N, nx, nz = p.AB.shape
    half = p.G.shape[1] // 2
    rows = np.flatnonzero(equal)
    factors = RiccatiFactors(p.AB, p.H, p.H_end)
    E, goal = p.G[-1, rows, :nx], p.limit[-1, rows]
    many = 1 + len(rows)
    g, g_end, gap = np.zeros((N, nz, many)), np.zeros((nx, many)), np.zeros((N, nx, many))
    g[:, :, 0], g_end[:, 0], gap[:, :, 0] = p.g, p.g_end, p.gap
    g_end[:, 1:] = E.T
    z, x, costate = factors.solve(g, g_end, gap)
    if len(rows):
        reach = -(E @ x[:, 1:])
        multipliers, *_ = np.linalg.lstsq(reach, E @ x[:, 0] - goal, rcond=1e-10)
    else:
        multipliers = np.empty(0)
    combination = np.concatenate([[1.0], multipliers])
    last = np.zeros((1, nz))
    last[0, :nx] = x @ combination
    whole = np.concatenate([z @ combination, last])
    residual = np.einsum("nkz,nz->nk", p.G, whole) - p.limit
    residual[~p.active] = -1.0
    inside = residual <= 1e-9
    inside[-1, rows], inside[-1, rows + half] = np.abs(residual[-1, rows]) <= 1e-7, True
    if not inside.all() or np.abs(multipliers).max(initial=0.0) >= weight:
        return None
    return whole, costate @ combination, 0


def _start(p: _Scaled, weight: float) -> _Point:
    """Start at zero, with slacks and multipliers inside their limits."""
    shape = p.limit.shape
    z = np.zeros((shape[0], p.AB.shape[2]))
    s = np.where(p.active, np.maximum(p.limit, 0.1), 1.0)
    e = np.where(p.active, np.maximum(s - p.limit, 0.1), 1.0)
    return _Point(z, s, e, np.where(p.active, min(1.0, weight / 2), 0.0))


def _factors(p: _Scaled, at: _Point, weight: float) -> tuple[RiccatiFactors, Array]:
    """Factors of the Newton matrix, and the weights of the rows in it."""
    nx = p.AB.shape[1]
    y = np.where(p.active, at.y, 1.0)
    other = np.where(p.active, weight - at.y, 1.0)
    W = np.minimum(p.active / (at.s / y + at.e / other), _STIFFEST)
    weighted = np.sqrt(W)[:, :, None] * p.G
    added = weighted.mT @ weighted
    return RiccatiFactors(p.AB, p.H + added[:-1], p.H_end + added[-1, :nx, :nx]), W


def _newton(
    p: _Scaled, at: _Point, weight: float, factors: RiccatiFactors, W: Array, mu: float, predictor: _Point | None
) -> tuple[_Point, Array]:
    """Newton step to complementarity mu, and the costate after it; the predictor gives terms of second order."""
    nx = p.AB.shape[1]
    y = np.where(p.active, at.y, 1.0)
    other = np.where(p.active, weight - at.y, 1.0)
    first, second = mu - at.s * y, mu - at.e * other
    if predictor is not None:
        first, second = first - predictor.s * predictor.y, second + predictor.e * predictor.y
    primal = np.einsum("nkz,nz->nk", p.G, at.z) + at.s - at.e - p.limit
    t = primal + first / y - second / other
    force = np.where(p.active, at.y + W * t, 0.0)
    z = at.z
    g = np.einsum("nij,nj->ni", p.H, z[:-1]) + p.g + np.einsum("nkz,nk->nz", p.G[:-1], force[:-1])
    g_end = p.H_end @ z[-1, :nx] + p.g_end + p.G[-1, :, :nx].T @ force[-1]
    gap = p.gap + np.einsum("nij,nj->ni", p.AB, z[:-1]) - z[1:, :nx]
    dz, dx, costate = factors.solve(g[:, :, None], g_end[:, None], gap[:, :, None])
    step = np.zeros_like(z)
    step[:-1], step[-1, :nx] = dz[:, :, 0], dx[:, 0]
    dy = W * (np.einsum("nkz,nz->nk", p.G, step) + t)
    ds, de = (first - at.s * dy) / y, (second + at.e * dy) / other
    return _Point(step, *(np.where(p.active, each, 0.0) for each in (ds, de, dy))), costate[:, :, 0]


def _length(p: _Scaled, at: _Point, step: _Point, weight: float) -> float:
    """Longest part of a step, up to 1, that keeps slacks and multipliers positive."""
    longest = 1.0
    for value, change in ((at.s, step.s), (at.e, step.e), (at.y, step.y), (weight - at.y, -step.y)):
        falling = p.active & (change < -_PARALLEL)
        if falling.any():
            longest = min(longest, float((-value[falling] / change[falling]).min()))
    return longest


def _moved(at: _Point, step: _Point, length: float) -> _Point:
    return _Point(*(value + length * change for value, change in zip(at, step, strict=True)))
