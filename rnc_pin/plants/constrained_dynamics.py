"""Equations of motion of the plant, in velocity charts that do not depend on the outputs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import clipped, null_space
from rnc_pin.model.evaluator import Evaluator, evaluator_for
from rnc_pin.model.factorization import constraint_rows
from rnc_pin.model.input_validation import vector
from rnc_pin.model.integrators import Rate, ReducedMotion, state_rates
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import ConstantRows, OutputRows, OutputStack
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.plant import ROUNDING

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
        integrated: outputs whose rates are integrated.
        t: time for rheonomic constraints [s].

    Attributes:
        W: basis (r, nv).
        evaluator: evaluator of the reduction to w.
    """

    def __init__(self, known: Evaluator, q: np.ndarray, integrated: OutputStack, t: float | None = None) -> None:
        data, m = known.data, known.data.m
        A = constraint_rows(data, data.kinematics.position(q, t))
        # Rows in metres and in radians, scaled to equal lengths, have equal weight in the rank.
        lengths = data.lengths[:m]
        self.W = null_space(A / np.where(lengths > 0, lengths, 1.0)[:, None]).T
        key = self.W.tobytes(), *(id(place.block) for place in integrated.places)
        # Runs from one start have equal charts: their evaluator is built once.
        if known.kept_chart is None or known.kept_chart[0] != key:
            known.kept_chart = key, evaluator_for(data.in_velocities(self.W, vertical=integrated), known)
        self.evaluator = known.kept_chart[1]

    def velocity(self, q: np.ndarray, w: np.ndarray, t: float | None) -> tuple[np.ndarray, bool]:
        """Full velocity at (q, w), and True if this state needs a new chart.

        Args:
            q: configuration (nq,).
            w: velocities of the chart (r,).
            t: time of rheonomic constraints [s]; None for others.
        """
        v, size = self.evaluator.admissible_velocity(q, w, t)
        # The squares of R sum to r in the centre of an orthonormal chart, and grow without bound at its edge.
        return v, not size < self.evaluator.data.r + MAX_GROWTH


def integrated_outputs(reduced: ReducedModel) -> np.ndarray:
    """Mask (r,) of the reducing outputs whose velocity has to be integrated.

    Args:
        reduced: reduced model.
    """
    x2 = reduced.reducing
    mask = np.zeros(x2.size, dtype=bool)
    for block, where, *_ in x2.places:
        # A quasi-velocity has no coordinate, and a continuous joint's coordinate forgets full turns.
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
    * integrals of the model's reducing velocities that need one. A quasi-velocity has no other value, and a
      continuous joint loses full turns without it,
    * time, if the constraints are rheonomic,
    * work of all forces.

    Args:
        reduced: model with the outputs.
        joint_damping: True for the viscous joint damping of the robot's file.
        actuator_limits: True to clip inputs to the actuator limits.

    Attributes:
        damping: viscous damping coefficients (nv,); None without damping.
        integrated: mask (r,) of the reducing outputs with an integral.
        integrands: these outputs, (k,).
        state_size: length of y.
        chart: current velocity chart, since ``initial``.

    Raises:
        ConstraintError: damping acts on a momentum that the model declares conserved.
    """

    def __init__(self, reduced: ReducedModel, joint_damping: bool = False, actuator_limits: bool = False) -> None:
        self.reduced = reduced
        model = reduced.robot.model
        self._limits = reduced.actuation.limits if actuator_limits else None
        self.damping: np.ndarray | None = None
        # Zeros in a file are no damping: the plant then takes the cheaper steps.
        if joint_damping and np.any(model.damping):
            self.damping = np.array(model.damping)
            check_conserved(reduced, self.damping, "joint damping")
        self._r, x2 = reduced.r, reduced.reducing
        self.integrated = integrated_outputs(reduced)
        blocks = [(block, where) for block, where, _ in x2.places if isinstance(block, OutputRows)]
        self.integrands = OutputStack([block for block, where in blocks if self.integrated[where].any()])
        self._where = np.flatnonzero(self.integrated)
        # w, outputs whose values are integrated, the time if constraints need it, and the work.
        self.state_size = self._r + len(self._where) + reduced.rheonomic + 1
        self._motion = ReducedMotion(reduced.robot, self.damping)
        self.chart: VelocityChart

    # ------------------------------------------------------------------ states

    def initial(self, q: np.ndarray, v: np.ndarray, t: float = 0.0) -> np.ndarray:
        """Return the initial y at time t, in a chart centred at q.

        Args:
            q: configuration (nq,).
            v: velocity (nv,).
            t: time of rheonomic constraints [s].
        """
        rheonomic = self.reduced.rheonomic
        self.chart = VelocityChart(self.reduced.evaluator, q, self.integrands, t if rheonomic else None)
        y = np.zeros(self.state_size)
        # W is orthonormal, so that its transpose inverts it for admissible velocities.
        y[: self._r] = self.chart.W @ v
        if rheonomic:
            y[-2] = t
        return y

    def time(self, y: np.ndarray) -> float | None:
        """Time of a state [s]; None if the constraints do not depend on it.

        Args:
            y: state of the integrator.
        """
        return float(y[-2]) if self.reduced.rheonomic else None

    def integrals(self, y: np.ndarray) -> np.ndarray:
        """Integrals of the reducing velocities, (..., r); zero for those without one.

        Args:
            y: states of the integrator (..., state_size).
        """
        integrals = np.zeros((*y.shape[:-1], self._r))
        integrals[..., self._where] = y[..., self._r : self._r + len(self._where)]
        return integrals

    def at(self, q: np.ndarray, y: np.ndarray) -> StateEvaluation:
        """States (...,) in the current chart.

        Args:
            q: configurations (..., nq).
            y: states of the integrator (..., state_size).
        """
        # Of many states each has a time of its own.
        t = self.time(y) if y.ndim == 1 or not self.reduced.rheonomic else y[..., -2]
        return StateEvaluation.at(self.chart.evaluator, q, np.ascontiguousarray(y[..., : self._r]), t=t)

    def recentre(self, q: np.ndarray, y: np.ndarray) -> tuple[StateEvaluation, np.ndarray]:
        """Replace the chart if it is ill-conditioned; return the state in the reduction of the model, and y.

        Args:
            q: configuration (nq,).
            y: state of the integrator.
        """
        t = self.time(y)
        # The full velocity goes through the change of chart: the motion does not depend on where charts end.
        v, is_ill_conditioned = self.chart.velocity(q, y[: self._r], t)
        if is_ill_conditioned:
            self.chart = VelocityChart(self.reduced.evaluator, q, self.integrands, t)
            y = np.concatenate([self.chart.W @ v, y[self._r :]])
        return self.reduced.evaluator.measured(q, v, t), y

    def error(self, q: np.ndarray, y: np.ndarray, q_fine: np.ndarray, y_fine: np.ndarray, smooth: bool) -> float:
        """Estimated largest error of a state (q, y) by another one from half the step; zero if it is rounding.

        Args:
            q, y: the state.
            q_fine, y_fine: state from half the step.
            smooth: True if the integration is of fourth order.
        """
        r = self._r
        # Both ends are in one chart, so the difference of w is one of full velocities.
        velocity = (y_fine[:r] - y[:r]) @ self.chart.W
        scale = max(np.abs(q_fine).max(initial=0.0), np.abs(y_fine[:r]).max(initial=0.0))
        fourth = 16.0 / 15.0  # of order 4, error over its difference from the result with half the step
        first = 2.0  # of order 1, the same
        change = np.concatenate([pin.difference(self.reduced.robot.model, q, q_fine), velocity])
        error = float(np.abs(change).max(initial=0.0)) * (fourth if smooth else first)
        return error if error > ROUNDING * (1.0 + scale) else 0.0

    def project(self, q: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Configuration near q that satisfies the holonomic rows at the time of y.

        Args:
            q: configuration (nq,).
            y: state of the integrator.
        """
        assembly = self.reduced.assembly
        return assembly.project(q, t=self.time(y)) if assembly.size else q

    # ------------------------------------------------------------------ motion

    def damping_force(self, state: StateEvaluation) -> np.ndarray | None:
        """Generalized force (nv,) of damping; None without damping.

        Args:
            state: evaluation of the state.
        """
        return None if self.damping is None else -self.damping * state.v

    def saturate(self, T: np.ndarray) -> np.ndarray:
        """Inputs clipped to the actuator limits; T itself without ``actuator_limits``.

        Those who hold inputs call this: ``ReducedPlant``, ``SlidingPlant``, ``simulation.batch`` and ``free_motion``.

        Args:
            T: actuator inputs (..., p).
        """
        return T if self._limits is None else clipped(T, self._limits)

    def advance(
        self, q: np.ndarray, y: np.ndarray, T: np.ndarray, h: float, steps: int
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Return (q, y) after equal steps of a time h [s] under inputs T, without damping, and their roughness.

        Args:
            q: configuration (nq,).
            y: state of the integrator.
            T: actuator inputs (p,), constant during the steps.
            h: duration of each step [s].
            steps: number of steps.

        Raises:
            DivergenceError: accelerations are not finite, or a step is longer than the integrator's chart.
        """
        return self._motion.steps(self.chart.evaluator, q, y, T, h, steps)

    def local_rate(self, q: np.ndarray, x: np.ndarray, T: np.ndarray) -> np.ndarray:
        """Rates of coordinates ``x = (u, y)`` at ``q (+) u`` under inputs T.

        Args:
            q: centre of the coordinates (nq,).
            x: displacement u (nv,), then the state y.
            T: actuator inputs (p,).
        """
        return self._motion.local_rate(self.chart.evaluator, q, x, T)

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
            # Once here, and not at each stage: the kernel reads contiguous arrays.
            external = np.ascontiguousarray(external)

        def rate(q: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            if projection is None:
                return self._motion.rate(self.chart.evaluator, q, y, T, external)
            return state_rates(projection(self.at(q, y)), T, self.damping, external)

        return rate
