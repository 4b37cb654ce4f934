"""Eighth-order central differences on the configuration manifold, for derivatives without a closed form."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

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
    direction = x / length
    return length * central_difference(lambda s: field(pin.integrate(model, q, s * direction)), step)


def central_difference(field: Callable[[float], np.ndarray], step: float) -> np.ndarray:
    """Derivative of ``field(s)`` at zero."""
    terms = [weight * (field(k * step) - field(-k * step)) for k, weight in _STENCIL]
    return np.asarray(np.sum(terms, axis=0) / step)


def gradient(model: pin.Model, field: Field, q: np.ndarray, step: float = STEP) -> np.ndarray:
    """Derivatives (..., nv) of ``field(q)`` (...) along every tangent direction."""
    return np.stack([directional_derivative(model, field, q, x, step) for x in np.eye(model.nv)], axis=-1)


def gradient_with_error(model: pin.Model, field: Field, q: np.ndarray) -> tuple[np.ndarray, float]:
    """Gradient as in ``gradient``, and the largest difference between the results of two step lengths."""
    coarse, fine = (gradient(model, field, q, step) for step in (0.8 * STEP, 0.4 * STEP))
    return fine, float(np.abs(fine - coarse).max(initial=0.0))


def vector_gradient_with_error(field: Field, x: np.ndarray) -> tuple[np.ndarray, float]:
    """Derivatives (..., n) of ``field(x)`` at a vector x (n,), and their error as in ``gradient_with_error``."""

    def moved(unit: np.ndarray, by: float) -> np.ndarray:
        return field(x + by * unit)

    def at_step(step: float) -> np.ndarray:
        return np.stack([central_difference(partial(moved, unit), step) for unit in np.eye(len(x))], axis=-1)

    coarse, fine = at_step(0.8 * STEP), at_step(0.4 * STEP)
    return fine, float(np.abs(fine - coarse).max(initial=0.0))
