"""Pseudo-inertias of bodies: linear in the dynamic parameters, and positive definite for a body that can exist.

The prior is the entropic divergence ``tr(J J0^-1) - log det(J J0^-1) - 4``. It is convex, does not depend on axes and
units, and is infinite at the border of the inertias that a body can have. Lee, Wensing and Park, "Geometric robot
dynamic identification: a convex programming approach", IEEE T-RO 2020.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import scipy

_THICK = 1e-3  # smallest radius of gyration of a body, relative to its size


def _unit_pseudo_inertias() -> np.ndarray:
    """Pseudo-inertias (10, 4, 4) of unit dynamic parameters, in Pinocchio's order."""
    out = np.zeros((10, 4, 4))
    out[0, 3, 3] = 1.0
    for k in range(3):
        out[1 + k, k, 3] = out[1 + k, 3, k] = 1.0
    for column, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
        inertia = np.zeros((3, 3))
        inertia[i, j] = inertia[j, i] = 1.0
        out[4 + column, :3, :3] = np.trace(inertia) / 2 * np.eye(3) - inertia
    return out


_UNITS = _unit_pseudo_inertias()


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
