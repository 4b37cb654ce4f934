"""What moves: a plant in charts of its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.row_stack import RowStack
from rnc_pin.model.rows import ConstantRows
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.simulation.lie_runge_kutta import Rate
from rnc_pin.simulation.plant import NOTHING_BESIDE, Plant
from rnc_pin.simulation.velocity_chart import VelocityChart

Slope = tuple[np.ndarray, np.ndarray]


def integrated(reduced: ReducedModel) -> np.ndarray:
    """Of which reducing outputs an integral has to be kept, (r,)."""
    x2 = reduced.reducing
    whole = np.zeros(x2.size, dtype=bool)
    for block, where, *_ in x2.places:
        whole[where] = x2.quasi[where].any() or (x2.angular[where].any() and isinstance(block, ConstantRows))
    return whole


class MovingPlant:
    """A system whose state is (q, v), with what a real machine has.

    Beside q it integrates ``y = [w, integrals, work]``: the velocities of its present chart (r,), integrals of the
    model's reducing velocities (r,) where an output needs one (quasi-velocities have no other value, a continuous joint
    would forget full turns), and the work done.

    Args:
        reduced: the model whose outputs are looked at.
        plant: what takes part beside the model itself.

    Attributes:
        damping: viscous coefficients (nv,) that act; None where nothing is damped.

    Raises:
        ConstraintError: damping would act on a momentum that is said to be conserved.
    """

    def __init__(self, reduced: ReducedModel, plant: Plant = NOTHING_BESIDE) -> None:
        self.reduced = reduced
        model = reduced.robot.model
        self._limits = reduced.actuation.limits if plant.actuator_limits else None
        self.damping: np.ndarray | None = None
        if plant.joint_damping and np.any(model.damping):
            self.damping = np.array(model.damping)
            for block, *_ in reduced.constraints.places:
                if block.conserved is not None and self.damping[block.conserved].any():
                    raise ConstraintError(f"joint damping acts on {block.names[0]}, which is said to be conserved")
        self._r, x2 = reduced.r, reduced.reducing
        self.carries = integrated(reduced)
        self._carried = RowStack([place.block for place in x2.places if self.carries[place.where].any()])
        self._where = np.flatnonzero(self.carries)
        self._chart: VelocityChart

    # ------------------------------------------------------------------ states

    def start(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Y at the beginning."""
        self._chart = VelocityChart(self.reduced.reduction_data, q)
        return np.concatenate([self._chart.W @ v, np.zeros(self._r + 1)])

    def integrals(self, y: np.ndarray) -> np.ndarray:
        """Integrals of the reducing velocities, (r,)."""
        return y[self._r : 2 * self._r]

    def at(self, q: np.ndarray, y: np.ndarray) -> StateEvaluation:
        """The state in the present chart."""
        return self._chart.at(q, y[: self._r])

    def integral_rows(self, state: StateEvaluation) -> np.ndarray:
        """Rows (r, nv) of what is integrated besides, zero where nothing is."""
        rows = np.zeros((self._r, self.reduced.n))
        if self._carried.size:
            rows[self._where] = self._carried.jacobian(state.position)
        return rows

    def seen(self, q: np.ndarray, y: np.ndarray) -> StateEvaluation:
        """The state as the model's outputs see it."""
        return self.at(q, y).in_reduction(self.reduced.reduction_data)

    def settled(self, q: np.ndarray, y: np.ndarray) -> tuple[StateEvaluation, np.ndarray]:
        """The state as the model's outputs see it, and y in a chart that suits it."""
        here = self.at(q, y)
        if self._chart.is_left(here):
            v = here.v
            self._chart = VelocityChart(self.reduced.reduction_data, q)
            y = np.concatenate([self._chart.W @ v, y[self._r :]])
        return here.in_reduction(self.reduced.reduction_data), y

    # ------------------------------------------------------------------ motion

    def damping_force(self, state: StateEvaluation) -> np.ndarray | None:
        """Generalized force (nv,) of damping; None where nothing is damped."""
        return None if self.damping is None else -self.damping * state.v

    def saturate(self, T: np.ndarray) -> np.ndarray:
        """Inputs that the actuators can give."""
        return T if self._limits is None else np.clip(T, -self._limits, self._limits)

    def first_slope(self, state: StateEvaluation, T: np.ndarray) -> Slope:
        """How (q, y) begins to change at a state that the model's outputs have seen: nothing is evaluated again."""
        v, v2_dot, power = state.flow(T, self.damping)
        return v, self._y_dot(self._chart.W @ state.v_dot(v2_dot), state, v, power)

    def rate(
        self,
        T: np.ndarray,
        external: np.ndarray | None = None,
        held: Callable[[StateEvaluation], StateEvaluation] | None = None,
    ) -> Rate:
        """How (q, y) changes under constant forces, for an integrator.

        Args:
            T: actuator inputs (p,).
            external: generalized forces (nv,) beside inputs and damping.
            held: gives a state without the motion that something holds; by default nothing is held.
        """

        def rate(q: np.ndarray, y: np.ndarray) -> Slope:
            state = self._chart.at(q, y[: self._r])
            if held is not None:
                state = held(state)
            v, w_dot, power = state.flow(T, self.damping, external)
            return v, self._y_dot(w_dot, state, v, power)

        return rate

    def _y_dot(self, w_dot: np.ndarray, state: StateEvaluation, v: np.ndarray, power: np.ndarray | float) -> np.ndarray:
        r = self._r
        y_dot = np.zeros(2 * r + 1)
        y_dot[:r], y_dot[2 * r] = w_dot, power
        if self._carried.size:
            y_dot[r + self._where] = apply(self._carried.jacobian(state.position), v)
        return y_dot
