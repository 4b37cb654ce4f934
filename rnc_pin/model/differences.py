"""Eighth-order central differences on the configuration manifold, for derivatives without a closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

STEP = 0.01
_STENCIL = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))

Field = Callable[[np.ndarray], np.ndarray]


def directional_derivative(
    model: pin.Model, field: Field, q: np.ndarray, x: np.ndarray, step: float = STEP
) -> np.ndarray:
    """Derivative of ``field(q)`` along a tangent vector x (nv,)."""
    length = np.linalg.norm(x)
    if length == 0:
        return np.zeros_like(field(q))
    direction, terms = x / length, []
    for k, weight in _STENCIL:
        ahead, behind = (field(pin.integrate(model, q, sign * k * step * direction)) for sign in (1, -1))
        terms.append(weight * (ahead - behind))
    return np.asarray(np.sum(terms, axis=0) * (length / step))


def gradient(model: pin.Model, field: Field, q: np.ndarray, step: float = STEP) -> np.ndarray:
    """Derivatives (..., nv) of ``field(q)`` (...) along every tangent direction."""
    return np.stack([directional_derivative(model, field, q, x, step) for x in np.eye(model.nv)], axis=-1)


def gradient_with_error(model: pin.Model, field: Field, q: np.ndarray) -> tuple[np.ndarray, float]:
    """Gradient as in ``gradient``, and the largest difference between the results of two step lengths."""
    coarse, fine = (gradient(model, field, q, step) for step in (0.8 * STEP, 0.4 * STEP))
    return fine, float(np.abs(fine - coarse).max(initial=0.0))
