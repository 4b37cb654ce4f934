"""Linear-quadratic subproblem of one iteration: its scales, its Riccati recursion, and its solution within bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.array_shapes import Float
from rnc_pin.errors import SimulationError
from rnc_pin.model.cached_property import cached_property

_LEAST = 1e-12
_NOT_CONVEX = "the linear-quadratic subproblem is not convex"
_MOST = 40
_BOUNDARY = 0.995  # part of the way to the boundary that a step may go
_STIFFEST = 1e11  # largest weight of a row in the Newton matrix, which rounding allows
_TOLERANCE = 1e-8  # complementarity and residual of the scaled subproblem at the end, relative to the cost
_ENOUGH = 1e-5  # complementarity of a point that is of use


@dataclass
class LinearQuadratic:
    """Linear-quadratic problem over N stages and a last state, in deviations from the current motion.

    ``x_next = A x + B u + gap``, cost ``1/2 [x u] H [x u] + g [x u]``; x at the first stage is zero.
    """

    A: Float[Array, "N nx nx"]
    B: Float[Array, "N nx nu"]
    gap: Float[Array, "N nx"]
    H: Float[Array, "N nz nz"]
    g: Float[Array, "N nz"]
    H_end: Float[Array, "nx nx"]
    g_end: Float[Array, " nx"]
    C: Float[Array, "N1 k nx"]
    D: Float[Array, "N1 k nu"]
    lower: Float[Array, "N1 k"]
    upper: Float[Array, "N1 k"]
    """Rows ``lower <= C x + D u <= upper`` of every stage and of the end, where ``D`` is zero."""

    @cached_property
    def input_scales(self) -> Float[Array, "N nu"]:
        """Scales of the inputs that give each a weight of about one.

        Weights that vanish get the mean of the others.
        """
        nx = self.A.shape[1]
        weights = np.einsum("nii->ni", self.H)[:, nx:].mean(axis=0)
        positive = weights[weights > _LEAST]
        usual = float(np.median(positive)) if len(positive) else 1.0
        scales = 1.0 / np.sqrt(np.maximum(weights, 1e-6 * usual))
        return np.broadcast_to(scales, (len(self.A), len(scales)))

    @property
    def scaled_dynamics(self) -> Float[Array, "N nx nz"]:
        """A and B, for scaled inputs."""
        return np.concatenate([self.A, self.B * self.input_scales[:, None, :]], axis=2)

    def scaled_hessian(self, damping: float) -> Float[Array, "N nz nz"]:
        """H for scaled inputs, with an addition to their weights."""
        N, nx, nu = self.B.shape
        scale = np.concatenate([np.ones((N, nx)), self.input_scales], axis=1)
        H = self.H * scale[:, :, None] * scale[:, None, :]
        H[:, np.arange(nx, nx + nu), np.arange(nx, nx + nu)] += damping
        return H

    @cached_property
    def typical_sizes(self) -> tuple[Float[Array, "N1 k"], Float[Array, "N1 nx"]]:
        """Typical sizes of the rows of each stage, and of the states.

        They are standard deviations under random inputs of the size of their scales, independent from stage to stage.
        """
        N, nx, _ = self.B.shape
        inputs = self.input_scales
        P = np.zeros((N + 1, nx, nx))
        noise = self.B * inputs[:, None, :]
        spread = noise @ noise.mT
        for k in range(N):
            P[k + 1] = self.A[k] @ P[k] @ self.A[k].T + spread[k]
        square = ((self.C @ P) * self.C).sum(axis=2)
        square[:-1] += ((self.D[:-1] * inputs[:, None, :]) ** 2).sum(axis=2)
        rows, sizes = np.sqrt(square), np.sqrt(np.einsum("nii->ni", P))
        return np.maximum(rows, max(1e-4 * float(rows.max(initial=0.0)), _LEAST)), sizes


@dataclass(frozen=True)
class Direction:
    """Solution of the subproblem."""

    x: Float[Array, "N1 nx"]
    u: Float[Array, "N nu"]
    costate: Float[Array, "N1 nx"]
    """Multipliers of the dynamics."""
    iterations: int
    """Iterations of the subproblem; 0 if no bound is active."""


class RiccatiFactors:
    """Factors of ``1/2 z^T H z`` under ``x_next = A x + B u``; z = (x, u).

    Args:
        AB: dynamics (N, nx, nz).
        H: Hessians (N, nz, nz).
        H_end: Hessian of the last state (nx, nx).

    Attributes:
        K: feedback ``u = K x + ...`` (N, nu, nx).
        P: Hessians of the cost to go (N + 1, nx, nx).

    Raises:
        SimulationError: the problem is not convex.
    """

    def __init__(self, AB: Array, H: Array, H_end: Array) -> None:
        N, nx, nz = AB.shape
        self._nx = nx
        self.P = np.empty((N + 1, nx, nx))
        self.K = np.empty((N, nz - nx, nx))
        self._inverse = np.empty((N, nz - nx, nz - nx))
        self.P[N] = P = H_end
        self._AB, H = np.ascontiguousarray(AB), np.ascontiguousarray(H)
        if _kernel.library.riccati_factors(N, nx, nz, self._AB, H, self.P, self.K, self._inverse):
            return
        eye = np.eye(nz - nx)
        for k in range(N - 1, -1, -1):
            F = AB[k]
            M = H[k] + F.T @ (P @ F)
            factor, failed = scipy.linalg.lapack.dpotrf(M[nx:, nx:], lower=1)
            if failed:
                raise SimulationError(_NOT_CONVEX)
            inverse, _ = scipy.linalg.lapack.dpotrs(factor, eye, lower=1)
            cross = M[nx:, :nx]
            K = -inverse @ cross
            P = M[:nx, :nx] + cross.T @ K
            P = (P + P.T) / 2
            self._inverse[k], self.K[k], self.P[k] = inverse, K, P

    def solve(
        self, g: Float[Array, "N nz m"], g_end: Float[Array, "nx m"], gap: Float[Array, "N nx m"]
    ) -> tuple[Float[Array, "N nz m"], Float[Array, "nx m"], Float[Array, "N1 nx m"]]:
        """Minimisers z and last states for linear terms g and offsets of the dynamics, and the costates."""
        (N, nz, m), nx = g.shape, self._nx
        p, z, states = np.empty((N + 1, nx, m)), np.empty((N, nz, m)), np.empty((N + 1, nx, m))
        p[N] = g_end
        given = self._AB, self.K, self._inverse, self.P, np.ascontiguousarray(g), np.ascontiguousarray(gap)
        if _kernel.library.riccati_solve(N, nx, nz, m, *given, p, z, states):
            return z, states[N], p
        carried = self.P[1:] @ gap
        feedforward = np.empty((N, *g[0, nx:].shape))
        for k in range(N - 1, -1, -1):
            slope = g[k] + self._AB[k].T @ (p[k + 1] + carried[k])
            feedforward[k] = -self._inverse[k] @ slope[nx:]
            p[k] = slope[:nx] + self.K[k].T @ slope[nx:]
        x = np.zeros_like(g_end)
        for k in range(N):
            states[k] = z[k, :nx] = x
            z[k, nx:] = self.K[k] @ x + feedforward[k]
            x = self._AB[k] @ z[k] + gap[k]
        states[N] = x
        return z, x, self.P @ states + p


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
    """Interior-point method for linear-quadratic subproblems with elastic rows.

    Rows ``lower <= G z <= upper`` may be violated at a cost of ``weight`` for each unit, in units of their typical
    size, so every subproblem has a solution. The weight is exact: if it exceeds the multipliers, no row is violated
    that can hold. Mehrotra's predictor and corrector share one Riccati factorization (Rao, Wright and Rawlings 1998). A
    subproblem without active bounds is recognised first and costs one factorization.
    """

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
            found = _without_bounds(scaled, equal, weight)
            z, costate, iterations = self._iterate(scaled, weight) if found is None else found
        nx = problem.A.shape[1]
        if not (np.isfinite(z).all() and np.isfinite(costate).all()):
            raise SimulationError("the linear-quadratic subproblem has no finite solution")
        return Direction(z[:, :nx], z[:-1, nx:] * scaled.inputs, costate, iterations)

    def _iterate(self, whole: _Scaled, weight: float) -> tuple[Array, Array, int]:
        p = _packed(whole)
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
            now = _residuals(p, point, weight)
            mu = _complementarity(p, point, weight) / (2 * count)
            step, _ = _newton(p, point, now, factors, W, 0.0, None)
            ahead = _moved(point, step, _length(now, point, step))
            mu_ahead = _complementarity(p, ahead, weight) / (2 * count)
            sigma = min(1.0, max(mu_ahead, 0.0) / max(mu, 1e-300)) ** 3
            step, costate = _newton(p, point, now, factors, W, sigma * mu, step)
            length = min(1.0, _BOUNDARY * _length(now, point, step))
            point = _moved(point, step, length)
            if mu <= _TOLERANCE * scale and length > 0.9:
                return point.z, costate, iteration
        return point.z, costate, _MOST


def _scaled(problem: LinearQuadratic, damping: float) -> tuple[_Scaled, Array]:
    """Scaled subproblem, and the mask of its equations at the end (k,)."""
    N, nx, _ = problem.B.shape
    inputs, (rows, _) = problem.input_scales, problem.typical_sizes
    D = problem.D.copy()
    D[:-1] *= inputs[:, None, :]
    G = np.concatenate([problem.C, D], axis=2) / rows[:, :, None]
    lower, upper = problem.lower / rows, problem.upper / rows
    limit = np.concatenate([upper, -lower], axis=1)
    active = np.isfinite(limit)
    scaled = _Scaled(
        AB=problem.scaled_dynamics,
        gap=problem.gap,
        H=problem.scaled_hessian(damping),
        g=problem.g * np.concatenate([np.ones((N, nx)), inputs], axis=1),
        H_end=problem.H_end,
        g_end=problem.g_end,
        G=np.concatenate([G, -G], axis=1) * active[:, :, None],
        limit=np.where(active, limit, 1.0),
        active=active,
        inputs=inputs,
    )
    return scaled, problem.lower[-1] == problem.upper[-1]


def _without_bounds(p: _Scaled, equal: Array, weight: float) -> tuple[Array, Array, int] | None:
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


def _packed(p: _Scaled) -> _Scaled:
    """Subproblem with the rows that have a limit first in each node, and no more of the others than needed."""
    most = int(p.active.sum(axis=1).max(initial=0))
    order = np.argsort(~p.active, axis=1, kind="stable")[:, :most]
    G = np.take_along_axis(p.G, order[:, :, None], axis=1)
    limit, active = (np.take_along_axis(each, order, axis=1) for each in (p.limit, p.active))
    return p._replace(G=G, limit=limit, active=active.astype(float))


def _start(p: _Scaled, weight: float) -> _Point:
    """Start at zero, with slacks and multipliers inside their limits. Those of rows without a limit never change."""
    shape = p.limit.shape
    z = np.zeros((shape[0], p.AB.shape[2]))
    s = np.where(p.active, np.maximum(p.limit, 0.1), 1.0)
    e = np.where(p.active, np.maximum(s - p.limit, 0.1), 1.0)
    return _Point(z, s, e, np.full(shape, min(1.0, weight / 2)))


def _complementarity(p: _Scaled, at: _Point, weight: float) -> float:
    return float((p.active * (at.s * at.y + at.e * (weight - at.y))).sum())


def _factors(p: _Scaled, at: _Point, weight: float) -> tuple[RiccatiFactors, Array]:
    """Factors of the Newton matrix, and the weights of the rows in it."""
    nx = p.AB.shape[1]
    W = np.minimum(p.active / (at.s / at.y + at.e / (weight - at.y)), _STIFFEST)
    weighted = np.sqrt(W)[:, :, None] * p.G
    added = weighted.mT @ weighted
    return RiccatiFactors(p.AB, p.H + added[:-1], p.H_end + added[-1, :nx, :nx]), W


class _Residuals(NamedTuple):
    """Parts of the Newton equations that predictor and corrector share."""

    other: Array
    """Multipliers of the elastic slacks."""
    primal: Array
    g: Array
    g_end: Array
    gap: Array


def _residuals(p: _Scaled, at: _Point, weight: float) -> _Residuals:
    nx, z = p.AB.shape[1], at.z
    return _Residuals(
        other=weight - at.y,
        primal=np.einsum("nkz,nz->nk", p.G, z) + at.s - at.e - p.limit,
        g=np.einsum("nij,nj->ni", p.H, z[:-1]) + p.g,
        g_end=p.H_end @ z[-1, :nx] + p.g_end,
        gap=p.gap + np.einsum("nij,nj->ni", p.AB, z[:-1]) - z[1:, :nx],
    )


def _newton(
    p: _Scaled, at: _Point, now: _Residuals, factors: RiccatiFactors, W: Array, mu: float, predictor: _Point | None
) -> tuple[_Point, Array]:
    """Newton step to complementarity mu, and the costate after it; the predictor gives terms of second order."""
    nx = p.AB.shape[1]
    first, second = mu - at.s * at.y, mu - at.e * now.other
    if predictor is not None:
        first, second = first - predictor.s * predictor.y, second + predictor.e * predictor.y
    t = now.primal + first / at.y - second / now.other
    force = p.active * (at.y + W * t)
    g = now.g + np.einsum("nkz,nk->nz", p.G[:-1], force[:-1])
    g_end = now.g_end + p.G[-1, :, :nx].T @ force[-1]
    dz, dx, costate = factors.solve(g[:, :, None], g_end[:, None], now.gap[:, :, None])
    step = np.zeros_like(at.z)
    step[:-1], step[-1, :nx] = dz[:, :, 0], dx[:, 0]
    dy = W * (np.einsum("nkz,nz->nk", p.G, step) + t)
    ds = p.active * (first - at.s * dy) / at.y
    de = p.active * (second + at.e * dy) / now.other
    return _Point(step, ds, de, dy), costate[:, :, 0]


def _length(now: _Residuals, at: _Point, step: _Point) -> float:
    """Longest part of a step, up to 1, that keeps slacks and multipliers positive."""
    pairs = ((at.s, step.s), (at.e, step.e), (at.y, step.y), (now.other, -step.y))
    fastest = max(float((change / value).min(initial=0.0)) * -1.0 for value, change in pairs)
    return 1.0 / fastest if fastest > 1.0 else 1.0


def _moved(at: _Point, step: _Point, length: float) -> _Point:
    return _Point(*(value + length * change for value, change in zip(at, step, strict=True)))
