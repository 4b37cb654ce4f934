"""Velocity coordinates of the plant, regular if the constraints have constant rank."""

from __future__ import annotations

import numpy as np

from rnc_pin.math.components import Component
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model.compiled import CompiledReduction
from rnc_pin.model.compiled_runs import evaluator_of
from rnc_pin.model.factorization import constraint_rows
from rnc_pin.model.reduction_data import ReductionData
from rnc_pin.model.row_stack import OutputStack
from rnc_pin.model.state_evaluation import StateEvaluation

MAX_GROWTH = 3.0
"""Growth of ``|R|^2`` at which a chart is replaced: some velocity is then 60 degrees off the basis."""


class VelocityChart:
    """Reducing velocities ``w = W v``, with W an orthonormal basis of the admissible velocities at the centre q.

    At q, ``R = W^T``. W is constant, so its rows have no time derivative. If R grows, a new chart replaces this one,
    and the full velocity does not change. A chart depends on A only, not on the outputs of a controller. It is
    singular only where the constraints lose rank.

    Args:
        data: data of any reduction of the system.
        q: centre of the chart (nq,).
        integrated: outputs whose rates ``derivative`` returns.
        t: time for rheonomic constraints [s].
    """

    def __init__(self, data: ReductionData, q: np.ndarray, integrated: OutputStack, t: float | None = None) -> None:
        m = data.m
        A = constraint_rows(data, data.kinematics.position(q, t))
        self._scale = data.lengths[:m]
        self.W = null_space(A / np.where(self._scale > 0, self._scale, 1.0)[:, None]).T
        self.reduction_data = data.in_velocities(self.W, vertical=integrated)

    def at(self, q: np.ndarray, w: np.ndarray, t: Component | None = None) -> StateEvaluation:
        """Return the state at (q, w) of this chart."""
        return StateEvaluation.at(self.reduction_data, q, w, t=t)

    def derivative(
        self,
        q: np.ndarray,
        w: np.ndarray,
        T: np.ndarray,
        external: np.ndarray | None,
        damping: np.ndarray | None,
        t: float | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Full velocity at (q, w), and the rates that ``state_rates`` returns, under constant forces."""
        compiled = self._whole_kernel
        found = None if compiled is None else compiled.state_derivative(q, w, T, external, damping, t)
        if found is not None:
            return found
        return state_rates(self.at(q, w, t), T, damping, external)

    def advance(
        self, q: np.ndarray, y: np.ndarray, T: np.ndarray, h: float, steps: int
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """State (q, y) after equal steps of ``LieRungeKutta4`` under inputs T; None without the compiled kernel."""
        compiled = self._whole_kernel
        return None if compiled is None else compiled.integrate(q, y, T, h, steps)

    def local_rate(self, q: np.ndarray, x: np.ndarray, T: np.ndarray, damping: np.ndarray | None) -> np.ndarray | None:
        """Rates of ``x = (u, y)`` at ``q (+) u`` under inputs T; None without the compiled kernel."""
        compiled = self._whole_kernel
        return None if compiled is None else compiled.chart_rate(q, x, T, damping)

    @property
    def _whole_kernel(self) -> CompiledReduction | None:
        """Kernel for whole evaluations; None without it."""
        return self.reduction_data.compiled

    @property
    def evaluator(self) -> object:
        """Evaluator of the kernel for many runs; None without it, and for constraints that depend on time."""
        return None if self.reduction_data.rheonomic else evaluator_of(self._whole_kernel)

    def velocity(self, q: np.ndarray, w: np.ndarray, t: float | None = None) -> tuple[np.ndarray, bool]:
        """Full velocity at (q, w), and True if this state needs a new chart."""
        compiled = self._whole_kernel
        found = None if compiled is None else compiled.admissible_velocity(q, w, t)
        if found is None:
            state = self.at(q, w, t)
            found = state.v, float(np.square(state.R).sum())
        v, size = found
        return v, not size < self.reduction_data.r + MAX_GROWTH


def state_rates(
    state: StateEvaluation, T: np.ndarray, damping: np.ndarray | None, external: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Full velocity at a state of a chart, and the rates of w, the integrals, the time if rheonomic, and the work."""
    v, w_dot, power = state.flow(T, damping, external)
    return v, np.concatenate([w_dot, state.v1, [power] if state.t is None else [1.0, power]])
