"""One evaluation of a reduced model at states: each quantity is computed on first use, once, and kept.

With the square stack ``E = [A; J2]`` of constraint rows and reducing outputs,

    R = E^-1 [0; I],   Rdot = -E^-1 Edot R,
    H = R^T H* R,   V = R^T (H* Rdot + C* R),   G = R^T g*.

Affine constraints ``A v = mu(q)``, such as a momentum that is not zero, add a given motion,

    v = R v2 + b,   b = E^-1 [mu; 0],   bdot = E^-1 ([mudot; 0] - Edot b),   G = R^T (g* + H* bdot + C* b).

Paper (2)-(3), (6)-(7). Everything is written over leading axes.
"""

from __future__ import annotations

from math import isfinite

import numpy as np
import scipy.linalg
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.errors import ConstraintError, DivergenceError, InputError, SingularityError
from rnc_pin.math.linear_algebra import (
    apply,
    apply_transposed,
    inverse,
    product,
    solve_positive_definite,
)
from rnc_pin.model.admission import ArrayInput, vector
from rnc_pin.model.kinematics import Motion, Position, Rates
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.once import once
from rnc_pin.model.parts import Parts, best_entries
from rnc_pin.model.terms import Flow, ReducedTerms

_OF_Q = ("position", "_values", "B", "all_rows", "_settled", "_kept", "E_inverse", "J1", "R", "A_star", "H", "mu", "b")
_DEPENDENT = 1e-8  # sine of the angle below which constraint rows count as dependent
_AMPLIFIED = 1e10  # times its rounding that inputs may change a force by, before actuators count as dependent
_WELL = 1e-3  # smallest singular value of rows of natural length above which the default ones stay


class Evaluation:
    """A state, or states with leading axes (...,), and whatever a reduced model says there.

    ``ReducedModel.at`` makes one. It is a value: it stays what it is when the model is evaluated elsewhere. Where the
    constraint rows that are kept by default become dependent although others would not, other rows are chosen; R does
    not depend on that choice.

    Args:
        parts: of the model.
        q: admitted configurations (..., nq).
        v2: admitted reduced velocities (..., r).
        v: instead, admitted full velocities as they were measured, (..., nv).

    Raises (whatever needs R):
        SingularityError: the outputs do not parametrise the motion at q.
        InputError: a velocity is needed, and none was given.
    """

    _kept: Array | None = None  # (..., m) where other rows than the default ones were chosen

    def __init__(self, parts: Parts, q: Array, v2: Array | None = None, v: Array | None = None) -> None:
        self._parts = parts
        self.q: Array = q
        known = self.__dict__
        if v2 is not None:
            known["v2"] = v2
        if v is not None:
            known["v"] = v

    def as_seen_by(self, parts: Parts) -> Evaluation:
        """The same states in another reduction of the same system; what Pinocchio has said goes over."""
        other = Evaluation(parts, self.q, v=self.v)
        for name in ("position", "motion"):
            if name in self.__dict__:
                other.__dict__[name] = self.__dict__[name]
        return other

    def moving(self, v: Array) -> Evaluation:
        """The same configurations with other full velocities (..., nv); what depends on q alone goes over."""
        other = Evaluation(self._parts, self.q, v=v)
        other.__dict__.update({name: self.__dict__[name] for name in _OF_Q if name in self.__dict__})
        return other

    # ------------------------------------------------------------------ configurations

    @once
    def position(self) -> Position:
        """What Pinocchio says of q."""
        return self._parts.kinematics.position(self.q)

    @property
    def M(self) -> Float[Array, "*batch nv nv"]:
        """Inertia matrix H* before reduction."""
        return self.position.M

    @once
    def B(self) -> Float[Array, "*batch nv p"]:
        """Actuation matrix: generalized force ``B T``."""
        return self._parts.actuation.matrix(self.position)

    @once
    def all_rows(self) -> Float[Array, "*batch k nv"]:
        """All constraint rows, dropped ones included."""
        return self._parts.rows.jacobian(self.position)

    @once
    def _settled(self) -> tuple[Array, Array, Array | bool]:
        """E and its inverse, and where E is regular; with other rows where the default ones are dependent."""
        parts, position = self._parts, self.position
        if self.q.ndim == 1:
            E = parts.template.copy("F")
        else:
            E = np.array(np.broadcast_to(parts.template, (*self.q.shape[:-1], parts.n, parts.n)))
        parts.stack.write_jacobian(position, E)
        E_inverse = inverse(E)
        if E.ndim == 2:
            # The product of Frobenius norms bounds what any row's dependence can be: one cheap test on the hot path.
            rows, columns = E.ravel("K"), E_inverse.ravel("K")
            if (float(rows.dot(rows)) + parts.quick_length) * float(columns.dot(columns)) < parts.quick_limit:
                self.__dict__["E_inverse"], self.__dict__["R"] = E_inverse, E_inverse[parts.basis]
                return E, E_inverse, True
        with np.errstate(invalid="ignore", over="ignore"):
            worst = self._dependences(E, E_inverse).max(axis=-1)
            if parts.has_others:
                doubtful = ~(worst**2 < parts.quick_limit)
                for i in np.argwhere(doubtful):
                    self._choose_again(tuple(i), E, E_inverse)
                worst = self._dependences(E, E_inverse).max(axis=-1)
        return E, E_inverse, worst < parts.singularity_limit

    def _dependences(self, E: Array, E_inverse: Array) -> Array:
        """How nearly each row depends on the others, (..., n): one over the sine of its angle to them.

        A row that vanishes depends on all of them, so it counts for what it is long elsewhere.
        """
        rows = np.linalg.norm(E, axis=-1)
        columns = np.linalg.norm(E_inverse, axis=-2)
        return np.fmax(rows, self._lengths) * columns

    @property
    def _lengths(self) -> Array:
        parts = self._parts
        if self._kept is None:
            return parts.lengths
        outputs = np.broadcast_to(parts.lengths_of_outputs, (*self.q.shape[:-1], parts.r))
        return np.concatenate([parts.lengths_of_rows[self._kept], outputs], axis=-1)

    def _choose_again(self, i: tuple[int, ...], E: Array, E_inverse: Array) -> None:
        """Put the best rows into E (..., n, n) and its inverse at one state."""
        parts = self._parts
        rows = self.all_rows[i]
        if not np.isfinite(rows).all():
            return
        natural = np.fmax(np.linalg.norm(rows, axis=-1), parts.lengths_of_rows)
        natural = np.where(parts.lengths_of_rows > 0, natural, np.inf)[:, None]  # what is zero elsewhere is rounding
        _, triangle, order = scipy.linalg.qr((rows / natural).T, mode="economic", pivoting=True)
        if parts.m and not abs(triangle[parts.m - 1, parts.m - 1]) > _DEPENDENT:
            return  # the constraints themselves lose rank
        kept = np.array(parts.kept, dtype=int)
        if np.linalg.svd((rows / natural)[kept], compute_uv=False).min(initial=1.0) < _WELL:
            kept = np.sort(order[: parts.m])
        chosen = rows[kept]
        outputs = E[i][parts.m :]
        if parts.free:
            outputs = np.eye(parts.n)[best_entries(chosen, parts.r)]
        if self._kept is None:
            self._kept = np.array(np.broadcast_to(np.array(parts.kept, dtype=int), (*self.q.shape[:-1], parts.m)))
        self._kept[i] = kept
        E[i] = np.vstack([chosen, outputs])
        E_inverse[i] = inverse(np.asfortranarray(E[i]))

    @property
    def E(self) -> Float[Array, "*batch nv nv"]:
        """``[A; J2]``, constraint rows above reducing outputs; raises at no singular configuration."""
        return self._settled[0]

    @once
    def E_inverse(self) -> Float[Array, "*batch nv nv"]:
        """``E^-1``: multiplier columns beside R."""
        _, E_inverse, regular = self._settled
        if regular is not True and not np.all(regular):
            raise self._singularity(np.asarray(regular))
        return E_inverse

    @property
    def kept(self) -> Array:
        """Which of all constraint rows are in A, (m,), or (..., m) where that differs from the default."""
        _ = self._settled
        return np.array(self._parts.kept, dtype=int) if self._kept is None else self._kept

    @property
    def _by_default(self) -> bool:
        """Whether the default rows are in A at every state."""
        _ = self._settled
        return self._kept is None

    @property
    def _broad_kept(self) -> Array:
        return np.broadcast_to(self.kept, (*self.q.shape[:-1], self._parts.m))

    @property
    def A(self) -> Float[Array, "*batch m nv"]:
        """Independent constraint rows."""
        return self.E[..., : self._parts.m, :]

    @property
    def J2(self) -> Float[Array, "*batch r nv"]:
        """Jacobian of the reducing outputs: ``v2 = J2 v``."""
        return self.E[..., self._parts.m :, :]

    @once
    def J1(self) -> Float[Array, "*batch k nv"]:
        """Jacobian of the vertical outputs."""
        return self._parts.vertical.jacobian(self.position)

    @once
    def R(self) -> Float[Array, "*batch nv r"]:
        """Null-space basis, ``v = R v2 + b``."""
        return self.E_inverse[self._parts.basis]

    @once
    def A_star(self) -> Float[Array, "*batch k r"]:
        """Kinematics of the vertical outputs, ``x1dot = A_star v2 + J1 b``."""
        return self.J1 @ self.R

    @once
    def input_matrix(self) -> Float[Array, "*batch r p"]:
        """``R^T B``: reduced force for unit actuator inputs."""
        return product(self.R.mT, self.B)

    @once
    def H(self) -> Float[Array, "*batch r r"]:
        """Reduced inertia matrix."""
        R = self.R
        return product(R.mT, product(self.position.M, R))

    @once
    def mu(self) -> Float[Array, "*batch m"]:
        """What ``A v`` has to be."""
        parts = self._parts
        if self._by_default:
            return parts.constraints.rate(self.position)
        return np.take_along_axis(parts.rows.rate(self.position), self._broad_kept, axis=-1)

    @once
    def b(self) -> Float[Array, "*batch nv"]:
        """Velocity at ``v2 = 0``: zero unless constraints are affine."""
        if not self._parts.affine:
            return np.zeros((*self.q.shape[:-1], self._parts.n))
        return apply(self.E_inverse[self._parts.multiplied], self.mu)

    @property
    def regular(self) -> Array:
        """Whether the outputs parametrise the motion, (...,)."""
        return np.asarray(self._settled[2])

    def scaled_stack(self) -> Array:
        """E (..., n, n) with unit rows; a row that is shorter than elsewhere stays so much shorter."""
        lengths = np.fmax(np.linalg.norm(self.E, axis=-1), self._lengths)
        return self.E / np.where(lengths > 0, lengths, 1.0)[..., None]

    @once
    def _singular_values(self) -> Array:
        return np.linalg.svd(self.scaled_stack(), compute_uv=False)

    @property
    def condition(self) -> Array | float:
        """Condition number (...) of E: how well x2 parametrises the motion. Raises at no singular configuration."""
        values = self._singular_values
        with np.errstate(divide="ignore"):
            return values[..., 0] / values[..., -1]

    @property
    def smallest_singular_value(self) -> Array | float:
        """Smallest singular value (...) of E; zero at a singular configuration."""
        return self._singular_values[..., -1]

    def outputs(self, integrals: ArrayInput | None = None) -> tuple[Array, Array]:
        """Values x1 (..., k) and x2 (..., r); of quasi-velocities the integrals that are given, else zero."""
        x1, x2 = self._values
        quasi = self._parts.reducing.quasi
        if integrals is not None and quasi.any():
            x2 = x2.copy()
            x2[..., quasi] = vector(integrals, self._parts.r, "integrals")[..., quasi]
        return x1, x2

    @once
    def _values(self) -> tuple[Array, Array]:
        return self._parts.vertical.value(self.position), self._parts.reducing.value(self.position)

    # ------------------------------------------------------------------ velocities

    @once
    def v2(self) -> Float[Array, "*batch r"]:
        """Rates of the reducing outputs."""
        if "v" not in self.__dict__:
            raise InputError("a velocity is needed: give v2, or v as it was measured")
        return apply(self.J2, self.v)

    @once
    def v(self) -> Float[Array, "*batch nv"]:
        """Full velocity: ``R v2 + b``, or what was measured."""
        return self.velocity(self.v2)

    def velocity(self, v2: Array) -> Float[Array, "*batch nv"]:
        """Full velocity ``R v2 + b`` of other reduced velocities (..., r)."""
        v = apply(self.R, v2)
        return v + self.b if self._parts.affine else v

    @once
    def motion(self) -> Motion:
        """What Pinocchio says of q and v."""
        return self.position.moving(self.v)

    @property
    def gamma(self) -> Float[Array, "*batch nv"]:
        """``Edot v - [mudot; 0]``: accelerations of constraint rows and reducing outputs at zero ``vdot``."""
        parts = self._parts
        if self._by_default:
            return parts.stack.drift(self.motion)
        chosen = np.take_along_axis(parts.rows.drift(self.motion), self._broad_kept, axis=-1)
        return np.concatenate([chosen, parts.reducing.drift(self.motion)], axis=-1)

    @once
    def residual(self) -> Float[Array, "*batch m"]:
        """``A v - mu``: by how much the velocity violates the constraints."""
        residual = apply(self.A, self.v)
        return residual - self.mu if self._parts.affine else residual

    @once
    def v1(self) -> Float[Array, "*batch k"]:
        """Rates of the vertical outputs, ``J1 v``."""
        return apply(self.J1, self.v)

    @once
    def rates(self) -> Rates:
        """What Pinocchio says of rates along v."""
        return self.motion.rates()

    @once
    def E_dot(self) -> Float[Array, "*batch nv nv"]:
        """Rate of E."""
        parts = self._parts
        if self._by_default:
            return parts.stack.jacobian_dot(self.rates)
        chosen = np.take_along_axis(parts.rows.jacobian_dot(self.rates), self._broad_kept[..., None], axis=-2)
        return np.concatenate([chosen, parts.reducing.jacobian_dot(self.rates)], axis=-2)

    @property
    def A_dot(self) -> Float[Array, "*batch m nv"]:
        """Rate of A."""
        return self.E_dot[..., : self._parts.m, :]

    @once
    def R_dot(self) -> Float[Array, "*batch nv r"]:
        """Rate of R."""
        return -product(self.E_inverse, product(self.E_dot, self.R))

    @once
    def J1_dot(self) -> Float[Array, "*batch k nv"]:
        """Rate of J1."""
        return self._parts.vertical.jacobian_dot(self.rates)

    @once
    def A_star_dot(self) -> Float[Array, "*batch k r"]:
        """Rate of A_star."""
        return self.J1_dot @ self.R + self.J1 @ self.R_dot

    @once
    def b_dot(self) -> Float[Array, "*batch nv"]:
        """Rate of b."""
        parts = self._parts
        if not parts.affine:
            return np.zeros_like(self.b)
        mu_dot = np.take_along_axis(parts.rows.rate_dot(self.rates), self._broad_kept, axis=-1)
        return apply(self.E_inverse[self._parts.multiplied], mu_dot) - apply(self.E_inverse, apply(self.E_dot, self.b))

    @property
    def C(self) -> Float[Array, "*batch nv nv"]:
        """Coriolis matrix C* before reduction, with ``Hdot* = C* + C*^T``."""
        return self.rates.C

    @property
    def bias(self) -> Float[Array, "*batch nv"]:
        """Nonlinear effects ``C* v + g*``."""
        return self.motion.bias

    @once
    def g(self) -> Float[Array, "*batch nv"]:
        """Gravity forces g* before reduction."""
        return self.bias - apply(self.C, self.v)

    @once
    def V(self) -> Float[Array, "*batch r r"]:
        """Coriolis matrix, with ``Hdot = V + V^T``."""
        return self.R.mT @ (self.M @ self.R_dot + self.C @ self.R)

    @once
    def G(self) -> Float[Array, "*batch r"]:
        """Gravity forces; with affine constraints also those of the motion b, ``R^T (g* + H* b_dot + C* b)``."""
        g = self.g
        if self._parts.affine:
            g = g + apply(self.M, self.b_dot) + apply(self.C, self.b)
        return apply_transposed(self.R, g)

    def measure(self, integrals: ArrayInput | None = None) -> Measurement:
        """What controllers may see: outputs, rates and the kinematics between them, no inertia.

        Args:
            integrals: integrals of v2 over time (..., r), which stand for the values of quasi-velocity outputs; without
                them those values are NaN, and a controller that needs one says so.
        """
        quasi = self._parts.reducing.quasi
        x1, x2 = self.outputs(integrals)
        if integrals is None and quasi.any():
            x2 = x2.copy()
            x2[..., quasi] = np.nan
        offset = offset_dot = None
        if self._parts.affine:
            offset = apply(self.J1, self.b)
            offset_dot = apply(self.J1_dot, self.b) + apply(self.J1, self.b_dot)
        return Measurement(
            q=self.q,
            v=self.v,
            v2=self.v2,
            x1=x1,
            x2=x2,
            v1=self.v1,
            A_star=self.A_star,
            A_star_dot=self.A_star_dot,
            v1_offset=offset,
            v1_offset_dot=offset_dot,
            residual=self.residual,
        )

    # ------------------------------------------------------------------ forces

    def flow(self, T: ArrayInput, damping: Array | None = None, external: Array | None = None) -> Flow:
        """What an integrator needs: full velocity, reduced acceleration and power.

        Args:
            T: actuator inputs (..., p) [N or N m].
            damping: viscous coefficients (nv,) [N m s/rad or N s/m].
            external: generalized forces (..., nv) beside inputs and damping.
        """
        force = self._force(vector(T, self._parts.p, "T"), damping)
        if external is not None:
            force = force + external
        v2_dot = self._accelerated(force)
        power = self.v.dot(force) if force.ndim == 1 else np.vecdot(self.v, force)
        if self._parts.affine:  # constraints that move do work
            power = power - np.vecdot(self.mu, self._multipliers(force, v2_dot))
        return Flow(self.v, v2_dot, power)

    def v2_dot(self, T: ArrayInput) -> Float[Array, "*batch r"]:
        """Accelerations of the reducing outputs under actuator inputs T (..., p)."""
        return self._accelerated(self._force(vector(T, self._parts.p, "T"), None))

    def v_dot(self, v2_dot: Array) -> Float[Array, "*batch nv"]:
        """Full acceleration of a reduced one (..., r): ``R v2_dot + Rdot v2 + b_dot``."""
        return apply(self.R, v2_dot) - self._E_inverse_gamma

    @once
    def _E_inverse_gamma(self) -> Array:
        return apply(self.E_inverse, self.gamma)

    def _force(self, T: Array, damping: Array | None) -> Array:
        force = apply(self.B, T)
        return force if damping is None else force - damping * self.v

    def _total_force(self, T: ArrayInput, external: Array | None) -> Array:
        force = self._force(vector(T, self._parts.p, "T"), None)
        return force if external is None else force + external

    @once
    def _unforced(self) -> Array:
        """``H* E^-1 gamma - bias``: what moves the system beside its actuators, as ``vdot = R v2dot - E^-1 gamma``."""
        return apply(self.M, self._E_inverse_gamma) - self.bias

    def _accelerated(self, force: Array) -> Array:
        # H v2dot = R^T (force - bias + H* E^-1 gamma).
        free = force + self._unforced
        v2_dot = solve_positive_definite(self.H, apply_transposed(self.R, free))
        if not (isfinite(sum(v2_dot.tolist())) if v2_dot.ndim == 1 else np.isfinite(v2_dot).all()):
            raise DivergenceError("accelerations have no bound")
        return v2_dot

    def inverse_dynamics(self, v2_dot: ArrayInput) -> Float[Array, "*batch r"]:
        """Reduced forces ``F = H v2dot + V v2 + G``."""
        acceleration = self.v_dot(vector(v2_dot, self._parts.r, "v2_dot"))
        return apply_transposed(self.R, apply(self.M, acceleration) + self.bias)

    def allocate(self, F: ArrayInput) -> Float[Array, "*batch p"]:
        """Actuator inputs T with ``R^T B T = F``; the smallest where there are several.

        Raises:
            ConstraintError: the actuators cannot produce every F (rank of ``R^T B`` below r).
        """
        parts = self._parts
        F = vector(F, parts.r, "F")
        matrix = self.input_matrix
        if parts.p == parts.r:
            inverted = inverse(matrix)
            # How rounding is amplified, whatever the units of the inputs; how it fell may look well by chance.
            if np.isfinite(inverted).all() and product(np.abs(matrix), np.abs(inverted)).max(initial=0.0) < _AMPLIFIED:
                return apply(inverted, F)
        rank = np.min(np.linalg.matrix_rank(matrix, rtol=1e-10), initial=parts.r) if parts.p else 0
        if rank < parts.r:
            raise ConstraintError(
                f"actuators {', '.join(parts.actuation.names) or '(none)'} reach rank {rank} of the {parts.r} "
                "reduced forces: not every F can be realised"
            )
        return apply(np.linalg.pinv(matrix), F)

    def acceleration(self, T: ArrayInput, external: Array | None = None) -> Float[Array, "*batch nv"]:
        """Full acceleration under inputs T (..., p) and generalized forces (..., nv) beside them."""
        return self.v_dot(self._accelerated(self._total_force(T, external)))

    def multipliers(self, T: ArrayInput, external: Array | None = None) -> Float[Array, "*batch m"]:
        """Multipliers lambda of the rows in A, in ``B T + external = H* vdot + C* v + g* + A^T lambda``.

        The rows are those kept by default; at states where others had to be chosen these have no multipliers of their
        own, and are NaN: ``contact_forces`` says what acts there.

        Args:
            T: actuator inputs (..., p) [N or N m].
            external: generalized forces (..., nv) beside them, such as damping and friction; none by default.
        """
        force = self._total_force(T, external)
        found = self._multipliers(force, self._accelerated(force))
        if not self._by_default:
            found[(self._broad_kept != np.array(self._parts.kept, dtype=int)).any(axis=-1)] = np.nan
        return found

    def _multipliers(self, force: Array, v2_dot: Array) -> Array:
        # A^T lambda + J2^T 0 = what is left of the balance, that is E^T [lambda; 0] = it.
        return apply_transposed(self.E_inverse[self._parts.multiplied], self._unbalanced(force, v2_dot))

    def _unbalanced(self, force: Array, v2_dot: Array) -> Array:
        """``A^T lambda``: what the constraints have to take up."""
        return force - self.bias - apply(self.M, self.v_dot(v2_dot))

    def contact_forces(self, T: ArrayInput, external: Array | None = None) -> Float[Array, "*batch k"]:
        """Multipliers of all constraint rows, dropped ones included: the smallest (in the sum of squares) that do it.

        Where rows depend on each other, as two wheels of one axle do, mechanics of rigid bodies does not say how they
        share the force; the least norm shares it evenly.

        Args:
            T: actuator inputs (..., p) [N or N m].
            external: generalized forces (..., nv) beside them, such as damping and friction; none by default.
        """
        force = self._total_force(T, external)
        unbalanced = self._unbalanced(force, self._accelerated(force))
        # Rows that are dependent but for rounding are so here too: no more directions than rows are kept.
        left, values, right = np.linalg.svd(self.all_rows.mT, full_matrices=False)
        counted = (np.arange(values.shape[-1]) < self._parts.m) & (values > 1e-10 * values[..., :1])
        inverses = np.divide(1.0, values, out=np.zeros_like(values), where=counted)
        return apply_transposed(right, inverses * apply_transposed(left, unbalanced))

    @property
    def kinetic_energy(self) -> Array | float:
        """(...,) [J]"""
        return 0.5 * np.vecdot(self.v, apply(self.M, self.v))

    @property
    def energy(self) -> Array | float:
        """Kinetic plus potential energy (...,) [J]."""
        return self.kinetic_energy + self._parts.kinematics.potential_energy(self.q)

    def terms(self) -> ReducedTerms:
        """Every matrix of the reduced system."""
        return ReducedTerms(
            R=self.R,
            R_dot=self.R_dot,
            H=self.H,
            V=self.V,
            G=self.G,
            input_matrix=self.input_matrix,
            A=self.A,
            A_dot=self.A_dot,
            A_star=self.A_star,
            A_star_dot=self.A_star_dot,
            v=self.v,
            b=self.b,
            b_dot=self.b_dot,
        )

    # ------------------------------------------------------------------ singular configurations

    def _singularity(self, regular: Array) -> SingularityError:
        """What is said of the first state that is not regular."""
        first = np.unravel_index(int(np.argmin(regular)), regular.shape) if regular.ndim else ()
        scaled = self.scaled_stack()[first]
        left, values, _ = np.linalg.svd(scaled)
        weights = np.abs(left[:, -1])
        names = self._names(first)
        return SingularityError(
            "singular configuration",
            q=self.q[first].copy(),
            condition=float(values[0] / max(values[-1], 1e-300)),
            rows=[name for name, weight in zip(names, weights, strict=True) if weight > 0.1 * weights.max()],
        )

    def _names(self, i: tuple[np.intp, ...]) -> tuple[str, ...]:
        """Of the rows of E at one state."""
        return (*(self._parts.rows.names[row] for row in self._broad_kept[i]), *self._parts.reducing.names)
