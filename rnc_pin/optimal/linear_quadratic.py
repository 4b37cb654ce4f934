"""Linear-quadratic subproblem of one iteration: its scales and its Riccati recursion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.array_shapes import Float
from rnc_pin.errors import SimulationError
from rnc_pin.model.cached_property import cached_property

_LEAST = 1e-12
NOT_CONVEX = "the linear-quadratic subproblem is not convex"


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
    def input_scales(self) -> Float[Array, " nu"]:
        """Scales of the inputs that give each a weight of about one.

        Weights that vanish get the mean of the others.
        """
        nx = self.A.shape[1]
        weights = np.einsum("nii->ni", self.H)[:, nx:].mean(axis=0)
        positive = weights[weights > _LEAST]
        usual = float(np.median(positive)) if len(positive) else 1.0
        return np.asarray(1.0 / np.sqrt(np.maximum(weights, 1e-6 * usual)))

    @cached_property
    def scales(self) -> Float[Array, " nz"]:
        """Scales of states, which are one, and of inputs."""
        return np.concatenate([np.ones(self.A.shape[1]), self.input_scales])

    @cached_property
    def scaled_dynamics(self) -> Float[Array, "N nx nz"]:
        """A and B, for scaled inputs."""
        return np.concatenate([self.A, self.B * self.input_scales], axis=2)

    def scaled_hessian(self, damping: float) -> Float[Array, "N nz nz"]:
        """H for scaled inputs, with an addition to their weights."""
        nx, nz = self.A.shape[1], len(self.scales)
        H = self.H * np.outer(self.scales, self.scales)
        H[:, range(nx, nz), range(nx, nz)] += damping
        return np.asarray(H)

    @cached_property
    def typical_sizes(self) -> tuple[Float[Array, "N1 k"], Float[Array, "N1 nx"]]:
        """Typical sizes of the rows of each stage, and of the states.

        They are standard deviations under random inputs of the size of their scales, independent from stage to stage.
        """
        rows, states = (np.sqrt(np.maximum(each, 0.0)) for each in self._variances())  # rounding may go below zero
        return np.maximum(rows, max(1e-4 * float(rows.max(initial=0.0)), _LEAST)), states

    def _variances(self) -> tuple[Float[Array, "N1 k"], Float[Array, "N1 nx"]]:
        """Squares of the typical sizes."""
        AB, scales, (N, nx, nu), k = self.scaled_dynamics, self.input_scales, self.B.shape, self.C.shape[1]
        rows, states = np.empty((N + 1, k)), np.empty((N + 1, nx))
        given = np.ascontiguousarray(self.C), np.ascontiguousarray(self.D)
        if _kernel.library.variances(N, nx, nx + nu, k, AB, *given, scales, rows, states):
            return rows, states
        noise = AB[:, :, nx:]
        P = np.concatenate([np.zeros_like(self.A[:1]), noise @ noise.mT])
        for before, A, after in zip(P, self.A, P[1:], strict=False):
            after += A @ before @ A.T
        square = ((self.C @ P) * self.C).sum(axis=2)
        square[:-1] += ((self.D[:-1] * scales) ** 2).sum(axis=2)
        return square, np.einsum("nii->ni", P)


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
            self._inverse[k], _ = scipy.linalg.lapack.dpotrs(factor, np.eye(nz - nx), lower=1)
            self.K[k] = -self._inverse[k] @ M[:, :nx]
            loop = np.concatenate([np.eye(nx), self.K[k]])
            closed = F @ loop
            P = loop.T @ H[k] @ loop + closed.T @ P @ closed  # Joseph's form: positive where weights are stiff
            self.P[k] = P = (P + P.T) / 2

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
