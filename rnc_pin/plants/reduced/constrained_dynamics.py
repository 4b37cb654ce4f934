"""Equations of motion of the plant, in velocity charts that do not depend on the outputs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.integrators import Rate
from rnc_pin.model.input_validation import vector
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.row_stack import OutputStack
from rnc_pin.model.rows import ConstantRows, OutputRows
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.reduced.velocity_chart import VelocityChart

Derivative = tuple[np.ndarray, np.ndarray]


def integrated_outputs(reduced: ReducedModel) -> np.ndarray:
    """Mask (r,) of the reducing outputs whose velocity has to be integrated."""
    x2 = reduced.reducing
    mask = np.zeros(x2.size, dtype=bool)
    for block, where, *_ in x2.places:
        mask[where] = x2.quasi[where].any() or (x2.angular[where].any() and isinstance(block, ConstantRows))
    return mask


def check_conserved(reduced: ReducedModel, coefficients: np.ndarray, effect: str) -> None:
    """Raise an error if an effect acts on a momentum that the model declares conserved.

    Args:
        reduced: reduced model.
        coefficients: coefficients (nv,) of the effect; zero where it does not act.
        effect: name of the effect, for the message.

    Raises:
        ConstraintError: names the effect and the momentum.
    """
    for block, *_ in reduced.constraints.places:
        if block.conserved is not None and coefficients[block.conserved].any():
            raise ConstraintError(f"{effect} acts on {block.names[0]}, which the model declares conserved")


class ConstrainedDynamics:
    """Equations of motion of a constrained system, with optional damping and actuator limits.

    The integration state is q and ``y = [w, integrals, work]``:

    * w (r,): velocities of the current chart,
    * integrals (r,) of the model's reducing velocities, for outputs that need one. A quasi-velocity has no other value,
      and a continuous joint loses full turns without it,
    * work of all forces.

    Args:
        reduced: model with the outputs.
        joint_damping: True for the viscous joint damping of the robot's file.
        actuator_limits: True to clip inputs to the actuator limits.

    Attributes:
        damping: viscous damping coefficients (nv,); None without damping.
        integrated: mask (r,) of the reducing outputs with an integral.

    Raises:
        ConstraintError: damping acts on a momentum that the model declares conserved.
    """

    def __init__(self, reduced: ReducedModel, joint_damping: bool = False, actuator_limits: bool = False) -> None:
        self.reduced = reduced
        model = reduced.robot.model
        self._limits = reduced.actuation.limits if actuator_limits else None
        self.damping: np.ndarray | None = None
        if joint_damping and np.any(model.damping):
            self.damping = np.array(model.damping)
            check_conserved(reduced, self.damping, "joint damping")
        self._r, x2 = reduced.r, reduced.reducing
        self.integrated = integrated_outputs(reduced)
        blocks = [(block, where) for block, where, _ in x2.places if isinstance(block, OutputRows)]
        self._integrands = OutputStack([block for block, where in blocks if self.integrated[where].any()])
        self._where = np.flatnonzero(self.integrated)
        self._chart: VelocityChart

    # ------------------------------------------------------------------ states

    def initial(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the initial y, in a chart centred at q."""
        self._chart = VelocityChart(self.reduced.reduction_data, q, self._integrands)
        return np.concatenate([self._chart.W @ v, np.zeros(self._r + 1)])

    def integrals(self, y: np.ndarray) -> np.ndarray:
        """Integrals of the reducing velocities, (r,)."""
        return y[self._r : 2 * self._r]

    def at(self, q: np.ndarray, y: np.ndarray) -> StateEvaluation:
        """State in the current chart."""
        return self._chart.at(q, y[: self._r])

    def integral_rows(self, state: StateEvaluation) -> np.ndarray:
        """Jacobian (r, nv) of the integrals; rows without an integral are zero."""
        rows = np.zeros((self._r, self.reduced.n))
        if self._integrands.size:
            rows[self._where] = self._integrands.jacobian(state.position)
        return rows

    def in_reduction(self, q: np.ndarray, y: np.ndarray) -> StateEvaluation:
        """State in the reduction of the model."""
        return self.at(q, y).in_reduction(self.reduced.reduction_data)

    def recentre(self, q: np.ndarray, y: np.ndarray) -> tuple[StateEvaluation, np.ndarray]:
        """Replace the chart if it is ill-conditioned; return the state in the reduction of the model, and y."""
        here = self.at(q, y)
        if self._chart.is_ill_conditioned(here):
            v = here.v
            self._chart = VelocityChart(self.reduced.reduction_data, q, self._integrands)
            y = np.concatenate([self._chart.W @ v, y[self._r :]])
        return here.in_reduction(self.reduced.reduction_data), y

    # ------------------------------------------------------------------ motion

    def damping_force(self, state: StateEvaluation) -> np.ndarray | None:
        """Generalized force (nv,) of damping; None without damping."""
        return None if self.damping is None else -self.damping * state.v

    def saturate(self, T: np.ndarray) -> np.ndarray:
        """Inputs clipped to the actuator limits."""
        return T if self._limits is None else np.clip(T, -self._limits, self._limits)

    def derivative_at(self, state: StateEvaluation, T: np.ndarray) -> Derivative:
        """Time derivative of (q, y) at a state that is already evaluated in the reduction of the model."""
        v, v2_dot, power = state.flow(T, self.damping)
        return v, self._y_dot(self._chart.W @ state.v_dot(v2_dot), state.v2[self._where], power)

    def derivative(
        self,
        T: np.ndarray,
        external: np.ndarray | None = None,
        projection: Callable[[StateEvaluation], StateEvaluation] | None = None,
    ) -> Rate:
        """Return the time derivative of (q, y) under constant forces, as a function for an integrator.

        Args:
            T: actuator inputs (p,).
            external: generalized forces (nv,) in addition to inputs and damping.
            projection: maps a state to the nearest valid one, for example to stop rows that stick; none by default.
        """
        T = vector(T, self.reduced.p, "T")
        if external is not None:
            external = np.ascontiguousarray(external)

        def rate(q: np.ndarray, y: np.ndarray) -> Derivative:
            w = y[: self._r]
            if projection is None:
                (v, w_dot, power), rates = self._chart.derivative(q, w, T, external, self.damping)
            else:
                state = projection(self._chart.at(q, w))
                (v, w_dot, power), rates = state.flow(T, self.damping, external), state.v1
            return v, self._y_dot(w_dot, rates, power)

        return rate

    def _y_dot(self, w_dot: np.ndarray, rates: np.ndarray, power: np.ndarray | float) -> np.ndarray:
        r = self._r
        y_dot = np.zeros(2 * r + 1)
        y_dot[:r], y_dot[2 * r] = w_dot, power
        y_dot[r + self._where] = rates
        return y_dot
