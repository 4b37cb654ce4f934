"""Linear-quadratic subproblem of one iteration, its scales and its solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.model.cached_property import cached_property

_LEAST = 1e-12


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
