"""Velocity coordinates of the plant, regular if the constraints have constant rank."""

from __future__ import annotations

import numpy as np

from rnc_pin.math.components import Component
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model.compiled import evaluator_for
from rnc_pin.model.factorization import constraint_rows
from rnc_pin.model.numpy_evaluator import NumPyEvaluator
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
        known: evaluator of any reduction of the system.
        q: centre of the chart (nq,).
        integrated: outputs whose rates ``derivative`` returns.
        t: time for rheonomic constraints [s].
    """

    def __init__(self, known: NumPyEvaluator, q: np.ndarray, integrated: OutputStack, t: float | None = None) -> None:
        data, m = known.data, known.data.m
        A = constraint_rows(data, data.kinematics.position(q, t))
        self._scale = data.lengths[:m]
        self.W = null_space(A / np.where(self._scale > 0, self._scale, 1.0)[:, None]).T
        self.evaluator = evaluator_for(data.in_velocities(self.W, vertical=integrated), known)

    def at(self, q: np.ndarray, w: np.ndarray, t: Component | None = None) -> StateEvaluation:
        """Return the state at (q, w) of this chart."""
        return StateEvaluation.at(self.evaluator, q, w, t=t)

    def derivative(
        self,
        q: np.ndarray,
        w: np.ndarray,
        T: np.ndarray,
        external: np.ndarray | None,
        damping: np.ndarray | None,
        t: float | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Full velocity at (q, w), and the rates of y, under constant forces."""
        return self.evaluator.state_derivative(q, w, T, external, damping, t)

    def advance(
        self, q: np.ndarray, y: np.ndarray, T: np.ndarray, h: float, steps: int
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """State (q, y) after equal steps of ``LieRungeKutta4`` under inputs T; None if the integrator has to step."""
        return self.evaluator.integrate(q, y, T, h, steps)

    def local_rate(self, q: np.ndarray, x: np.ndarray, T: np.ndarray, damping: np.ndarray | None) -> np.ndarray | None:
        """Rates of ``x = (u, y)`` at ``q (+) u`` under inputs T; None if the integrator has to compute them."""
        return self.evaluator.chart_rate(q, x, T, damping)

    def velocity(self, q: np.ndarray, w: np.ndarray, t: float | None = None) -> tuple[np.ndarray, bool]:
        """Full velocity at (q, w), and True if this state needs a new chart."""
        v, size = self.evaluator.admissible_velocity(q, w, t)
        return v, not size < self.evaluator.data.r + MAX_GROWTH
