"""Linear-quadratic subproblem of one iteration: its scales, its Riccati recursion, and an interior-point method."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from rnc_pin import _kernel
from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import SimulationError
from rnc_pin.model.cached_property import cached_property

_LEAST = 1e-12
NOT_CONVEX = "the linear-quadratic subproblem is not convex"


@dataclass
class LinearQuadratic:
    """Linear-quadratic problem over N stages and a last state, in deviations from the current motion.

    ``x_next = AB z + gap`` with ``z = (x, u)``, cost ``1/2 z H z + g z``; x at the first stage is zero.
    """

    AB: Float[Array, "N nx nz"]
    gap: Float[Array, "N nx"]
    H: Float[Array, "N nz nz"]
    g: Float[Array, "N nz"]
    H_end: Float[Array, "nx nx"]
    g_end: Float[Array, " nx"]
    G: Float[Array, "N1 k nz"]
    lower: Float[Array, "N1 k"]
    upper: Float[Array, "N1 k"]
    """Rows ``lower <= G z <= upper`` of every stage and of the end, where no row has inputs."""
    holding: Float[Array, "N nu nx"]
    """Inputs by which deviations of the state change no velocity; zero where none are needed."""

    @cached_property
    def input_scales(self) -> Float[Array, " nu"]:
        """Scales of the inputs that give each a weight of about one.

        Weights that vanish get the mean of the others.
        """
        nx = self.AB.shape[1]
        weights = np.einsum("nii->ni", self.H)[:, nx:].mean(axis=0)
        # The median: one heavy input does not decide about the inputs that have no weight.
        positive = weights[weights > _LEAST]
        usual = float(np.median(positive)) if len(positive) else 1.0
        return np.asarray(1.0 / np.sqrt(np.maximum(weights, 1e-6 * usual)))

    @cached_property
    def scales(self) -> Float[Array, " nz"]:
        """Scales of states, which are one, and of inputs."""
        return np.concatenate([np.ones(self.AB.shape[1]), self.input_scales])

    @cached_property
    def scaled_dynamics(self) -> Float[Array, "N nx nz"]:
        """AB for scaled inputs."""
        return self.AB * self.scales

    def scaled_hessian(self, damping: float) -> Float[Array, "N nz nz"]:
        """H for scaled inputs, with an addition to their weights: of what they add to those that hold velocities."""
        nx, nz = self.AB.shape[1:]
        # Damping would pull an arm down if it counted the efforts that hold it: only what is added to them counts.
        apart = np.tile(np.eye(nz), (len(self.H), 1, 1))[:, nx:]
        apart[:, :, :nx] = -self.holding / self.input_scales[:, None]
        return np.asarray(self.H * np.outer(self.scales, self.scales) + damping * (apart.mT @ apart))

    @cached_property
    def typical_sizes(self) -> Float[Array, "N1 k"]:
        """Typical sizes of the rows of each stage.

        They are standard deviations under random inputs of the size of their scales, independent from stage to stage,
        which add to the inputs that hold velocities: others make the sizes of an unstable motion huge.
        """
        rows = np.sqrt(np.maximum(self._variances(), 0.0))  # rounding may go below zero
        return np.asarray(np.maximum(rows, max(1e-4 * float(rows.max(initial=0.0)), _LEAST)))

    def _variances(self) -> Float[Array, "N1 k"]:
        """Squares of the typical sizes."""
        AB, (N, nx, nz), k = self.scaled_dynamics, self.AB.shape, self.G.shape[1]
        # Inputs that hold velocities act at every stage, and the noise comes on top of them.
        AB = np.concatenate([AB[:, :, :nx] + self.AB[:, :, nx:] @ self.holding, AB[:, :, nx:]], axis=2)
        # The covariance goes forward: P' = A P A^T + B B^T in units of the scales, and C P C^T is the variance of rows.
        rows, C, D = np.empty((N + 1, k)), *map(np.ascontiguousarray, np.split(self.G, [nx], axis=2))
        if _kernel.library.variances(N, nx, nz, k, AB, C, D, self.input_scales, rows):
            return rows
        A, noise = AB[:, :, :nx], AB[:, :, nx:]
        P = np.concatenate([np.zeros((1, nx, nx)), noise @ noise.mT])
        for before, by, after in zip(P, A, P[1:], strict=False):
            after += by @ before @ by.T
        return np.asarray(((C @ P) * C).sum(axis=2) + ((D * self.input_scales) ** 2).sum(axis=2))


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
        for k in range(N - 1, -1, -1):
            F = AB[k]
            M = H[k, nx:] + F[:, nx:].T @ (P @ F)
            factor, failed = scipy.linalg.lapack.dpotrf(M[:, nx:], lower=1)
            if failed:
                raise SimulationError(NOT_CONVEX)
            # The inverse is kept: predictor and corrector solve with it.
            self._inverse[k], _ = scipy.linalg.lapack.dpotrs(factor, np.eye(nz - nx), lower=1)
            self.K[k] = -self._inverse[k] @ M[:, :nx]
            loop = np.concatenate([np.eye(nx), self.K[k]])
            closed = F @ loop
            P = loop.T @ H[k] @ loop + closed.T @ P @ closed  # Joseph's form: positive where weights are stiff
            self.P[k] = P = (P + P.T) / 2  # rounding adds up over the stages

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


_MOST = 40
_BOUNDARY = 0.995  # part of the way to the boundary that a step may go
_STIFFEST = 1e11  # largest weight of a row in the Newton matrix, which rounding allows
_TOLERANCE = 1e-8  # complementarity and residual of the scaled subproblem at the end, relative to the cost
_WARM = 1e-5  # complementarity at the start from known multipliers, relative to the cost
_EARLY = 1e-4, 1e-5  # tolerance far from the optimum: part of the last change of the cost, and the largest
_EARLY_WARM = 1e-3, 1e-7  # complementarity at the start close to it: part of that change, and the smallest
_SLOW = 12  # iterations after which such a start is given up
_REST = 10.0  # part of the first residuals that may remain, relative to the tolerance


class Direction(NamedTuple):
    """Solution of the subproblem."""

    x: Float[Array, "N1 nx"]
    u: Float[Array, "N nu"]
    costate: Float[Array, "N1 nx"]
    """Multipliers of the dynamics."""
    iterations: int
    """Iterations of the subproblem; 0 if no bound is active."""


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

    The multipliers of the last subproblem start the next one, which is a similar one of the same size. If this start is
    slower than usual, the subproblem starts again at the centre.

    Attributes:
        multipliers: of the rows of the last subproblem (N + 1, k); None if no bound was active.
    """

    def __init__(self) -> None:
        self.multipliers: Float[Array, "N1 k"] | None = None
        self._tolerance, self._warm = _TOLERANCE, _WARM

    def solve(self, problem: LinearQuadratic, damping: float, weight: float, change: float | None = None) -> Direction:
        """Return the solution.

        Far from the optimum of the whole problem, less precise solutions lead to it as fast (inexact sequential
        quadratic programming; Dembo, Eisenstat and Steihaug 1982).

        Args:
            problem: the subproblem.
            damping: addition to the weights of the scaled inputs.
            weight: cost of a violation of one unit of a scaled row.
            change: relative change of the cost of the whole problem by the last step, which sets the tolerance; None
                for the smallest one.

        Raises:
            SimulationError: the subproblem is not convex, or its numbers are not finite.
        """
        H, g = problem.scaled_hessian(damping), problem.g * problem.scales
        # Both limits follow the last change of the cost: a subproblem that is solved more finely than the next step
        # changes the problem is work in vain, and a start nearer to the boundary than that change is a bad centre.
        if change is None:
            self._tolerance, self._warm = _TOLERANCE, _WARM
        else:
            self._tolerance = min(max(_EARLY[0] * change, _TOLERANCE), _EARLY[1])
            self._warm = min(max(_EARLY_WARM[0] * change, _EARLY_WARM[1]), _WARM)
        # Known multipliers tell that bounds are active: the test without them would cost a factorization in vain.
        with np.errstate(all="ignore"):
            found = _without_bounds(problem, H, g, weight) if self.multipliers is None else None
            z, costate, iterations = self._within_bounds(problem, H, g, weight) if found is None else found
        nx = problem.AB.shape[1]
        if not (np.isfinite(z).all() and np.isfinite(costate).all()):
            raise SimulationError("the linear-quadratic subproblem has no finite solution")
        return Direction(z[:, :nx], z[:-1, nx:] * problem.input_scales, costate, iterations)

    def _within_bounds(self, problem: LinearQuadratic, H: Array, g: Array, weight: float) -> tuple[Array, Array, int]:
        """Solution within bounds: variables, costates and iterations."""
        p, tied = _scaled(problem, H, g)
        known, self.multipliers = self.multipliers, None
        found = None
        if known is not None and known.shape == p.limit.shape:
            with suppress(SimulationError):
                found = self._iterate(p, weight, _warm_start(p, weight, known, self._warm), _SLOW)
        # A start close to a wrong set of active bounds has small slacks, and steps that they shorten.
        if found is None or found[2] == _SLOW:
            found = self._iterate(p, weight, _start(p, weight), _MOST)
        point, costate, iterations = found
        if np.where(tied, point.e > weight - point.y, point.y > point.s)[p.active > 0].any():
            self.multipliers = point.y
        return point.z, costate, iterations

    def _iterate(self, p: _Scaled, weight: float, point: _Point, most: int) -> tuple[_Point, Array, int]:
        """Solution, costates and number of iterations."""
        N, nx, nz = p.AB.shape
        scale, costate, taken = _cost_scale(p), np.zeros((N + 1, nx)), np.zeros(1)
        given = tuple(np.ascontiguousarray(each) for each in p)
        enough = 1e-5  # complementarity of a point that is of use
        goal, useful, left = self._tolerance * scale, enough * scale, _REST * self._tolerance
        numbers = np.array([weight, most, _BOUNDARY, _STIFFEST, goal, useful, left])
        if _kernel.library.interior_point(N, nx, nz, p.limit.shape[1], *given, numbers, *point, costate, taken):
            if taken[0] == 0:
                raise SimulationError(NOT_CONVEX)
            return point, costate, int(taken[0])
        count, mu, rest = max(1, int(p.active.sum())), np.inf, 1.0
        for iteration in range(1, most + 1):
            try:
                factors, W = _factors(p, point, weight)
            except SimulationError:
                if iteration > 1 and mu <= useful:  # rounding ends the iterations early
                    return point, costate, iteration
                raise
            mu = _complementarity(p, point, weight) / (2 * count)
            # Mehrotra: the step to complementarity zero tells how far one comes, and so how much centring is needed.
            step, _ = _newton(p, point, weight, factors, W, 0.0, None)
            ahead = _moved(point, step, _length(point, step, weight))
            mu_ahead = _complementarity(p, ahead, weight) / (2 * count)
            sigma = min(1.0, max(mu_ahead, 0.0) / max(mu, 1e-300)) ** 3
            step, costate = _newton(p, point, weight, factors, W, sigma * mu, step)
            length = min(1.0, _BOUNDARY * _length(point, step, weight, 1.0 / _BOUNDARY))
            point, rest = _moved(point, step, length), rest * (1.0 - length)
            # Residuals of linear rows fall by the part of each step that is left; nothing else has to be measured. A
            # short last step would leave the costate far from the point.
            if mu <= goal and length > 0.9 and rest <= left:
                return point, costate, iteration
        return point, costate, most


def _scaled(problem: LinearQuadratic, H: Array, g: Array) -> tuple[_Scaled, Array]:
    """Subproblem with scaled numbers, and the mask of its rows that are one side of an equation (N + 1, k).

    Rows that have a limit come first in each node, and no more of the others than needed.
    """
    k, rows, tied = problem.lower.shape[1], problem.typical_sizes, problem.lower == problem.upper
    limit = np.concatenate([problem.upper / rows, -problem.lower / rows], axis=1)
    active = np.isfinite(limit)
    most = int(active.sum(axis=1).max(initial=0))
    order = np.argsort(~active, axis=1, kind="stable")[:, :most]
    nodes = np.arange(len(limit))[:, None]
    row, limit, active = (nodes, order % k), limit[nodes, order], active[nodes, order]
    unit = np.where(order < k, active, -1.0 * active) / rows[row]
    G = problem.G[row] * problem.scales * unit[:, :, None]
    # Rows without a limit have a slack of one and no force: every node has arrays of one size.
    limit, active = np.where(active, limit, 1.0), active.astype(float)
    scaled = _Scaled(problem.scaled_dynamics, problem.gap, H, g, problem.H_end, problem.g_end, G, limit, active)
    return scaled, tied[row]


def _without_bounds(problem: LinearQuadratic, H: Array, g: Array, weight: float) -> tuple[Array, Array, int] | None:
    """Solution under the equations at the end alone; None if it violates a bound or needs a larger multiplier."""
    AB, sizes = problem.scaled_dynamics, problem.typical_sizes
    N, nx, nz = AB.shape
    lower, upper = problem.lower / sizes, problem.upper / sizes
    rows = np.flatnonzero(lower[-1] == upper[-1])
    factors = RiccatiFactors(AB, H, problem.H_end)
    E, goal = problem.G[-1, rows, :nx] / sizes[-1, rows, None], upper[-1, rows]
    many = 1 + len(rows)
    slopes, g_end, gap = np.zeros((N, nz, many)), np.zeros((nx, many)), np.zeros((N, nx, many))
    slopes[:, :, 0], g_end[:, 0], gap[:, :, 0] = g, problem.g_end, problem.gap
    g_end[:, 1:] = E.T
    z, x, costate = factors.solve(slopes, g_end, gap)
    # By least squares: goals may be dependent, such as the yaw of two frames of one body.
    multipliers, *_ = np.linalg.lstsq(-(E @ x[:, 1:]), E @ x[:, 0] - goal, rcond=1e-10)
    combination = np.concatenate([[1.0], multipliers])
    whole = np.zeros((N + 1, nz))
    whole[:-1], whole[-1, :nx] = z @ combination, x @ combination
    value = np.matvec(problem.G, whole * problem.scales)
    beyond = np.maximum(lower - value / sizes, value / sizes - upper)
    # The goal is found by solving equations, whose rounding grows with the length of the motion.
    inside = beyond <= 1e-9
    inside[-1, rows] = beyond[-1, rows] <= 1e-7
    if not inside.all() or np.abs(multipliers).max(initial=0.0) >= weight:
        return None
    return whole, costate @ combination, 0


def _start(p: _Scaled, weight: float) -> _Point:
    """Start at zero, with slacks and multipliers inside their limits. Those of rows without a limit never change."""
    shape = p.limit.shape
    z = np.zeros((shape[0], p.AB.shape[2]))
    s = np.where(p.active, np.maximum(p.limit, 0.1), 1.0)
    e = np.where(p.active, np.maximum(s - p.limit, 0.1), 1.0)
    return _Point(z, s, e, np.full(shape, min(1.0, weight / 2)))


def _warm_start(p: _Scaled, weight: float, y: Array, complementarity: float) -> _Point:
    """Start near the multipliers of a similar subproblem, whose solution this one is the next step from."""
    mu, on = complementarity * _cost_scale(p), p.active > 0
    # On the central path s y = mu. A row that is far from its limit has a small multiplier, and one that is violated,
    # an elastic slack: each pair starts there, and not at the last point, of which complementarity is zero.
    least = mu / np.maximum(p.limit, np.sqrt(mu))
    y = np.where(on, np.minimum(np.maximum(y, least), 0.9 * weight), min(1.0, weight / 2))
    s = np.where(on, np.maximum(p.limit, mu / y), 1.0)
    e = np.where(on, np.maximum(-p.limit, mu / (weight - y)), 1.0)
    return _Point(np.zeros((len(y), p.AB.shape[2])), s, e, y)


def _cost_scale(p: _Scaled) -> float:
    return 1.0 + float(np.abs(p.g).max(initial=0.0))


def _complementarity(p: _Scaled, at: _Point, weight: float) -> float:
    return float((p.active * (at.s * at.y + at.e * (weight - at.y))).sum())


def _factors(p: _Scaled, at: _Point, weight: float) -> tuple[RiccatiFactors, Array]:
    """Factors of the Newton matrix, and the weights of the rows in it."""
    nx = p.AB.shape[1]
    # Both slacks of a row are eliminated: its stiffness is that of two springs in series.
    W = np.minimum(p.active / (at.s / at.y + at.e / (weight - at.y)), _STIFFEST)
    weighted = np.sqrt(W)[:, :, None] * p.G
    added = weighted.mT @ weighted
    return RiccatiFactors(p.AB, p.H + added[:-1], p.H_end + added[-1, :nx, :nx]), W


def _newton(
    p: _Scaled, at: _Point, weight: float, factors: RiccatiFactors, W: Array, mu: float, predictor: _Point | None
) -> tuple[_Point, Array]:
    """Newton step to complementarity mu, and the costate after it; the predictor gives terms of second order."""
    nx, z, other = p.AB.shape[1], at.z, weight - at.y  # the last: multipliers of the elastic slacks
    primal = np.einsum("nkz,nz->nk", p.G, z) + at.s - at.e - p.limit
    gap = p.gap + np.einsum("nij,nj->ni", p.AB, z[:-1]) - z[1:, :nx]
    first, second = mu - at.s * at.y, mu - at.e * other
    if predictor is not None:
        first, second = first - predictor.s * predictor.y, second + predictor.e * predictor.y
    t = primal + first / at.y - second / other
    force = p.active * (at.y + W * t)
    g = np.einsum("nij,nj->ni", p.H, z[:-1]) + p.g + np.einsum("nkz,nk->nz", p.G[:-1], force[:-1])
    g_end = p.H_end @ z[-1, :nx] + p.g_end + p.G[-1, :, :nx].T @ force[-1]
    dz, dx, costate = factors.solve(g[:, :, None], g_end[:, None], gap[:, :, None])
    step = np.zeros_like(at.z)
    step[:-1], step[-1, :nx] = dz[:, :, 0], dx[:, 0]
    dy = W * (np.einsum("nkz,nz->nk", p.G, step) + t)
    ds = p.active * (first - at.s * dy) / at.y
    de = p.active * (second + at.e * dy) / other
    return _Point(step, ds, de, dy), costate[:, :, 0]


def _length(at: _Point, step: _Point, weight: float, most: float = 1.0) -> float:
    """Longest part of a step, up to a part, that keeps slacks and multipliers positive."""
    pairs = ((at.s, step.s), (at.e, step.e), (at.y, step.y), (weight - at.y, -step.y))
    fastest = max(float((change / value).min(initial=0.0)) * -1.0 for value, change in pairs)
    return 1.0 / fastest if fastest > 1.0 / most else most


def _moved(at: _Point, step: _Point, length: float) -> _Point:
    return _Point(*(value + length * change for value, change in zip(at, step, strict=True)))
