"""Margins of affine vectors inside second-order cones under the choice that makes the least one large, smoothly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Bool, Float

_SHARPNESS = (30.0, 300.0, 2000.0)
_ROUND = 1e-4  # length below which the norm of a vector is rounded off
_SMALL = 1e-3  # weight of the squares of the vectors: which choice, if margins do not tell
_STEPS = 25  # of Newton's method for each sharpness
_LENGTHS = 0.5 ** np.arange(12)
_SOLVED = 1e-13  # slope at which the method ends


class BestMargins(NamedTuple):
    """Margins at the best choice z, and their sensitivity.

    With a cost f of the vectors c, and its Hessian H, the choice satisfies ``gain^T f_c = 0``. A margin with the slope
    g by c changes by g along a change of c that the choice cannot make. The choice itself moves by
    ``-(gain^T H gain)^-1 gain^T (dgain^T f_c + H dc)``.
    """

    margins: Float[Array, "N m"]
    z: Float[Array, "N d"]
    slope: Float[Array, "N m k"]
    """f_c."""
    change: Float[Array, "N m d"]
    """``a = (gain^T H gain)^-1 gain^T g`` for each margin."""
    sensitivity: Float[Array, "N m m k"]
    """``g - H gain a`` for each margin."""


class SmoothMargins:
    """Margins ``axis_i n_i - |t_i|`` of vectors ``[n_i; t_i] = offset_i + gain_i z``.

    The choice z minimises, for each group of vectors that it links, ``log(sum exp(-s margin)) / s``, plus small squares
    of the vectors. The least margin is less than the largest possible one by at most ``log(m) / s``. The norm is
    ``sqrt(t^2 + e^2)``. Vectors should be of the order of one: s is 2000, and e is 1e-4.

    Args:
        axis: factors of the components n, (m,).
        along: False for vectors of which only n counts, (m,).
        groups: indices of the vectors that choices link.
    """

    def __init__(self, axis: Float[Array, " m"], along: Bool[Array, " m"], groups: Sequence[Sequence[int]]) -> None:
        self._axis, self._along = axis, along
        self._member = np.zeros((len(groups), len(axis)))
        for number, group in enumerate(groups):
            self._member[number, list(group)] = 1.0

    def largest(self, offset: Float[Array, "N m k"], gain: Float[Array, "N m k d"]) -> BestMargins:
        """Return the margins at the best choice, for stacks of vectors."""
        N, m, k = offset.shape
        flat = gain.reshape(N, m * k, gain.shape[-1])
        still = np.eye(flat.shape[-1]) * ~np.any(flat, axis=1)[:, None]  # directions without an effect
        z = np.zeros((N, flat.shape[-1]))
        for sharpness in _SHARPNESS if flat.shape[-1] and len(self._member) else ():
            for _ in range(_STEPS):
                c = offset + np.matvec(flat, z).reshape(N, m, k)
                cost, slope, H = self._cost(c, sharpness)
                left = np.vecmat(slope.reshape(N, -1), flat)
                going = np.abs(left).max(axis=1) > _SOLVED
                if not going.any():
                    break
                step = -np.linalg.solve(flat.mT @ H @ flat + still, left[..., None])[..., 0]
                fall = (left * step).sum(axis=1)
                moved = c[None] + _LENGTHS[:, None, None, None] * np.matvec(flat, step).reshape(N, m, k)
                costs = self._cost(moved.reshape(-1, m, k), sharpness, value_only=True)[0].reshape(-1, N)
                lower = costs <= cost + 1e-4 * _LENGTHS[:, None] * fall + 1e-15
                length = np.where(lower.any(axis=0) & going, _LENGTHS[lower.argmax(axis=0)], 0.0)
                if not length.any():
                    break
                z = z + length[:, None] * step
        c = offset + np.matvec(flat, z).reshape(N, m, k)
        _, slope, H = self._cost(c, _SHARPNESS[-1])
        margins, slopes = self._of(c)
        own = np.zeros((N, m, m, k))
        own[:, np.arange(m), np.arange(m)] = slopes
        g = own.reshape(N, m, m * k)
        inner = flat.mT @ H @ flat + still
        change = np.linalg.solve(inner, flat.mT @ g.mT).mT if flat.shape[-1] else np.zeros((N, m, 0))
        sensitivity = g - change @ flat.mT @ H
        return BestMargins(margins, z, slope, change, sensitivity.reshape(N, m, m, k))

    def _of(self, c: Array) -> tuple[Array, Array]:
        """Margins, and their slopes (N, m, k)."""
        t = c[..., 1:]
        length = np.sqrt((t * t).sum(axis=-1) + _ROUND**2)
        margins = self._axis * c[..., 0] - self._along * length
        slopes = np.empty_like(c)
        slopes[..., 0], slopes[..., 1:] = self._axis, -t * (self._along / length)[..., None]
        return margins, slopes

    def _cost(self, c: Array, sharpness: float, value_only: bool = False) -> tuple[Array, Array, Array]:
        """Cost, its slope (N, m, k) and its Hessian (N, m k, m k)."""
        N, m, k = c.shape
        margins, slopes = self._of(c)
        inside = np.where(self._member > 0, -sharpness * margins[:, None], -np.inf)  # (N, groups, m)
        top = inside.max(axis=2, keepdims=True)
        weights = np.exp(inside - top)
        total = weights.sum(axis=2, keepdims=True)
        weights = weights / total
        linked = self._member.sum(axis=0)[:, None]
        cost = ((np.log(total) + top) / sharpness).sum(axis=(1, 2)) + 0.5 * _SMALL * (linked * c * c).sum(axis=(1, 2))
        if value_only:
            return cost, cost, cost
        weight = weights.sum(axis=1)
        slope = -weight[..., None] * slopes + _SMALL * linked * c
        H = np.zeros((N, m, k, m, k))
        t = c[..., 1:]
        length = np.sqrt((t * t).sum(axis=-1) + _ROUND**2)
        scale = weight * self._along / length
        units = t / length[..., None]
        curved = scale[..., None, None] * (np.eye(k - 1) - units[..., :, None] * units[..., None, :])
        each = np.arange(m)
        H[:, each, 1:, each, 1:] = np.moveaxis(curved, 1, 0)
        parts = (weights[..., None] * slopes[:, None]).reshape(N, -1, m * k)
        H = H.reshape(N, m * k, m * k) - sharpness * np.einsum("nga,ngb->nab", parts, parts)
        H += _SMALL * np.diag(np.repeat(linked[:, 0], k))
        blocks = sharpness * weight[..., None, None] * slopes[..., :, None] * slopes[..., None, :]
        H5 = H.reshape(N, m, k, m, k)
        H5[:, each, :, each, :] += np.moveaxis(blocks, 1, 0)
        return cost, slope, H
