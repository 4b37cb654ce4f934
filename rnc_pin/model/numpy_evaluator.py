"""Evaluation by the formulas of ``StateEvaluation``: the reference of all evaluators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import InputError
from rnc_pin.model.configuration_evaluation import NOTHING_AT_Q, ConfigurationEvaluation
from rnc_pin.model.evaluator import ArraysAtQ, ArraysAtV, Configurations, HasArraysAtQ, ReducedTerms, States
from rnc_pin.model.input_validation import (
    ArrayInput,
    ConfigurationValidator,
    admit_numbers,
    admit_times,
    broadcast_states,
    vector,
)
from rnc_pin.model.reduced_kinematics import output_slopes
from rnc_pin.model.reduction_data import ReductionData
from rnc_pin.model.state_evaluation import StateEvaluation

_NOTHING_AT_V = ArraysAtV()


class PlannedFeedback(NamedTuple):
    """Feedback ``u + gains dx`` about planned states, within limits that the planned inputs widen."""

    q: Float[Array, "N nq"]
    """Planned configurations at the begin of each step."""
    w: Float[Array, "N nw"]
    gains: Float[Array, "K nu nx"]
    lower: Float[Array, " nu"]
    upper: Float[Array, " nu"]


class NumPyEvaluator:
    """Evaluator of one reduction that fills nothing: all quantities follow from their formulas.

    It is also the base of faster evaluators. These override calls, and call this class for states that they decline.

    Args:
        data: the reduction.

    Attributes:
        measures: True if ``measured`` is one call, for many runs too.
        compiled: True if a compiled kernel fills arrays.
        kept_chart: evaluator of the last velocity chart, and what defines it. Many runs start at one configuration.
    """

    measures = compiled = False

    def __init__(self, data: ReductionData) -> None:
        self.data = data
        self._validator = ConfigurationValidator(data.robot)
        self.kept_chart: tuple[tuple[object, ...], NumPyEvaluator] | None = None

    # ------------------------------------------------------------------ arrays

    def fill_at_q(self, at: Configurations, same: HasArraysAtQ | None) -> ArraysAtQ:
        """Fill arrays for q, perhaps from those of the same configurations in another reduction."""
        return NOTHING_AT_Q

    def fill_at_v(self, at: States, filled: ArraysAtQ) -> ArraysAtV:
        """Fill arrays for v, from those for q."""
        return _NOTHING_AT_V

    def rows_changed(self) -> None:
        """Read the parameters of constraint rows again; call it after a change of e.g. the radius of a wheel."""
        self.kept_chart = None

    # ------------------------------------------------------------------ evaluations

    def at(
        self, q: ArrayInput, v2: ArrayInput | None = None, v: ArrayInput | None = None, t: ArrayInput | None = None
    ) -> ConfigurationEvaluation | StateEvaluation:
        """Validate and evaluate configurations or states, as ``ReducedModel.at``."""
        q, data = self._validator.validate(q), self.data
        if t is not None and type(t) is not float:
            admit_numbers(t, "t")
        t = None if t is None or not data.rheonomic else admit_times(t, q.shape[:-1])
        if v2 is not None:
            if v is not None:
                raise InputError("at() takes v2 or v, not both")
            v2 = vector(v2, data.r, "v2", data.reducing.names).copy()
            q, v2 = broadcast_states(q, v2, "v2")
            return StateEvaluation.at(self, q, v2, t=t)
        if v is not None:
            q, v = broadcast_states(q, vector(v, data.n, "v"), "v")
            return StateEvaluation.at(self, q, v=v.copy(), t=t)
        return ConfigurationEvaluation.at(self, q, t=t)

    def state(self, q: ArrayInput, v2: ArrayInput, t: ArrayInput | None = None) -> StateEvaluation:
        """Validate and evaluate states (q, v2)."""
        found = self.at(q, v2, None, t)
        if not isinstance(found, StateEvaluation):
            raise InputError("v2 is missing: expected the reduced velocity")
        return found

    def measured(self, q: Array, v: Array, t: float | None = None) -> StateEvaluation:
        """Evaluate one validated state (nq,), (nv,) with all that a measurement needs."""
        return StateEvaluation.at(self, q, v=v, t=t)

    # ------------------------------------------------------------------ whole calls

    def forward_dynamics(self, q: ArrayInput, v2: ArrayInput, T: ArrayInput, t: ArrayInput | None) -> Array:
        """Reduced accelerations (..., r) under inputs T (..., p)."""
        return self.state(q, v2, t).v2_dot(T)

    def inverse_dynamics(self, q: ArrayInput, v2: ArrayInput, v2_dot: ArrayInput, t: ArrayInput | None) -> Array:
        """Reduced forces (..., r) for accelerations v2_dot (..., r)."""
        return self.state(q, v2, t).inverse_dynamics(v2_dot)

    def terms(self, q: ArrayInput, v2: ArrayInput) -> ReducedTerms:
        """All matrices at states (..., nq), (..., r)."""
        return self.state(q, v2).terms()

    def output_slopes(self, q: Array, along: Sequence[int] | Array) -> Array:
        """Rates (..., s, k, r) of A_star in the motions of single reducing outputs.

        Args:
            q: configurations (nq,) or (B, nq).
            along: indices of the outputs (s,).
        """
        return np.ascontiguousarray(np.moveaxis(output_slopes(self.at(q), along), 0, -3))

    def state_derivative(
        self, q: Array, v2: Array, T: Array, external: Array | None, damping: Array | None, t: float | None = None
    ) -> tuple[Array, Array]:
        """Full velocity, and rates of v2, of the integrals of J1 v, of a time, and of the work.

        Args:
            q: one configuration (nq,); all arrays are contiguous floats.
            v2: reduced velocities (r,).
            T: actuator inputs (p,).
            external: generalized forces (nv,) in addition to inputs and damping; None for zero.
            damping: viscous coefficients (nv,); None for zero.
            t: time for constraints that depend on it [s].
        """
        return state_rates(StateEvaluation.at(self, q, v2, t=t), T, damping, external)

    def admissible_velocity(self, q: Array, v2: Array, t: float | None = None) -> tuple[Array, float]:
        """Full velocity (nv,) at one state, and the sum of the squares of R."""
        state = StateEvaluation.at(self, q, v2, t=t)
        return state.v, float(np.square(state.R).sum())

    # ------------------------------------------------------------------ calls that only compiled evaluators have

    def state_derivatives(
        self, q: ArrayInput, v2: ArrayInput, T: ArrayInput, t: ArrayInput | None = None
    ) -> Mapping[str, Array] | None:
        """Derivatives by name, as read-only views; None if ``analysis.derivatives`` has to evaluate them."""
        return None

    def integrate(self, q: Array, y: Array, T: Array, h: float, steps: int) -> tuple[Array, Array, float] | None:
        """Configuration and y after equal Runge-Kutta steps, and their roughness; None if an integrator has to step.

        Args:
            q: configuration (nq,); all arrays are contiguous floats.
            y: reduced velocities v2, integrals of the rates of the vertical outputs, and work, (r + k + 1,). If the
                constraints depend on time, it comes before the work.
            T: actuator inputs (p,), constant.
            h: duration of each step [s].
            steps: number of steps.
        """
        return None

    def planned_motion(
        self, form: str, start: tuple[Array, Array], u: Array, h: float, steps: int, feedback: PlannedFeedback | None
    ) -> tuple[Array, Array, Array] | None:
        """States (K steps, nq), (K steps, nw) after each midpoint step, and their inputs; None if Python has to step.

        Args:
            form: "kinematic", "acceleration" or "dynamic": inputs are v2, v2_dot or T.
            start: configuration (nq,) and reduced velocities (nw,), of which the kinematic form has none.
            u: inputs (K, nu), constant over intervals.
            h: duration of a step [s].
            steps: steps of each interval.
            feedback: feedback about planned states; None without.
        """
        return None

    def planned_steps(self, form: str, q: Array, w: Array, u: Array, h: Array) -> tuple[Array, Array] | None:
        """States (n, nq), (n, nw) of nodes after one midpoint step of each; None if Python has to step.

        Args:
            form: as for ``planned_motion``.
            q: configurations (n, nq).
            w: reduced velocities (n, nw), of which the kinematic form has none.
            u: inputs (n, nu).
            h: durations of the steps (n,) [s].
        """
        return None

    def planned_derivatives(
        self, form: str, q: Array, w: Array, u: Array, h: Array
    ) -> tuple[Mapping[str, Array], tuple[Array, Array], Array] | None:
        """Derivatives at nodes by name, states as of ``planned_steps``, and their derivatives (n, nx, nx + nu + 1).

        The last are by state, input and step. None if formulas have to evaluate them. Arguments are as of
        ``planned_steps``.
        """
        return None

    def chart_rate(self, q: Array, x: Array, T: Array, damping: Array | None) -> Array | None:
        """Rates of local coordinates ``x = (u, y)`` at ``q (+) u``; None if an integrator has to compute them.

        Args:
            q: configuration (nq,) at the centre; all arrays are contiguous floats.
            x: coordinates u (nv,), then y as for ``integrate``.
            T: actuator inputs (p,).
            damping: viscous coefficients (nv,); None for zero.
        """
        return None


def state_rates(state: StateEvaluation, T: Array, damping: Array | None, external: Array | None) -> tuple[Array, Array]:
    """Full velocity at a state, and the rates of v2, the integrals of J1 v, the time if rheonomic, and the work."""
    v, v2_dot, power = state.flow(T, damping, external)
    return v, np.concatenate([v2_dot, state.v1, [power] if state.t is None else [1.0, power]])
