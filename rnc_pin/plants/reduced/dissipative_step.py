"""Integration steps of a plant with viscous damping and dry friction."""

from __future__ import annotations

import numpy as np
import scipy

from rnc_pin.integrators import ExponentialRungeKutta4, LieRungeKutta4, LinearPart
from rnc_pin.math.linear_algebra import apply_transposed
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.reduced.constrained_dynamics import ConstrainedDynamics
from rnc_pin.plants.reduced.dry_friction import DryFriction, FrictionForces

_SHORT = 1e-6  # time to rest below which a row counts as stopped, relative to the step
_INSTANT = 1e-6  # horizon for instantaneous friction forces [s]


class DissipativeStep:
    """Integration step with friction: each row sticks or slides, and the step ends early if a row comes to rest.

    Between these events the motion is smooth. An exponential Runge-Kutta method integrates it, including damping.
    Impulses keep sticking rows at rest exactly, at every stage. Work includes the kinetic energy that each impulse
    removes, so that ``energy - work`` stays constant.

    Args:
        dynamics: equations of motion.
        friction: dry friction.
    """

    def __init__(self, dynamics: ConstrainedDynamics, friction: DryFriction) -> None:
        self._dynamics, self.friction = dynamics, friction
        self._explicit = LieRungeKutta4(dynamics.reduced.robot)
        self._integrator = ExponentialRungeKutta4(dynamics.reduced.robot)

    @property
    def needed(self) -> bool:
        """True if damping or friction is active."""
        return self._dynamics.damping is not None or len(self.friction.limits) > 0

    def friction_force(self, q: np.ndarray, y: np.ndarray, T: np.ndarray) -> np.ndarray:
        """Generalized forces (nv,) of dry friction at a state."""
        state = self._dynamics.at(q, y)
        linear, w_dot = self._linear(state, T)
        friction = self.friction.forces_in_step(state, w_dot, linear, _INSTANT)
        return friction.forces @ self.friction.rows(state)

    def advance(self, q: np.ndarray, y: np.ndarray, T: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the state after a time h under inputs T.

        Raises:
            DivergenceError: velocities or accelerations are not finite.
        """
        limits = self.friction.limits
        if not len(limits):
            state = self._dynamics.at(q, y)
            linear, _ = self._linear(state, T)
            return self._smooth(q, y, T, None, None, linear, h)
        events, remaining = 2 * len(limits), h
        while True:
            state = self._dynamics.at(q, y)
            linear, w_dot = self._linear(state, T)
            friction = self.friction.forces_in_step(state, w_dot, linear, remaining)
            first = float(friction.stops.min())
            if events == 0 or first >= remaining:
                y = self._stopped(state, y, friction.sticking)
                return self._sliding(q, y, T, friction.forces, friction.sticking, linear, remaining)
            events -= 1
            stopping = friction.stops <= (1.0 + _SHORT) * first
            if first < _SHORT * h:
                y = self._stopped(state, y, friction.resting | stopping)
                continue
            q, y = self._sliding(q, y, T, self._sliding_forces(friction), friction.resting, linear, first)
            y = self._stopped(self._dynamics.at(q, y), y, friction.resting | stopping)
            remaining -= first

    def _sliding_forces(self, friction: FrictionForces) -> np.ndarray:
        """Friction forces (k,) until the first row comes to rest."""
        return np.where(
            np.isinf(friction.stops),
            friction.forces,
            -self.friction.limits * np.sign(friction.speeds),
        )

    def _stopped(self, state: StateEvaluation, y: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Return y with the selected rows (k,) at rest. The lost kinetic energy is work of friction."""
        after = self.friction.stopped(state, which)
        if after is state:
            return y
        y = y.copy()
        y[: len(after.v2)] = after.v2
        y[-1] += after.kinetic_energy - state.kinetic_energy
        return y

    def _sliding(
        self,
        q: np.ndarray,
        y: np.ndarray,
        T: np.ndarray,
        forces: np.ndarray,
        sticking: np.ndarray,
        linear: LinearPart,
        h: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        friction = self.friction
        inputs, external = T + friction.inputs(forces), friction.external(forces)
        q, y = self._smooth(q, y, inputs, external, sticking, linear, h)
        return q, self._stopped(self._dynamics.at(q, y), y, sticking)

    def _smooth(
        self,
        q: np.ndarray,
        y: np.ndarray,
        T: np.ndarray,
        external: np.ndarray | None,
        sticking: np.ndarray | None,
        linear: LinearPart,
        h: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Integrate one step without events.

        The integrator uses work minus the kinetic energy ``|a|^2 / 2`` of the frozen inertia. Damping cancels in that
        difference; otherwise the integral of work would contain decays faster than the step.
        """
        r, dynamics = len(linear.decay), self._dynamics

        def projection(state: StateEvaluation) -> StateEvaluation:
            return state if sticking is None else self.friction.stopped(state, sticking)

        smooth = dynamics.derivative(T, external, projection)
        if dynamics.damping is None:
            return self._explicit.step(smooth, q, y, h)

        def rate(p: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            v, y_dot = smooth(p, x)
            y_dot[-1] -= (linear.inverse @ x[:r]).dot(linear.inverse @ y_dot[:r])
            return v, y_dot

        start = y.copy()
        start[-1] -= _half_square(linear.inverse @ y[:r])
        q, end = self._integrator.step(rate, linear, q, start, h)
        end[-1] += _half_square(linear.inverse @ end[:r])
        return q, end

    def _linear(self, state: StateEvaluation, T: np.ndarray) -> tuple[LinearPart, np.ndarray]:
        """Linear part of the motion at a state, and accelerations (r,) without dry friction."""
        dynamics = self._dynamics
        R, H, damping = state.R, state.H, dynamics.damping
        if damping is None:
            modes = scipy.linalg.solve_triangular(np.linalg.cholesky(H), np.eye(len(H)), lower=True).T
            decay = np.zeros(len(H))
        else:
            decay, modes = scipy.linalg.eigh(R.T @ (damping[:, None] * R), H)
            decay = np.maximum(decay, 0.0)
        inverse = modes.T @ H
        flow = state.flow(T, damping)
        if damping is None:
            rows = dynamics.integral_rows(state)
            others = np.zeros((1 + len(rows) + dynamics.reduced.rheonomic, len(H)))
            return LinearPart(modes, inverse, decay, R @ modes, others), flow.v2_dot
        force = state.B @ T - damping * state.v
        others = np.vstack(
            [
                dynamics.integral_rows(state) @ R @ modes,
                np.zeros((int(dynamics.reduced.rheonomic), len(H))),  # time flows at a constant rate
                modes.T @ apply_transposed(R, force) - inverse @ flow.v2_dot,  # power minus the rate of kinetic energy
            ]
        )
        return LinearPart(modes, inverse, decay, R @ modes, others), flow.v2_dot


def _half_square(a: np.ndarray) -> float:
    return 0.5 * float(a.dot(a))
