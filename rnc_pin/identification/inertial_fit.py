"""Least squares of measured efforts and momenta over inertias that bodies can have, friction and effort scales.

The prior of pseudo-inertias is the entropic divergence ``tr(J J0^-1) - log det(J J0^-1) - 4``. It is convex, does not
depend on axes and units, and is infinite at the border of the inertias that a body can have. Lee, Wensing and Park,
"Geometric robot dynamic identification: a convex programming approach", IEEE T-RO 2020.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy

_ROUNDS = 4  # times that the standard deviations follow the residuals
_FLOOR = 1e-8  # smallest standard deviation, relative to the size of a row: rounding of a log without noise
_BARRIER = 1e-6  # weight of the prior without a prior: it bounds the inertias, and chooses one where the log shows none
_STAGES = 4  # weights from 1 to the last one
_LOOSE = 1e8  # standard deviation of the first values of other parameters, relative to their sizes
_STEPS = 100
_SETTLED = 1e-12  # decrease of the cost, relative to it, at which the iteration ends
_THICK = 1e-3  # smallest radius of gyration of a body, relative to its size


_UNITS = np.stack([pin.PseudoInertia.FromDynamicParameters(unit).toMatrix() for unit in np.eye(10)])
"""Pseudo-inertias (10, 4, 4) of unit dynamic parameters, in Pinocchio's order."""


def dynamic_parameters(inertia: pin.Inertia) -> np.ndarray:
    """Return Pinocchio's dynamic parameters (10,) of a body with mass; a thin body gets some thickness.

    Args:
        inertia: the inertia.
    """
    p = np.asarray(inertia.toDynamicParameters())
    center = p[1:4] / p[0]
    moments = pseudo_inertia(p)[:3, :3] / p[0] - np.outer(center, center)
    values, axes = np.linalg.eigh(moments)
    size = float(np.sqrt(np.maximum(values, 0.0).sum())) or float(np.linalg.norm(center)) or 1.0
    least = (_THICK * size) ** 2
    if values[0] >= least:
        return p
    moments = p[0] * ((axes * np.maximum(values, least)) @ axes.T)
    turned = np.trace(moments) * np.eye(3) - moments
    return np.asarray(pin.Inertia(p[0], center, turned).toDynamicParameters())


def pseudo_inertia(p: np.ndarray) -> np.ndarray:
    """Return the pseudo-inertia (4, 4): second moments of mass, first moments, mass.

    Args:
        p: dynamic parameters (10,).
    """
    return np.asarray(np.tensordot(p, _UNITS, 1))


class InertiaPrior:
    """Entropic divergence of a body from its inertia in the file.

    Args:
        p: dynamic parameters (10,) of the file.
    """

    def __init__(self, p: np.ndarray) -> None:
        factor = np.linalg.cholesky(pseudo_inertia(p))
        # In these axes, the file's pseudo-inertia is the identity.
        self._units = np.array([_congruent(factor, unit) for unit in _UNITS])

    def divergence(self, p: np.ndarray) -> float:
        """Divergence of dynamic parameters (10,); infinite for a body that cannot exist."""
        J = np.tensordot(p, self._units, 1)
        try:
            factor = np.linalg.cholesky(J)
        except np.linalg.LinAlgError:
            return np.inf
        return float(np.trace(J) - 2 * np.log(np.diag(factor)).sum() - 4)

    def rows(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (10,) and rows (10, 10) of a least-squares term with the divergence's gradient and Hessian."""
        J = np.tensordot(p, self._units, 1)
        factor = np.linalg.cholesky(J)
        inverse = np.linalg.inv(J)
        gradient = np.trace(self._units, axis1=1, axis2=2) - np.einsum("ij,kji->k", inverse, self._units)
        turned = np.array([_congruent(factor, unit) for unit in self._units]).reshape(10, 16)
        root = scipy.linalg.qr(turned.T, mode="r")[0][:10]
        return scipy.linalg.solve_triangular(root.T, gradient, lower=True), root


def _congruent(factor: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """``L^-1 X L^-T`` for a lower triangular factor L."""
    half = scipy.linalg.solve_triangular(factor, matrix, lower=True)
    return np.asarray(scipy.linalg.solve_triangular(factor, half.T, lower=True).T)


@dataclass
class MeasuredRow:
    """Samples of one row: ``y = scale (D p) + offset``."""

    name: str
    """Effort, or words of a row without one."""
    D: np.ndarray
    """Columns (N, width)."""
    y: np.ndarray
    """Measured values (N,)."""
    scale: int | None = None
    """Index of its effort scale among the unknowns; None for a scale of 1."""
    offset: int | None = None
    """Index of its offset; None for none."""
    deviation: float = 1.0
    fixed: bool = False
    """True for a row that is known, whose deviation is not estimated."""

    def __post_init__(self) -> None:
        table = np.column_stack([self.D, np.ones(len(self.y)), self.y])
        self._table = scipy.linalg.qr(table, mode="r")[0][: table.shape[1]] if len(table) > table.shape[1] else table

    @property
    def size(self) -> float:
        """Typical size of a row: of its values, or of its terms where these are zero."""
        return float(np.sqrt(np.mean(self.y**2)) or 1.0)

    def residuals(self, p: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Predicted minus measured values (N,)."""
        return self._predicted(self.D, 1.0, p, x) - self.y

    def compressed(self, p: np.ndarray, columns: list[int], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals with the same sum of squares, and their derivatives by the unknowns, in standard deviations."""
        D, one, y = self._table[:, :-2], self._table[:, -2], self._table[:, -1]
        scale = 1.0 if self.scale is None else x[self.scale]
        r = self._predicted(D, one, p, x) - y
        J = np.zeros((len(D), len(x)))
        J[:, : len(columns)] = scale * D[:, columns]
        if self.scale is not None:
            J[:, self.scale] += D @ p
        if self.offset is not None:
            J[:, self.offset] += one
        return r / self.deviation, J / self.deviation

    def _predicted(self, D: np.ndarray, one: np.ndarray | float, p: np.ndarray, x: np.ndarray) -> np.ndarray:
        scale = 1.0 if self.scale is None else x[self.scale]
        return scale * (D @ p) + (0.0 if self.offset is None else x[self.offset] * one)


class InertialFit:
    """Unknowns x: parameters of bodies and of joints, which are columns of the rows, then effort scales and offsets.

    The cost is the sum of squares in standard deviations, and the weight times twice the divergence of each body from
    the file. It is convex if no effort scale is unknown. Friction and motor inertia stay positive, and effort scales
    keep their signs.

    Args:
        blocks: the rows.
        known: parameters (width,) of the file, of bodies with some thickness.
        columns: columns of the unknown parameters, ten for each body first.
        bodies: number of unknown bodies.
        rest: first values of the other unknowns: linear parameters, scales and offsets; a prior knows nothing of them.
        signs: their signs; 0 for one that may have both.
        prior: relative standard deviation of the second moments of mass; None without a prior.

    Attributes:
        x: the unknowns.
    """

    def __init__(
        self,
        blocks: list[MeasuredRow],
        known: np.ndarray,
        columns: list[int],
        bodies: int,
        rest: np.ndarray,
        signs: np.ndarray,
        prior: float | None,
    ) -> None:
        self.blocks, self.known, self.columns = blocks, known, columns
        self.x = self._start = np.concatenate([known[columns[: 10 * bodies]], rest])
        self._owned = [slice(10 * k, 10 * k + 10) for k in range(bodies)]
        self._priors = [InertiaPrior(self.x[own]) for own in self._owned]
        self._spread = np.concatenate([np.full(10 * bodies, np.inf), np.maximum(np.abs(rest), 1.0) * _LOOSE])
        self._signed = 10 * bodies + np.flatnonzero(signs)
        self._signs = signs[signs != 0]
        self._barrier = _BARRIER
        self._weight = _BARRIER if prior is None else 1 / prior**2

    def parameters(self, x: np.ndarray) -> np.ndarray:
        """All parameters (width,) at unknowns."""
        p = self.known.copy()
        p[self.columns] = x[: len(self.columns)]
        return p

    def solve(self) -> None:
        """Find the unknowns; standard deviations of the blocks follow their residuals."""
        for turn in range(_STAGES + _ROUNDS):
            p = self.parameters(self.x)
            for block in self.blocks:
                if not block.fixed:
                    size = max(block.size if block.y.any() else 0.0, float(np.abs(block.D * p).max(initial=0.0)))
                    r = block.residuals(p, self.x)
                    block.deviation = max(float(np.sqrt(np.mean(r**2))), _FLOOR * size, 1e-300)
            # Barriers from the start would let the first steps end at the border.
            self._barrier = _BARRIER ** min(turn / _STAGES, 1.0)
            self._minimize(max(self._weight, self._barrier))

    def _minimize(self, weight: float) -> None:
        """Newton's method with a line search among the inertias that bodies can have."""
        cost = self._cost(self.x, weight)
        for _ in range(_STEPS):
            r, J = self.terms(self.x, weight)
            size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
            step = -np.linalg.lstsq(J / size, r, rcond=1e-16)[0] / size
            slope, share = float(r @ (J @ step)), 1.0
            while share > 1e-12:
                other = self._cost(self.x + share * step, weight)
                if other <= cost + 1e-4 * share * slope:
                    break
                share /= 2
            else:
                return
            done = cost - other <= _SETTLED * cost
            self.x, cost = self.x + share * step, other
            if done:
                return

    def _cost(self, x: np.ndarray, weight: float) -> float:
        r, _ = self.data(x)
        divergence = sum(prior.divergence(x[own]) for prior, own in zip(self._priors, self._owned, strict=True))
        positive = x[self._signed] * self._signs
        if (positive <= 0).any():
            return np.inf
        pull = np.sum(((x - self._start) / self._spread) ** 2)
        return float(r @ r + pull) / 2 + weight * divergence - self._barrier * float(np.log(positive).sum())

    def terms(self, x: np.ndarray, weight: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and derivatives of rows, priors and first values: ``J^T r`` and ``J^T J`` are those of the cost."""
        root = np.sqrt(self._weight if weight is None else weight)
        r, J = self.data(x)
        parts, slopes = [r, (x - self._start) / self._spread], [J, np.diag(1 / self._spread)]
        for prior, own in zip(self._priors, self._owned, strict=True):
            values, rows = prior.rows(x[own])
            wide = np.zeros((10, len(x)))
            wide[:, own] = root * rows
            parts.append(root * values)
            slopes.append(wide)
        barrier = np.zeros((len(self._signed), len(x)))
        barrier[np.arange(len(self._signed)), self._signed] = np.sqrt(self._barrier) / x[self._signed]
        parts.append(np.full(len(self._signed), -np.sqrt(self._barrier)))
        return np.concatenate(parts), np.vstack([*slopes, barrier])

    def data(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of all blocks in standard deviations, and their derivatives."""
        p = self.parameters(x)
        found = [block.compressed(p, self.columns, x) for block in self.blocks]
        return np.concatenate([r for r, _ in found]), np.vstack([J for _, J in found])
