"""Small convex programs: margins inside cones, for stacks of programs, and nearest points of polyhedra.

The largest common margin e of affine vectors inside second-order cones:

    maximise e  subject to  |t_i(z)| <= n_i(z) - e w_i,  with [n_i; t_i] = offset_i + gain_i z.

A primal-dual interior-point method with Nesterov-Todd scaling and Mehrotra's corrector solves all programs of a stack
together (Vandenberghe, The CVXOPT linear and quadratic cone program solvers, 2010). Nearest points are found by the
dual active-set solver DAQP.
"""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np

from rnc_pin.array_shapes import Array, Float


def cone_margin(
    offset: Float[Array, "N m k"], gain: Float[Array, "N m k d"], weights: Float[Array, "N m"] | None = None
) -> tuple[Float[Array, " N"], Float[Array, "N d"]]:
    """Return the largest margins e of vectors ``offset + gain z``, and z.

    Args:
        offset: vectors at z = 0; the first component is the one along the axis of the cone.
        gain: effects of z, of the order of one; directions without an effect stay 0.
        weights: weights w_i of the margin; one by default.

    A margin that grows without bound ends at ten times the largest component of the offset.
    """
    N, m, k = offset.shape
    # Singular directions leave the method an identity instead of badly scaled gains, and show which inputs have no
    # effect.
    basis, effects, inputs = np.linalg.svd(gain.reshape(N, m * k, gain.shape[-1]), full_matrices=False)
    least_effect = 1e-8  # singular value of the gain, of the order of one, below which a direction has no effect
    acts = effects > least_effect
    d = int(acts.sum(axis=1).max(initial=0))
    acts = acts[:, :d]
    size = np.abs(offset).max(axis=(1, 2), initial=0.0)
    size = np.where(size > 0, size, 1.0)[:, None]
    weights = np.ones((N, m)) if weights is None else weights
    heaviest = weights.max(axis=1, keepdims=True)
    least_weight = 1e-6  # part of the heaviest weight: a weight of zero would divide the start by zero
    w = np.maximum(weights / heaviest, least_weight)
    # Slacks h - G x of the unknowns x = [z; e] lie in cones; the last one caps e.
    h, G = np.zeros((N, m + 1, k)), np.zeros((N, m + 1, k, d + 1))
    largest_margin = 10.0  # in sizes of the vectors: internal forces may let the margin grow without bound
    h[:, :m], h[:, m, 0] = offset / size[:, :, None], largest_margin
    G[:, :m, :, :d] = -(basis[:, :, :d] * acts[:, None]).reshape(N, m, k, d)
    G[:, :m, 0, d], G[:, m, 0, d] = w, 1.0
    # A unit diagonal holds the directions without an effect: all programs of the stack keep one size.
    still = np.eye(d + 1) * np.append(1.0 - acts, np.zeros((N, 1)), axis=1)[:, :, None]
    x, duals = np.zeros((N, d + 1)), np.zeros((N, m + 1, k))
    x[:, d] = ((h[:, :m, 0] - np.linalg.norm(h[:, :m, 1:], axis=2)) / w).min(axis=1, initial=0.0) - 1.0
    duals[:, :, 0] = 1.0 / ((m + 1) * np.append(w, np.ones((N, 1)), axis=1))
    with np.errstate(all="ignore"):  # programs that are solved go on without steps
        x = _interior(h, G, still, x, duals)
    z = np.vecmat(size * x[:, :d] / np.where(acts, effects[:, :d], 1.0), inputs[:, :d])
    return x[:, d] * (size / heaviest)[:, 0], z


def _interior(h: Array, G: Array, still: Array, x: Array, duals: Array) -> Array:
    """Unknowns x at the largest last component of x, with ``h - G x`` in the cones."""
    N, cones, k = h.shape
    aim, one = np.zeros(x.shape[1]), np.zeros(k)
    aim[-1], one[0] = -1.0, 1.0
    slack = h - _times(G, x)
    iterations = 50  # a bound only: a program ends at its gap
    gap_limit = 1e-13  # part of the size of the vectors; the caller scaled them to one
    boundary_share = 0.99  # a step to the boundary itself would leave no scaling
    regularization = 1e-14  # relative to the diagonal: no normal matrix is singular, and rounding is larger
    for _ in range(iterations):
        gap = (slack * duals).sum(axis=(1, 2)) / cones
        going = gap > gap_limit
        W, W_inverse = _scaling(slack, duals)
        scaled, H = np.matvec(W, duals), W_inverse @ G
        flat = H.reshape(N, cones * k, len(aim))
        normal, left = flat.mT @ flat + still, _transposed(G, duals) + aim
        diagonal = np.einsum("nii->ni", normal)
        diagonal *= 1.0 + regularization  # no system is singular
        going &= np.isfinite(normal).all(axis=(1, 2))
        if not going.any():
            break
        normal[~going] = np.eye(len(aim))
        square = _product(scaled, scaled)
        steps = _direction(_quotient(scaled, -square), H, normal, left)
        # Mehrotra: the predictor aims at the boundary, and its length decides how far the corrector is centred.
        affine = np.minimum(1.0, _longest(scaled, *steps[1:]))
        right = -square - _product(*steps[1:]) + ((1.0 - affine) ** 3 * gap)[:, None, None] * one
        steps = _direction(_quotient(scaled, right), H, normal, left)
        length = np.minimum(1.0, boundary_share * _longest(scaled, *steps[1:]))
        # A program that cannot step further keeps its last point; the others of the stack go on.
        going &= np.isfinite(length) & np.isfinite(steps[0]).all(axis=1)
        length = np.where(going, length, 0.0)
        x = x + length[:, None] * np.where(going[:, None], steps[0], 0.0)
        by_dual = np.where(going[:, None, None], np.matvec(W_inverse, steps[2]), 0.0)
        slack, duals = h - _times(G, x), duals + length[:, None, None] * by_dual
    return x


def _direction(right: Array, H: Array, normal: Array, left: Array) -> tuple[Array, Array, Array]:
    """Steps of x, and scaled steps of the slacks and of the duals."""
    x = np.linalg.solve(normal, (-left - _transposed(H, right))[..., None])[..., 0]
    by_dual = _times(H, x) + right
    return x, right - by_dual, by_dual


def least_shares(
    offset: Float[Array, "N m k"], gain: Float[Array, "N m k d"], friction: Float[Array, " m"]
) -> Float[Array, "N m"]:
    """Return shares ``|t_i| / (friction_i n_i)`` of forces [n_i; t_i] that push, with the least largest share.

    Each program is a generalized fractional one, which a scaled method of Dinkelbach solves (Crouzeix and Ferland
    1991): the largest margin of the cones of the last share gives the next share.

    Args:
        offset: forces at z = 0: upward, then along the ground.
        gain: directions in which they are free.
        friction: coefficients of friction; 0 for contacts that only push.

    Returns:
        Shares, 0 for contacts that only push; NaN if no forces push at all contacts.
    """
    shares = np.full(offset.shape[:2], np.nan)
    _, z = cone_margin(offset[:, :, :1], gain[:, :, :1])
    found = _shares(offset + _times(gain, z), friction)
    going = np.flatnonzero(np.isfinite(found).all(axis=1))
    shares[going] = found[going]
    rounds = 30  # a bound only: a program ends when its share no longer falls
    # Part of a share by which another round has to lower it.
    least_progress = 1e-10
    for _ in range(rounds):
        if not len(going):
            break
        # Dinkelbach's step: with the share of the last round, the largest margin is zero at the optimum and positive
        # before it.
        offsets, gains, worst = offset[going], gain[going], shares[going].max(axis=1)
        loads = (offsets + _times(gains, z[going]))[:, :, 0]
        scale = np.where(friction > 0, friction, 1.0)
        axis = np.where(friction > 0, worst[:, None], 1.0) * scale
        # A contact without friction becomes a cone of zero tangents: it only pushes.
        wide = np.concatenate(
            [axis[:, :, None], np.broadcast_to(friction[:, None] > 0, (*axis.shape, offset.shape[2] - 1))], axis=2
        )
        _, best = cone_margin(wide * offsets, wide[:, :, :, None] * gains, scale * loads)
        found = _shares(offsets + _times(gains, best), friction)
        # Shares fall in every round until rounding: a round that gains nothing ends a program.
        better = found.max(axis=1) < (1 - least_progress) * worst
        going, found, best = going[better], found[better], best[better]
        shares[going], z[going] = found, best
    return shares


def _shares(forces: Array, friction: Array) -> Array:
    """Shares (N, m) of friction; infinite at contacts without a load."""
    loads, along = forces[:, :, 0], np.linalg.norm(forces[:, :, 1:], axis=2)
    allowed = friction * loads
    shares = np.divide(along, allowed, out=np.zeros(loads.shape), where=(allowed > 0) & (loads > 0))
    loadless = 1e-9  # part of the largest load below which a contact carries nothing
    shares[loads <= loadless * np.abs(loads).max(axis=1, keepdims=True)] = np.inf
    return shares


def _times(G: Array, x: Array) -> Array:
    N, m, k, n = G.shape
    return np.matvec(G.reshape(N, m * k, n), x).reshape(N, m, k)


def _transposed(G: Array, s: Array) -> Array:
    N, m, k, n = G.shape
    return np.vecmat(s.reshape(N, m * k), G.reshape(N, m * k, n))


def _product(a: Array, b: Array) -> Array:
    """Jordan product of vectors (..., k)."""
    out = a[..., :1] * b + b[..., :1] * a
    out[..., 0] = (a * b).sum(axis=-1)
    return out


def _quotient(a: Array, b: Array) -> Array:
    """Vectors x with the Jordan product ``a x = b``."""
    out = np.empty_like(b)
    out[..., 0] = (a[..., 0] * b[..., 0] - (a[..., 1:] * b[..., 1:]).sum(axis=-1)) / _determinant(a)
    out[..., 1:] = (b[..., 1:] - out[..., :1] * a[..., 1:]) / a[..., :1]
    return out


def _determinant(a: Array) -> Array:
    length = np.linalg.norm(a[..., 1:], axis=-1)
    return np.asarray((a[..., 0] - length) * (a[..., 0] + length))


def _scaling(s: Array, duals: Array) -> tuple[Array, Array]:
    """Nesterov-Todd scalings W with ``W duals = W^-1 s``, and their inverses."""
    # CVXOPT report, section 5: the symmetric square root of the hyperbolic Householder matrix.
    root_s, root_z = np.sqrt(_determinant(s)), np.sqrt(_determinant(duals))
    s, z = s / root_s[..., None], duals / root_z[..., None]
    z = np.concatenate([z[..., :1], -z[..., 1:]], axis=-1)
    mirrored = s[..., 0] * z[..., 0] - (s[..., 1:] * z[..., 1:]).sum(axis=-1)
    w = (s + z) / np.sqrt(2 + 2 * mirrored)[..., None]
    k = w.shape[-1]
    W = np.empty((*w.shape, k))
    W[..., 0, :], W[..., :, 0] = w, w
    tail = w[..., 1:]
    W[..., 1:, 1:] = np.eye(k - 1) + tail[..., :, None] * tail[..., None, :] / (1 + w[..., 0])[..., None, None]
    inverse = W.copy()
    inverse[..., 0, 1:] *= -1
    inverse[..., 1:, 0] *= -1
    size = np.sqrt(root_s / root_z)[..., None, None]
    return size * W, inverse / size


def _longest(scaled: Array, *steps: Array) -> Array:
    """Largest lengths (N,) of steps that leave vectors (N, m, k) in their cones."""
    out = np.full(len(scaled), np.inf)
    grazing = 1e-9  # relative rounding of a discriminant: a step along the cone's surface meets it at a double root
    for step in steps:
        a = step[..., 0] ** 2 - (step[..., 1:] ** 2).sum(axis=-1)
        b = scaled[..., 0] * step[..., 0] - (scaled[..., 1:] * step[..., 1:]).sum(axis=-1)
        c = _determinant(scaled)
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        # Smallest positive root of a x^2 + 2 b x + c, without cancellation.
        found = np.where(b < 0, c / (root - b), -(b + root) / a)
        meets = (a < 0) | (b < 0) & ((1 + grazing) * b * b >= a * c)
        out = np.minimum(out, np.where(meets, found, np.inf).min(axis=1))
    return out


_SETTINGS = {"primal_tol": 1e-10, "dual_tol": 1e-12, "iter_limit": 2000}
ROUNDING = 1e-7
"""Largest excess over a bound where rounding exceeds the tolerance of the first attempt."""
_COARSE = {"primal_tol": ROUNDING, "dual_tol": 1e-9, "iter_limit": 10000}


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
    # A start from old multipliers may mislead the active-set method, so a cold start follows; a coarse tolerance comes
    # last.
    tried: list[tuple[Array | None, dict[str, float]]] = [(None, _SETTINGS)]
    if multipliers is not None and multipliers.any():
        tried.insert(0, (multipliers, _SETTINGS))
    if coarse:
        tried.append((None, _COARSE))
    # Kind 0 of DAQP is an inequality that may be active on either side.
    identity, kinds = np.eye(len(goal)), np.zeros(len(rows), dtype=np.int32)
    solved = 1  # exit flag of DAQP for an optimal point
    for start, settings in tried:
        x, _, status, info = daqp.solve(identity, -goal, rows, upper, lower, kinds, dual_start=start, **settings)
        if status == solved:
            return NearestPoint(x, info["lam"])
    return None


def nonnegative(values: Array, free: Array) -> Array:
    """Return the nearest values that are not below zero; the given values if there are none.

    Args:
        values: (c,).
        free: orthonormal directions of allowed changes, as columns (c, d).
    """
    size = np.abs(values).max(initial=0.0)
    if not free.shape[1] or not size:
        return values
    # The directions are orthonormal: the shortest change has the shortest coefficients.
    found = nearest_point(np.zeros(free.shape[1]), free, -values / size, np.full(len(values), np.inf), coarse=False)
    if found is None:
        return values
    zero = 1e-6  # part of the largest value below which a value is rounding
    shifted = values + free @ (size * found.point)
    return np.where(np.abs(shifted) < zero * size, 0.0, shifted)
