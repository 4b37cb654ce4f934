"""Evaluation of a reduced model at states (q, v): velocities, rates, measurements, dynamics, constraint forces, energy.

    Rdot = -E^-1 Edot R,   x1dot = A_star v2 + J1 b,
    V = R^T (H* Rdot + C* R),   G = R^T g*.

Affine constraints ``A v = mu(q)``, e.g. a momentum that is not zero, add a prescribed motion,

    bdot = E^-1 ([mudot; 0] - Edot b),   G = R^T (g* + H* bdot + C* b).

Passive forces f(q, v) count as part of g*, so ``B T = H* vdot + C* v + g* + A^T lambda`` holds.
Paper (2)-(3), (6)-(7). All quantities have leading batch axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import DivergenceError
from rnc_pin.math.linear_algebra import Component, apply, apply_transposed, inverse, product, solve_positive_definite
from rnc_pin.model.cached_property import cached_property, filled_at_v
from rnc_pin.model.configuration_evaluation import ArraySource, ConfigurationEvaluation
from rnc_pin.model.evaluation_results import Measurement, ReducedRegressor, ReducedTerms, StateDerivative
from rnc_pin.model.filled_arrays import CompiledArraysAtV
from rnc_pin.model.generalized_forces import ForceSums
from rnc_pin.model.input_validation import ArrayInput, vector
from rnc_pin.model.kinematics import VelocityKinematics
from rnc_pin.printing import ObjectSummary, described

_INERTIAL = ("m", "m x", "m y", "m z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz")
"""Parameters of a body in Pinocchio's order: mass, first moments, moments of inertia about the origin of the joint."""

NO_EFFECT = 1e-12
"""Singular value, relative to the largest, of inputs that move nothing."""


class StateEvaluation(ConfigurationEvaluation):
    """Reduced model at states (q, v). Each quantity is computed once, on first use, and is read-only.

    ``ReducedModel.at(q, v2)`` returns one. It does not change when the model is evaluated at other states.

    Args:
        configuration: evaluation at the same configurations (..., nq).
        v2: validated reduced velocities (..., r).
        v: validated measured full velocities (..., nv), instead of v2.
        motion: kinematics at these configurations and full velocities, if known.

    Raises (every quantity that needs R):
        SingularityError: the outputs do not parametrise the motion at q.
    """

    # A state that a record has filled has v2 and v themselves.
    _v2: Array | None = None
    _v: Array | None = None
    _motion: VelocityKinematics | None = None

    def __init__(
        self,
        configuration: ConfigurationEvaluation,
        v2: Array | None = None,
        v: Array | None = None,
        motion: VelocityKinematics | None = None,
    ) -> None:
        # Of another state at the same configurations, only what depends on q may be used.
        of_q = configuration.configuration if isinstance(configuration, StateEvaluation) else configuration
        self.configuration: ConfigurationEvaluation = of_q
        super().__init__(configuration._evaluator, configuration.q, self.configuration, configuration.t)
        # At a velocity, rates of rows over time are needed at once; at a configuration only mu needs them.
        self._check_time()
        self._v2, self._v, self._motion = v2, v, motion

    @classmethod
    def at(
        cls,
        evaluator: ArraySource,
        q: Array,
        v2: Array | None = None,
        v: Array | None = None,
        *,
        t: Component | None = None,
    ) -> StateEvaluation:
        """Evaluation at validated states: q (..., nq), and v2 (..., r) or v (..., nv), at times t (...).

        Args:
            evaluator: evaluator of the reduction.
            q: configurations (..., nq).
            v2: reduced velocities (..., r).
            v: measured full velocities (..., nv), instead of v2.
            t: times (...) [s]; None for constraints that do not depend on time.
        """
        return cls(ConfigurationEvaluation(evaluator, q, t=t), v2, v)

    def in_reduction(self, evaluator: ArraySource) -> StateEvaluation:
        """The same states in another reduction of the same system.

        Args:
            evaluator: evaluator of the other reduction.
        """
        # The full velocity is the same in each reduction; v2 is that of other outputs.
        return StateEvaluation(self.configuration.in_reduction(evaluator), v=self.v, motion=self._motion)

    # ------------------------------------------------------------------ velocities

    @cached_property
    def v2(self) -> Float[Array, "*batch r"]:
        """Rates of the reducing outputs."""
        # E v begins with the rates of the constraint rows; J2 v follows them.
        return np.ascontiguousarray(self.row_velocities[..., self._data.m :]) if self._v2 is None else self._v2

    @cached_property
    def v(self) -> Float[Array, "*batch nv"]:
        """Full velocity: ``R v2 + b``, or the measured one."""
        # A measured velocity is kept as it is: its slip is the residual of the constraints.
        return self.velocity(self.v2) if self._v is None else self._v

    @cached_property
    def motion(self) -> VelocityKinematics:
        """Kinematics at (q, v)."""
        if self._motion is None:
            self._motion = self.position.with_velocity(self.v)
        return self._motion

    @cached_property
    def arrays_at_v(self) -> CompiledArraysAtV | None:
        """Arrays that the compiled kernel fills for v; None without those for q, and for more states than these."""
        at_q = self.arrays_at_q
        if at_q is None or self.v.shape[:-1] != at_q.batch:
            return None
        return CompiledArraysAtV(at_q, self.v, self.motion if at_q.kernel.python_rows else None, self.t)

    @filled_at_v
    def row_velocities(self) -> Float[Array, "*batch nv"]:
        """Rates ``E v`` of the constraint rows and of the reducing outputs."""
        return apply(self.E, self.v)

    @filled_at_v
    def gamma(self) -> Float[Array, "*batch nv"]:
        """Bias acceleration ``Edot v - [mudot; 0]`` of constraint rows and reducing outputs, at zero ``vdot``."""
        chosen = self._of_kept_rows(lambda rows: rows.bias_acceleration(self.motion))
        return np.concatenate([chosen, self._data.reducing.bias_acceleration(self.motion)], axis=-1)

    @cached_property
    def residual(self) -> Float[Array, "*batch m"]:
        """Constraint residual ``A v - mu`` of the velocity."""
        residual = self.row_velocities[..., : self._data.m]
        # Rows on moving ground hold where they move with it, A v = mu.
        return residual - self.mu if self._data.affine else residual

    @filled_at_v
    def v1(self) -> Float[Array, "*batch k"]:
        """Rates of the vertical outputs, ``J1 v``."""
        return apply(self.J1, self.v)

    @filled_at_v
    def E_dot(self) -> Float[Array, "*batch nv nv"]:
        """Rate of E."""
        chosen = self._of_kept_rows(lambda rows: rows.jacobian_dot(self.motion))
        return np.concatenate([chosen, self._data.reducing.jacobian_dot(self.motion)], axis=-2)

    @cached_property
    def A_dot(self) -> Float[Array, "*batch m nv"]:
        """Rate of A."""
        return self.E_dot[..., : self._data.m, :]

    @filled_at_v
    def R_dot(self) -> Float[Array, "*batch nv r"]:
        """Rate ``-E^-1 Edot R`` of R."""
        # E R = [0; I] is constant, so Edot R + E Rdot = 0. Paper (3).
        return -product(self.E_inverse, product(self.E_dot, self.R))

    @filled_at_v
    def J1_dot(self) -> Float[Array, "*batch k nv"]:
        """Rate of J1."""
        return self._data.vertical.jacobian_dot(self.motion)

    @filled_at_v
    def A_star(self) -> Float[Array, "*batch k r"]:
        """Kinematics of the vertical outputs, ``x1dot = A_star v2 + J1 b``."""
        # J1 R follows from q alone: the evaluation at q has it, for all velocities.
        return super().A_star

    @filled_at_v
    def A_star_dot(self) -> Float[Array, "*batch k r"]:
        """Rate of A_star."""
        if not self.J1.shape[-2]:
            return self.A_star  # without outputs, no rate is needed, which may be unknown
        # Product rule of A_star = J1 R, paper (3a).
        return self.J1_dot @ self.R + self.J1 @ self.R_dot

    @cached_property
    def b_dot(self) -> Float[Array, "*batch nv"]:
        """Rate of b."""
        if not self._data.affine:
            return np.zeros_like(self.b)
        # The derivative of E b = [mu; 0], solved for bdot.
        mu_dot = self._of_kept_rows(lambda rows: rows.rate_dot(self.motion))
        return apply(self.E_inverse[..., : self._data.m], mu_dot) - apply(self.E_inverse, apply(self.E_dot, self.b))

    def _summary(self) -> ObjectSummary:
        title, lines = super()._summary()
        return ObjectSummary(title, [*lines, ("v2 [rad/s or m/s]", described(self.v2))])

    # ------------------------------------------------------------------ measurement

    def measure(self, integrals: ArrayInput | None = None) -> Measurement:
        """Measurement for controllers: outputs, rates and the kinematics between them, without inertia.

        Args:
            integrals: integrals of v2 over time (..., r), used as values of quasi-velocity outputs. Without them, these
                values are NaN, and a controller that needs one raises an error.
        """
        x1, x2 = self.outputs(integrals)
        if integrals is None and self._data.reducing.has_quasi:
            x2 = x2.copy()
            x2[..., self._data.reducing.quasi] = np.nan
        # A user's output may return NaN: name it here, before a controller computes with it.
        self._data.vertical.check(x1, self.A_star, self.A_star_dot)
        self._data.reducing.check(x2)
        offset = offset_dot = None
        if self._data.affine:
            # x1dot = J1 (R v2 + b): ground that moves carries the vertical outputs along at v2 = 0.
            offset = apply(self.J1, self.b)
            offset_dot = apply(self.J1_dot, self.b) + apply(self.J1, self.b_dot)
        fields = self.q, self.v, self.v2, x1, x2, self.v1, self.A_star, self.A_star_dot, offset, offset_dot
        return Measurement(*fields, self.residual)

    # ------------------------------------------------------------------ dynamics

    @cached_property
    def C(self) -> Float[Array, "*batch nv nv"]:
        """Coriolis matrix C* before reduction, with ``Hdot* = C* + C*^T``."""
        return self.motion.C

    @cached_property
    def bias(self) -> Float[Array, "*batch nv"]:
        """Nonlinear effects ``C* v + g*``, minus passive forces."""
        return self.nonlinear_effects - self.passive_force if self._data.forces else self.nonlinear_effects

    @filled_at_v
    def nonlinear_effects(self) -> Float[Array, "*batch nv"]:
        """Nonlinear effects ``C* v + g*`` without passive forces."""
        return self.motion.bias

    @cached_property
    def passive_force(self) -> Float[Array, "*batch nv"]:
        """Generalized forces of springs, dampers and other kinds from ``rnc_pin.forces``."""
        return self.passive_sums.total

    @filled_at_v
    def passive_sums(self) -> ForceSums:
        """Sums of the passive forces."""
        return self._data.forces.sums(self.motion)

    @cached_property
    def g(self) -> Float[Array, "*batch nv"]:
        """Gravity forces g* before reduction, the paper's ``G*``, minus passive forces."""
        if self._data.kinematics.axes_are_constant:
            # Nonlinear effects are C* v + g*.
            return self.bias - apply(self.C, self.v)
        # C* is unknown where the axes of joints move in their bodies: at rest, only g* is left.
        return self.position.with_velocity(np.zeros_like(self.v)).bias - self.passive_force

    @cached_property
    def V(self) -> Float[Array, "*batch r r"]:
        """Reduced Coriolis matrix, with ``Hdot = V + V^T``."""
        # With vdot = R v2dot + Rdot v2, the terms linear in v2 of R^T (H* vdot + C* v). Paper (7).
        return self.R.mT @ (self.M @ self.R_dot + self.C @ self.R)

    @cached_property
    def G(self) -> Float[Array, "*batch r"]:
        """Reduced gravity forces; affine constraints add forces of the motion b: ``R^T (g* + H* b_dot + C* b)``."""
        g = self.g
        if self._data.affine:
            # At v2 = 0 the robot still moves with b: its inertia and Coriolis forces are part of G.
            g = g + apply(self.M, self.b_dot) + apply(self.C, self.b)
        return apply_transposed(self.R, g)

    def flow(self, T: ArrayInput, damping: Array | None = None, external: Array | None = None) -> StateDerivative:
        """State derivative for an integrator: full velocity, reduced acceleration and power.

        Args:
            T: actuator inputs (..., p) [N or N m].
            damping: viscous coefficients (nv,) [N m s/rad or N s/m].
            external: generalized forces (..., nv) in addition to inputs and damping.
        """
        force = self._total_force(T, None)
        if damping is not None:
            force = force - damping * self.v
        if external is not None:
            force = force + external
        # Passive forces are added there, and once only.
        v2_dot = self.accelerated(force)
        applied = force
        if self._data.forces:  # those with a potential count as energy
            force = force + self.passive_sums.without_potential
        # Forces of constraints that do not move do no work: the other forces change the energy.
        power = self.v.dot(force) if force.ndim == 1 else np.vecdot(self.v, force)
        if self._data.affine:  # moving constraints do work
            power = power - np.vecdot(self.mu, self._multipliers(applied, v2_dot))
        return StateDerivative(self.v, v2_dot, power)

    def v2_dot(self, T: ArrayInput) -> Float[Array, "*batch r"]:
        """Accelerations of the reducing outputs under actuator inputs T (..., p).

        Args:
            T: actuator inputs (..., p) [N or N m].
        """
        return self.accelerated(self._total_force(T, None))

    @cached_property
    def input_accelerations(self) -> tuple[Float[Array, "r p"], Float[Array, " r"]]:
        """Reduced accelerations that unit inputs add, and those without inputs, at one state."""
        arrays = None if self._data.forces else self.arrays_at_v
        if arrays is not None and (filled := arrays.input_accelerations(self.B)) is not None:
            return filled
        # One factorization of H serves all columns: inputs one by one, then no input.
        right = np.vstack([self.input_matrix.T, self.unforced @ self.R])
        solved = solve_positive_definite(self.H, right)
        if np.isnan(solved).any():
            raise DivergenceError(f"reduced acceleration is not finite: {self._cause()}")
        return solved[:-1].T, solved[-1]

    @cached_property
    def accelerating_inputs(self) -> Float[Array, "p r"]:
        """Inputs of unit reduced accelerations, at one state with p = r; infinite if inputs depend on each other."""
        effects = self.input_accelerations[0]
        found = np.ascontiguousarray(inverse(effects))
        # The product of both norms bounds the ratio of singular values.
        independent = np.vdot(found, found) * np.vdot(effects, effects) * NO_EFFECT**2 < 1.0
        return found if independent else np.full(found.shape, np.inf)

    def v_dot(self, v2_dot: Array) -> Float[Array, "*batch nv"]:
        """Full acceleration ``R v2_dot + Rdot v2 + b_dot`` for a reduced acceleration (..., r).

        Args:
            v2_dot: reduced accelerations (..., r) [rad/s^2 or m/s^2].
        """
        # E vdot = [0; v2dot] - gamma, and the last columns of E^-1 are R.
        return apply(self.R, v2_dot) - self.E_inverse_gamma

    @filled_at_v
    def E_inverse_gamma(self) -> Float[Array, "*batch nv"]:
        """Acceleration ``E^-1 gamma``, with ``vdot = R v2dot - E^-1 gamma``."""
        return apply(self.E_inverse, self.gamma)

    def _total_force(self, T: ArrayInput, external: Array | None) -> Array:
        force = apply(self.B, vector(T, self._data.p, "T", self._data.actuation.names))
        return force if external is None else force + vector(external, self._data.n, "external")

    @cached_property
    def unforced(self) -> Array:
        """Forces ``H* E^-1 gamma - bias`` without actuators."""
        return self.motion_force + self.passive_force if self._data.forces else self.motion_force

    @filled_at_v
    def motion_force(self) -> Array:
        """Forces ``H* E^-1 gamma - (C* v + g*)``: ``unforced`` without passive forces."""
        # Forces of the motion at v2dot = 0, where vdot = -E^-1 gamma.
        return apply(self.M, self.E_inverse_gamma) - self.nonlinear_effects

    def accelerated(self, force: Array) -> Float[Array, "*batch r"]:
        """Reduced acceleration under generalized forces (..., nv): ``H v2dot = R^T (force + unforced)``.

        Args:
            force: generalized forces (..., nv) in addition to passive ones [N or N m].
        """
        # The kernel adds ``motion_force`` to these forces, so that passive ones count as inputs; the formula below adds
        # ``unforced``, which has both. The sum is the same.
        acting = force + self.passive_force if self._data.forces else force
        if self.arrays_at_v is not None and (filled := self.arrays_at_v.accelerated(acting)) is not None:
            return filled
        free = force + self.unforced
        # R^T cancels the constraint forces A^T lambda, because A R = 0. Paper (6).
        v2_dot = solve_positive_definite(self.H, apply_transposed(self.R, free))
        with np.errstate(over="ignore", invalid="ignore"):  # near the largest number, the sum overflows first
            finite = np.isfinite(v2_dot.sum(axis=-1)).all()
        if not finite:
            raise DivergenceError(f"reduced acceleration is not finite: {self._cause()}")
        return v2_dot

    def _cause(self) -> str:
        """Cause of accelerations that are not finite: rates of a row, a passive force, or else inertia or inputs."""
        for name, rates in zip(self._data.stack.names, np.moveaxis(self.gamma, -1, 0), strict=True):
            if not np.isfinite(rates).all():
                return f"the rate of row '{name}' is not finite"
        for each in self._data.forces:
            if not np.isfinite(each.force(self.motion)).all():
                return f"the force '{each.name}' is not finite"
        if not np.isfinite(self.B).all():
            return "the actuation matrix B(q) is not finite"
        return "H is nearly singular or a force is too large"

    def inverse_dynamics(self, v2_dot: ArrayInput) -> Float[Array, "*batch r"]:
        """Reduced forces ``F = H v2dot + V v2 + G``.

        Args:
            v2_dot: reduced accelerations (..., r) [rad/s^2 or m/s^2].
        """
        acceleration = self.v_dot(vector(v2_dot, self._data.r, "v2_dot"))
        # The same as H v2dot + V v2 + G, without the matrices H and V.
        return apply_transposed(self.R, apply(self.M, acceleration) + self.bias)

    def regressor(self, v2_dot: ArrayInput) -> ReducedRegressor:
        """Regressor ``R^T Y(q, v, vdot)``: the reduced forces are linear in the inertial parameters of the bodies.

        Args:
            v2_dot: reduced accelerations (..., r).
        """
        robot, model = self._data.robot, self._data.robot.model
        v_dot = self.v_dot(vector(v2_dot, self._data.r, "v2_dot"))
        batch = v_dot.shape[:-1]
        q, v = np.broadcast_to(self.q, (*batch, model.nq)), np.broadcast_to(self.v, (*batch, model.nv))
        # Ten parameters of each body: the first of Pinocchio's joints is the world, without a body.
        shape = model.nv, 10 * (model.njoints - 1)
        torques = self._data.kinematics.over_states(pin.computeJointTorqueRegressor, shape, q, v, v_dot)
        driven = np.flatnonzero(model.armature)
        # A motor inertia acts on its own joint only, by its acceleration.
        motors = np.eye(model.nv)[:, driven] * v_dot[..., None, driven]
        bodies = [f"{each} of {joint}" for joint in list(model.names)[1:] for each in _INERTIAL]
        values = [each.toDynamicParameters() for each in list(model.inertias)[1:]]
        names = (*bodies, *(f"motor inertia of {robot.velocity_names[k]}" for k in driven))
        matrix = self.R.mT @ np.concatenate([torques, motors], axis=-1)
        return ReducedRegressor(matrix, names, np.concatenate([*values, model.armature[driven]]))

    def acceleration(self, T: ArrayInput, external: Array | None = None) -> Float[Array, "*batch nv"]:
        """Full acceleration under inputs T (..., p) and external generalized forces (..., nv).

        Args:
            T: actuator inputs (..., p) [N or N m].
            external: generalized forces (..., nv) in addition to inputs; None for zero.
        """
        return self.v_dot(self.accelerated(self._total_force(T, external)))

    # ------------------------------------------------------------------ constraint forces

    def multipliers(self, T: ArrayInput, external: Array | None = None) -> Float[Array, "*batch m"]:
        """Multipliers lambda of the rows in A, from ``B T + external = H* vdot + C* v + g* + A^T lambda``.

        They have the sign of the paper: the force of a row on the robot is ``-lambda``. The rows are those kept by
        default. At states where other rows were selected, the multipliers are NaN; use ``contact_forces`` there.

        Args:
            T: actuator inputs (..., p) [N or N m].
            external: generalized forces (..., nv) in addition to T, e.g. damping and friction; zero by default.
        """
        force = self._total_force(T, external)
        found = self._multipliers(force, self.accelerated(force))
        if self.factorization.kept is not None:
            # Multipliers belong to rows by name: of other rows than the default, none has one of these names.
            other = self.kept != np.array(self._data.kept, dtype=int)
            found[other.any(axis=-1)] = np.nan
        return found

    def _multipliers(self, force: Array, v2_dot: Array) -> Array:
        # The remaining force is A^T lambda + J2^T 0 = E^T [lambda; 0].
        left = force - self.bias - apply(self.M, self.v_dot(v2_dot))
        return apply_transposed(self.E_inverse[..., : self._data.m], left)

    def constraint_forces(self, T: ArrayInput, external: Array | None = None) -> Float[Array, "*batch nv"]:
        """Generalized forces ``-A^T lambda`` of all constraints on the robot; arguments as of ``contact_forces``.

        Args:
            T: actuator inputs (..., p) [N or N m].
            external: generalized forces (..., nv) in addition to inputs; None for zero.
        """
        return self.forced_motion(T, external)[0]

    def forced_motion(
        self, T: ArrayInput, external: Array | None = None
    ) -> tuple[Float[Array, "*batch nv"], Float[Array, "*batch nv"]]:
        """Return ``constraint_forces`` and ``acceleration`` under the same forces.

        Args:
            T: actuator inputs (..., p) [N or N m].
            external: generalized forces (..., nv) in addition to inputs; None for zero.
        """
        force = self._total_force(T, external)
        if external is None and not self.batch:  # of one state, for any number of inputs
            v2_dot = np.asarray(T) @ self.input_accelerations[0].T + self.input_accelerations[1]
        else:
            v2_dot = self.accelerated(force)
        v_dot = self.v_dot(v2_dot)
        return -(force - self.bias - apply(self.M, v_dot)), v_dot

    def contact_forces(self, T: ArrayInput, external: Array | None = None) -> Float[Array, "*batch k"]:
        """Forces of all constraint rows on the robot, dropped rows included; of least norm if they are not unique.

        A positive force pushes the robot in the direction in which the row counts velocity: ``A^T force`` is the
        generalized force. These are minus the multipliers. Momentum rows have no force, only a multiplier.

        Rigid-body mechanics does not determine how dependent rows, e.g. of two wheels on one axle, share the force.
        The least norm shares it evenly.

        Args:
            T: actuator inputs (..., p) [N or N m].
            external: generalized forces (..., nv) in addition to T, e.g. damping and friction; zero by default.
        """
        acting = self.constraint_forces(T, external)
        # Rows that are dependent to rounding count as dependent here too: use at most m directions.
        return least_norm_forces(self.all_rows, acting, self._data.m)

    # ------------------------------------------------------------------ energy, terms

    @property
    def kinetic_energy(self) -> Array | float:
        """Kinetic energy (...,) [J]."""
        return 0.5 * np.vecdot(self.v, apply(self.M, self.v))

    @property
    def energy(self) -> Array | float:
        """Kinetic plus potential energy (...,) [J]."""
        energy = self.kinetic_energy + self._data.kinematics.over_states(pin.computePotentialEnergy, (), self.q)
        return energy + self._data.forces.potential(self.position) if self._data.forces else energy

    def terms(self) -> ReducedTerms:
        """All matrices of the reduced system."""
        return ReducedTerms(**{field.name: getattr(self, field.name) for field in fields(ReducedTerms)})


def least_norm_forces(rows: Array, acting: Array, rank: int) -> Array:
    """Forces of rows (..., k) of least norm with ``rows^T forces = acting``.

    Args:
        rows: rows (..., k, n), which may depend on each other.
        acting: generalized forces (..., n).
        rank: number of singular values that count, the largest first.
    """
    left, values, right = np.linalg.svd(rows.mT, full_matrices=False)
    counted = (np.arange(values.shape[-1]) < rank) & (values > 1e-10 * values[..., :1])
    inverses = np.divide(1.0, values, out=np.zeros_like(values), where=counted)
    return apply_transposed(right, inverses * apply_transposed(left, acting))


# ------------------------------------------------------------------ gradients along reducing outputs


def kinematic_gradient(here: ConfigurationEvaluation, along: Sequence[int] | Array) -> Float[Array, "*batch k r s"]:
    """Derivatives of ``A_star`` with respect to single reducing outputs, along their motions at unit rate.

    Args:
        here: evaluation at configurations.
        along: indices in x2, (s,).
    """
    if here.arrays_at_q is not None and (filled := here.arrays_at_q.output_slopes(along)) is not None:
        return np.moveaxis(filled, 0, -1)
    # A column of R moves one reducing output at unit rate, so the rate along it is a partial derivative.
    each = [StateEvaluation(here, v=here.R[..., j]).A_star_dot for j in along]
    return np.stack(each, axis=-1) if each else np.zeros((*here.A_star.shape, 0))
