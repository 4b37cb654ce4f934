"""Numerical check of Lemma 1: worst residuals at sampled states."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.math.linear_algebra import unit_rows
from rnc_pin.model.reduced_model import ReducedModel

_STEP = 5e-4  # of the finite differences, along the direction of the velocity


def lemma_1_residuals(
    reduced: ReducedModel, configurations: np.ndarray, seed: int = 0, step: float = _STEP
) -> dict[str, float]:
    """Worst residuals at configurations (count, nq) with seeded random velocities.

    The residuals are: ``A R`` with unit rows and columns; ``H - H^T`` and ``Hdot - V - V^T`` relative to their size,
    with Hdot by fourth-order differences of this step; the smallest eigenvalue of H relative to its largest; and
    ``V(2 v2) - 2 V(v2)``.
    """
    count = len(configurations)
    v2 = np.random.default_rng(seed).uniform(-1, 1, (count, reduced.r))
    terms = reduced.terms(configurations, v2)
    speeds = np.linalg.norm(terms.v, axis=-1, keepdims=True)
    directions = terms.v / speeds
    far_behind, behind, ahead, far_ahead = (
        reduced.at(_moved(reduced, configurations, k * step * directions)).H for k in (-2, -1, 1, 2)
    )
    H_dot = (far_behind - 8 * behind + 8 * ahead - far_ahead) / (12 * step) * speeds[..., None]
    V = terms.V
    # With affine constraints V is affine in v2 instead of linear.
    resting = reduced.terms(configurations, 0 * v2).V
    doubled = reduced.terms(configurations, 2 * v2).V
    eigenvalues = np.linalg.eigvalsh(terms.H)
    size = np.abs(terms.H).max(axis=(1, 2)) * speeds[:, 0] + np.abs(V).max(axis=(1, 2))
    columns = terms.R / np.linalg.norm(terms.R, axis=-2, keepdims=True)
    return {
        "A R": _worst(np.abs(unit_rows(terms.A) @ columns)),
        "H - H^T": _worst(np.abs(terms.H - terms.H.mT).max(axis=(1, 2)) / np.abs(terms.H).max(axis=(1, 2))),
        "Hdot - V - V^T": _worst(np.abs(H_dot - V - V.mT).max(axis=(1, 2)) / size),
        "V linear": _worst(np.abs(doubled - 2 * V + resting).max(axis=(1, 2)) / size),
        "smallest eigenvalue of H": float((eigenvalues[:, 0] / eigenvalues[:, -1]).min()),
    }


def _moved(reduced: ReducedModel, configurations: np.ndarray, steps: np.ndarray) -> np.ndarray:
    model = reduced.robot.model
    return np.stack([pin.integrate(model, q, step) for q, step in zip(configurations, steps, strict=True)])


def _worst(array: np.ndarray) -> float:
    return float(array.max(initial=0.0))
