"""The reduction: ``F = H v2dot + V v2 + G`` for any system. Paper (2)-(3), (6)-(7).

With the square stack ``E = [A; J2]`` of constraint rows and reducing outputs,

    R = E^-1 [0; I],   Rdot = -E^-1 Edot R,
    H = R^T H* R,   V = R^T (H* Rdot + C* R),   G = R^T g*.

Affine constraints ``A v = mu(q)``, such as a momentum that is not zero, add a given motion,

    v = R v2 + b,   b = E^-1 [mu; 0],   bdot = E^-1 ([mudot; 0] - Edot b),   G = R^T (g* + H* bdot + C* b).

Everything is written over leading batch axes: Pinocchio runs in a loop, the algebra is stacked, and
one state is the same code without the axis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import (
    apply,
    apply_transposed,
    congruence,
    inverse,
    product,
    solve_positive_definite,
)
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.stack import ArrayInput, Stack
from rnc_pin.model.terms import Flow, LagrangianTerms, ReducedTerms


class ReducedModel(Stack):
    """A nonholonomic system in the velocities ``v2`` of its reducing outputs.

    Made by ``NonholonomicSystem.reduce``. All methods take leading batch axes: q (..., nq), v2 (..., r).
    It owns one Pinocchio workspace, so an instance serves one thread at a time.

    Attributes:
        r, m, p, n: reducing outputs, constraint rows, actuators, degrees of freedom.
        reducing, vertical: the outputs x2 and x1.
        constraints: the independent rows of A; ``dropped_rows``: the others, with reasons.
        affine: whether constraints are ``A v = mu`` with mu not zero, so that ``v = R v2 + b``.

    Raises (every method):
        InputError: an array has the wrong shape or is not finite.
        SingularityError: the outputs do not parametrise the motion at q.
    """

    # ------------------------------------------------------------------ dynamics

    def forward_dynamics(self, q: ArrayInput, v2: ArrayInput, T: ArrayInput) -> Float[Array, "*batch r"]:
        """Accelerations ``v2_dot`` under actuator inputs T [N or N m]."""
        v2, T = self._shaped(v2, self.r, "v2"), self._shaped(T, self.p, "T")
        return self._accelerate(self._admit(q, v2), v2, T, None)[0]

    def flow(self, q: ArrayInput, v2: ArrayInput, T: ArrayInput, damping: Array | None = None) -> Flow:
        """What an integrator needs: full velocity, reduced acceleration and power, from one factorisation.

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r).
            T: actuator inputs (..., p).
            damping: viscous coefficients (nv,) [N m s/rad or N s/m].
        """
        v2, T = self._shaped(v2, self.r, "v2"), self._shaped(T, self.p, "T")
        q = self._admit(q, v2)
        v2_dot, v, force = self._accelerate(q, v2, T, damping)
        power = np.vecdot(v, force)
        if self.affine:  # constraints that move do work
            E_inverse, M, _ = self.stack(q)
            power = power - np.vecdot(self._mu(q), self._multipliers(q, v2, E_inverse, M, force))
        return Flow(v, v2_dot, power)

    def _accelerate(self, q: Array, v2: Array, T: Array, damping: Array | None) -> tuple[Array, Array, Array]:
        """v2dot, v and the generalized force: one factorisation of E, no Coriolis matrix."""
        E_inverse, M, B = self.stack(q)
        R = E_inverse[self._basis]
        v = apply(R, v2)
        if self.affine:
            v = v + self._offset(q, E_inverse)
        gamma, bias = self._drift(q, v)
        force = apply(B, T)
        if damping is not None:
            force = force - damping * v
        MR = product(M, R)
        # With vdot = R v2dot - E^-1 gamma:  H v2dot = R^T (force - bias) + (M R)^T E^-1 gamma.
        right = apply_transposed(R, force - bias) + apply_transposed(MR, apply(E_inverse, gamma))
        v2_dot = solve_positive_definite(product(R.mT, MR), right)
        if not np.vdot(v2_dot, v2_dot) < np.inf:
            self._explain_not_finite(q, v2=v2, T=T)
        return v2_dot, v, force

    def inverse_dynamics(self, q: ArrayInput, v2: ArrayInput, v2_dot: ArrayInput) -> Float[Array, "*batch r"]:
        """Reduced forces ``F = H v2dot + V v2 + G``."""
        v2, v2_dot = self._shaped(v2, self.r, "v2"), self._shaped(v2_dot, self.r, "v2_dot")
        q = self._admit(q, v2)
        E_inverse, M, _ = self.stack(q)
        R = E_inverse[self._basis]
        v = self._velocity(q, E_inverse, v2)
        gamma, bias = self._drift(q, v)
        acceleration = apply(R, v2_dot) - apply(E_inverse, gamma)
        return apply_transposed(R, apply(M, acceleration) + bias)

    def input_matrix(self, q: ArrayInput) -> Float[Array, "*batch r p"]:
        """``R^T B``: reduced force for unit actuator inputs."""
        E_inverse, _, B = self.stack(self._admit(q))
        return E_inverse[self._basis].mT @ B

    def drive_jacobian(self, q: ArrayInput) -> Float[Array, "*batch r p"]:
        """``J2 B``: rate of the reducing outputs while each actuator moves alone, constraints apart."""
        E, _, B = self._position(self._admit(q))
        return E[..., self.m :, :] @ B

    def allocate(self, q: ArrayInput, F: ArrayInput) -> Float[Array, "*batch p"]:
        """Actuator inputs T with ``R^T B T = F``; the smallest where there are several.

        Raises:
            ConstraintError: the actuators cannot produce every F (rank of ``R^T B`` below r).
        """
        F = self._shaped(F, self.r, "F")
        matrix = self.input_matrix(q)
        if self.p == self.r:
            T = apply(inverse(matrix), F)
            if np.isfinite(T).all() and np.abs(apply(matrix, T) - F).max() <= 1e-8 * (1 + np.abs(F).max()):
                return T
        rank = np.min(np.linalg.matrix_rank(matrix, rtol=1e-10)) if self.p else 0
        if rank < self.r:
            raise ConstraintError(
                f"actuators {', '.join(self.actuation.names) or '(none)'} reach rank {rank} of the {self.r} "
                "reduced forces: not every F can be realised"
            )
        return apply(np.linalg.pinv(matrix), F)

    def multipliers(self, q: ArrayInput, v2: ArrayInput, T: ArrayInput) -> Float[Array, "*batch m"]:
        """Constraint multipliers lambda, in ``B T = H* vdot + C* v + g* + A^T lambda``."""
        v2, T = self._shaped(v2, self.r, "v2"), self._shaped(T, self.p, "T")
        q = self._admit(q, v2)
        E_inverse, M, B = self.stack(q)
        return self._multipliers(q, v2, E_inverse, M, apply(B, T))

    def _multipliers(self, q: Array, v2: Array, E_inverse: Array, M: Array, force: Array) -> Array:
        R = E_inverse[self._basis]
        v = self._velocity(q, E_inverse, v2)
        gamma, bias = self._drift(q, v)
        free = force - bias + apply(M, apply(E_inverse, gamma))
        v2_dot = solve_positive_definite(congruence(R, M), apply_transposed(R, free))
        residual = free - apply(M, apply(R, v2_dot))
        # A^T lambda + J2^T 0 = residual, that is E^T [lambda; 0] = residual.
        return apply_transposed(E_inverse[..., : self.m], residual)

    def energy(self, q: ArrayInput, v2: ArrayInput) -> Float[Array, "*batch"] | float:
        """Kinetic plus potential energy [J]."""
        v2 = self._shaped(v2, self.r, "v2")
        q = self._admit(q, v2)
        v = self._velocity(q, self.stack(q)[0], v2)
        model, data = self._state.model, self._state.data

        def one(q_i: Array, v_i: Array) -> float:
            return pin.computeKineticEnergy(model, data, q_i, v_i) + pin.computePotentialEnergy(model, data, q_i)

        if q.ndim == 1:
            return one(q, v)
        flat = zip(q.reshape(-1, self._nq), v.reshape(-1, self.n), strict=True)
        return np.array([one(q_i, v_i) for q_i, v_i in flat]).reshape(q.shape[:-1])

    # ------------------------------------------------------------------ matrices

    def inertia(self, q: ArrayInput) -> Float[Array, "*batch r r"]:
        """Reduced inertia matrix H alone."""
        E_inverse, M, _ = self.stack(self._admit(q))
        return congruence(E_inverse[self._basis], M)

    def terms(self, q: ArrayInput, v2: ArrayInput) -> ReducedTerms:
        """All matrices of the reduced system at (q, v2)."""
        v2 = self._shaped(v2, self.r, "v2")
        q = self._admit(q, v2)
        E_inverse, M, B = self.stack(q)
        R = E_inverse[self._basis]
        b = self._offset(q, E_inverse)
        v = apply(R, v2) + b
        E_dot, C, g, A, J1, J1_dot = self._rates(q, v)
        R_dot = -E_inverse @ (E_dot @ R)
        b_dot = self._offset_rate(q, v, E_inverse, E_dot, b)
        if self.affine:
            g = g + apply(M, b_dot) + apply(C, b)
        return ReducedTerms(
            R=R.copy(),
            R_dot=R_dot,
            H=congruence(R, M),
            V=R.mT @ (M @ R_dot + C @ R),
            G=apply_transposed(R, g),
            input_matrix=R.mT @ B,
            A=A,
            A_dot=E_dot[..., : self.m, :],
            A_star=J1 @ R,
            A_star_dot=J1_dot @ R + J1 @ R_dot,
            v=v,
            b=b,
            b_dot=b_dot,
        )

    def lagrangian_terms(self, q: ArrayInput, v2: ArrayInput) -> LagrangianTerms:
        """H*, C*, g* and B of the unreduced system (1), C* at ``v = R v2 + b``."""
        v2 = self._shaped(v2, self.r, "v2")
        q = self._admit(q, v2)
        E_inverse, M, B = self.stack(q)
        _, C, g, *_ = self._rates(q, self._velocity(q, E_inverse, v2))
        return LagrangianTerms(H=np.array(M), C=C, g=g, B=np.array(B))

    def basis_rate(self, q: ArrayInput, along: ArrayInput) -> tuple[Array, Array]:
        """R (nv, r) and its derivatives (..., nv, r) along tangent vectors (..., nv), at one configuration."""
        E_inverse, _, _ = self.stack(self._admit(q))
        return self._basis_rate(q, E_inverse, np.asarray(along, dtype=float))

    def basis_rate_in_motion(self, q: ArrayInput, v2: ArrayInput) -> tuple[Array, Array]:
        """R (nv, r) and its derivatives (..., nv, r) along the motions ``R v2``, v2 (..., r), at one configuration."""
        E_inverse, _, _ = self.stack(self._admit(q))
        return self._basis_rate(q, E_inverse, np.asarray(v2, dtype=float) @ E_inverse[self._basis].T)

    def _basis_rate(self, q: ArrayInput, E_inverse: Array, along: Array) -> tuple[Array, Array]:
        R = E_inverse[self._basis].copy()
        E_dot = np.empty((*along.shape, self.n))
        for v_i, E_i in zip(along.reshape(-1, self.n), E_dot.reshape(-1, self.n, self.n), strict=True):
            self._state.set_rates(q, v_i)
            self._rows.jacobian_dot(self._state, E_i)
        return R, -E_inverse @ (E_dot @ R)

    def measure(self, q: ArrayInput, v2: ArrayInput, integrals: Array | None = None) -> Measurement:
        """What controllers may see at a state: outputs, rates and the kinematics between them, no inertia.

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r).
            integrals: integrals of v2 over time (..., r), which stand for the values of quasi-velocity
                outputs; zeros by default.
        """
        v2 = self._shaped(v2, self.r, "v2")
        q = self._admit(q, v2)
        E_inverse, _, _ = self.stack(q)
        R = E_inverse[self._basis]
        v = self._velocity(q, E_inverse, v2)
        E_dot, _, _, _, J1, J1_dot = self._rates(q, v)
        R_dot = -E_inverse @ (E_dot @ R)
        A_star = J1 @ R
        v1 = apply(A_star, v2)
        offset = offset_dot = None
        if self.affine:
            b = self._offset(q, E_inverse)
            offset = apply(J1, b)
            offset_dot = apply(J1_dot, b) + apply(J1, self._offset_rate(q, v, E_inverse, E_dot, b))
            v1 = v1 + offset
        x1, x2 = self.outputs(q, integrals)
        return Measurement(
            q=q,
            v=v,
            v2=v2,
            x1=x1,
            x2=x2,
            v1=v1,
            A_star=A_star,
            A_star_dot=J1_dot @ R + J1 @ R_dot,
            v1_offset=offset,
            v1_offset_dot=offset_dot,
        )

    def kinematic_gradient(self, q: ArrayInput, along: Sequence[int] | Array) -> Float[Array, "*batch k r s"]:
        """Derivatives of ``A_star`` along the motion of single reducing outputs: how A_star depends on them.

        Args:
            q: configurations (..., nq).
            along: positions in x2, (s,).
        """
        q = np.asarray(q, float)
        each = self.measure(*self._alone(q, along))
        gradient = each.A_star_dot
        if self.affine:  # along the given motion b it changes as well
            gradient = gradient - self.measure(q, np.zeros((*q.shape[:-1], self.r))).A_star_dot[..., None, :, :]
        return np.moveaxis(gradient, -3, -1)

    def log_determinant_gradient(self, q: ArrayInput, along: Sequence[int] | Array) -> Float[Array, "*batch s"]:
        """Derivatives of ``log |det E|``, that is ``tr(E^-1 Edot)``, along the motion of single reducing outputs.

        Args:
            q: configurations (..., nq).
            along: positions in x2, (s,).
        """
        q, v2 = self._alone(q, along)
        E_inverse, _, _ = self.stack(self._admit(q))
        E_dot = self._rates(q, apply(E_inverse[self._basis], v2))[0]
        return np.einsum("...ij,...ji->...", E_inverse, E_dot)

    def _alone(self, q: ArrayInput, along: Sequence[int] | Array) -> tuple[Array, Array]:
        """Every configuration once for each of some outputs (..., s, nq), moving alone at unit rate (..., s, r)."""
        q = np.asarray(q, float)
        directions = np.eye(self.r)[list(along)]
        spread = np.broadcast_to(q[..., None, :], (*q.shape[:-1], len(directions), self._nq))
        return np.ascontiguousarray(spread), np.broadcast_to(directions, (*spread.shape[:-1], self.r))

    def outputs(self, q: ArrayInput, integrals: Array | None = None) -> tuple[Array, Array]:
        """Values x1 (..., k) and x2 (..., r) of the vertical and reducing outputs."""
        q = self._admit(q)
        x1, x2 = np.empty((*q.shape[:-1], self.vertical.size)), np.empty((*q.shape[:-1], self.r))
        state = self._state
        for q_i, x1_i, x2_i in self._states(q, x1, x2):
            state.set_position(q_i)
            self.vertical.value(state, x1_i)
            self.reducing.value(state, x2_i)
        if integrals is not None:
            x2[..., self.reducing.quasi] = integrals[..., self.reducing.quasi]
        return x1, x2

    def constraint_residual(self, q: ArrayInput, v: ArrayInput) -> Array:
        """``A v - mu``, (..., m)."""
        A = np.empty((*q.shape[:-1], self.m, self.n))
        for q_i, A_i in self._states(q, A):
            self._state.set_position(q_i)
            A_i[...] = self.constraints.evaluate(self._state)
        return apply(A, v) - self._mu(q)

    # ------------------------------------------------------------------ velocities and configurations that comply

    def velocity(self, q: ArrayInput, v2: ArrayInput) -> Float[Array, "*batch nv"]:
        """Full velocity ``v = R v2 + b``."""
        v2 = self._shaped(v2, self.r, "v2")
        q = self._admit(q, v2)
        return self._velocity(q, self.stack(q)[0], v2)

    def position_residual(self, q: ArrayInput) -> Float[Array, "*batch h"]:
        """How far configurations (..., nq) are from satisfying the holonomic rows, ``assembly.names`` [m or rad]."""
        q = self._admit(q)
        out = np.empty((*q.shape[:-1], self.assembly.size))
        for q_i, out_i in self._states(q, out):
            out_i[...] = self.assembly.residual(q_i)
        return out

    def assembled(self, q: ArrayInput, hold: Sequence[str] = ()) -> Float[Array, " nq"]:
        """The configuration near q (nq,) that satisfies the holonomic rows: loops closed, wheels on the ground.

        Args:
            q: one configuration (nq,).
            hold: joints that stay where they are.

        Raises:
            ConstraintError: none was found.
        """
        return self.assembly.project(self._admit(q), hold)

    def random_configuration(self, generator: np.random.Generator, spread: float = np.pi) -> Float[Array, " nq"]:
        """``Robot.random_configuration``, assembled."""
        return self.assembly.random_configuration(generator, spread)

    def _velocity(self, q: Array, E_inverse: Array, v2: Array) -> Array:
        v = apply(E_inverse[self._basis], v2)
        return v + self._offset(q, E_inverse) if self.affine else v

    def _offset(self, q: Array, E_inverse: Array) -> Array:
        """b, (..., nv)."""
        if not self.affine:
            return np.zeros((*q.shape[:-1], self.n))
        return apply(E_inverse[..., : self.m], self._mu(q))

    def _offset_rate(self, q: Array, v: Array, E_inverse: Array, E_dot: Array, b: Array) -> Array:
        if not self.affine:
            return np.zeros_like(b)
        mu_dot = np.empty((*q.shape[:-1], self.m))
        for q_i, v_i, mu_i in self._states(q, v, mu_dot):
            if q.ndim > 1:  # a single state is the one that the workspace is at
                self._state.set_rates(q_i, v_i)
            self.constraints.rate_dot(self._state, mu_i)
        return apply(E_inverse[..., : self.m], mu_dot) - apply(E_inverse, apply(E_dot, b))

    def _mu(self, q: Array) -> Array:
        """What ``A v`` has to be, (..., m), where the workspace is at q if that is a single state."""
        mu = np.zeros((*q.shape[:-1], self.m))
        if self.affine:
            for q_i, mu_i in self._states(q, mu):
                if q.ndim > 1:  # a single state is the one that the workspace is at
                    self._state.set_position(q_i)
                self.constraints.rate(self._state, mu_i)
        return mu
