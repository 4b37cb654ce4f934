"""Riccati recursion of an unconstrained linear-quadratic problem, for one or many right-hand sides."""

from __future__ import annotations

import numpy as np
import scipy
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.array_shapes import Float
from rnc_pin.errors import SimulationError

_NOT_CONVEX = "the linear-quadratic subproblem is not convex"


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
        eye = np.eye(nz - nx)
        for k in range(N - 1, -1, -1):
            F = AB[k]
            M = H[k] + F.T @ (P @ F)
            factor, failed = scipy.linalg.lapack.dpotrf(M[nx:, nx:], lower=1)
            if failed:
                raise SimulationError(_NOT_CONVEX)
            inverse, _ = scipy.linalg.lapack.dpotrs(factor, eye, lower=1)
            cross = M[nx:, :nx]
            K = -inverse @ cross
            P = M[:nx, :nx] + cross.T @ K
            P = (P + P.T) / 2
            self._inverse[k], self.K[k], self.P[k] = inverse, K, P

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
