"""Viscous damping and dry friction of a plant: friction forces with stiction, and integration steps with both.

Coulomb friction with stiction minimizes the kinetic energy at the end of a step.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
import scipy
from numpy import ndarray as Array

from rnc_pin.math.linear_algebra import apply_transposed
from rnc_pin.model.integrators import ExponentialRungeKutta4, LieRungeKutta4, LinearPart, phi_functions
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.constrained_dynamics import ConstrainedDynamics, check_conserved

_RANK = 1e-12  # relative singular value, or relative error of a time, that is rounding

INSTANT = 1e-6
"""Horizon for instantaneous friction forces [s]."""


class FrictionForces(NamedTuple):
    """Friction during a step, one entry per row (k,).

    Attributes:
        forces: friction forces, constant during the step [N or N m].
        sticking: True for rows at rest at the end of the step.
        speeds: speeds at the start of the step [m/s or rad/s].
        stops: time at which a moving row comes to rest [s]; infinite if it does not.
    """

    forces: Array
    sticking: Array
    speeds: Array
    stops: Array

    @property
    def resting(self) -> Array:
        """True for rows (k,) that stick during the whole step."""
        return self.sticking & np.isinf(self.stops)


class DryFriction:
    """Dry friction in joints, along the rows of their velocities.

    A force f of a row with speed s has ``|f| <= limit``, and ``f = -limit sign(s)`` while the row moves. The forces
    minimize the kinetic energy at the end of a step, within these limits. They solve the stick-slip complementarity
    problem at velocity level, also for rows that constraints couple.

    Args:
        reduced: reduced model.
        joints: True for the joint friction of the robot's file.

    Raises:
        ConstraintError: friction acts on a momentum that the model declares conserved.
    """

    def __init__(self, reduced: ReducedModel, joints: bool) -> None:
        # Pinocchio has the friction of a file in the upper limit.
        limits = np.array(reduced.robot.model.upperDryFrictionLimit) if joints else np.zeros(reduced.n)
        check_conserved(reduced, limits, "joint friction")
        joints_with_friction = np.flatnonzero(limits > 0)
        self.rows = np.eye(reduced.n)[joints_with_friction]
        self.entries = joints_with_friction.astype(float)
        self.limits = limits[joints_with_friction]

    def forces_in_step(self, state: StateEvaluation, w_dot: Array, linear: LinearPart, h: float) -> FrictionForces:
        """Compute friction forces for a step.

        Args:
            state: state at the start of the step.
            w_dot: accelerations of the chart's velocities without friction, (r,).
            linear: linear part of the motion.
            h: duration of the step [s].
        """
        rows, limits = self.rows, self.limits
        # The mean effect of a constant force over a step in which damping decays: stiff damping cannot overshoot.
        growth = phi_functions(-h * linear.decay, 1)[1]
        modes = (rows @ state.R @ linear.modes).T
        speeds = rows @ state.v
        bias = rows @ (state.v_dot(w_dot) - state.R @ w_dot)  # the rows rotate relative to the chart
        free = speeds + h * (bias + modes.T @ (growth * (linear.inverse @ w_dot)))
        basis = np.sqrt(growth)[:, None] * modes
        forces, sticking = _least_energy(basis, free / h, limits)
        # A force at its limit, alone, removes this speed in the step.
        removable = h * (basis * basis).sum(axis=0) * limits
        # Speed that counts as rest, relative to the speed that friction removes in the step.
        rest = 1e-9
        at_rest = np.abs(speeds) <= rest * removable
        a_dot = linear.inverse @ w_dot + modes @ np.where(at_rest, forces, -limits * np.sign(speeds))

        def speeds_at(t: float) -> Array:
            """Speeds (k,) after a time t while rows slide."""
            return speeds + t * (bias + modes.T @ (phi_functions(-t * linear.decay, 1)[1] * a_dot))

        stops = np.where(~at_rest & sticking, h, np.inf)
        for row in np.flatnonzero(~at_rest & (speeds * speeds_at(h) < 0)):
            # The speed decays along exponentials, so that its zero has no closed form.
            stops[row] = scipy.optimize.brentq(lambda t, row=row: speeds_at(t)[row], 0.0, h, rtol=_RANK)
        return FrictionForces(forces, sticking, speeds, stops)

    def stopped(self, state: StateEvaluation, which: Array) -> StateEvaluation:
        """Return the state after impulses that stop the selected rows (k,); the inertia determines the other rows.

        Args:
            state: state before the impulses.
            which: True (k,) for the rows to stop.
        """
        # The state itself: callers tell by it that nothing has stopped.
        if not which.any():
            return state
        R, rows = state.R, self.rows[which]
        along = rows @ R
        # Columns H^-1 R^T d of the rows d: how the reducing velocities answer a unit impulse on each.
        moved = np.linalg.solve(state.H, along.T)
        together, speeds = along @ moved, rows @ state.v
        factor, impulse, failed = scipy.linalg.lapack.dposv(together, speeds)
        pivots = factor.diagonal()
        least_ratio = 1e-4  # of pivots of the root of the matrix, 1e-8 of the matrix: rows below may be coupled
        if failed or not pivots.min() > least_ratio * pivots.max():  # rows that the constraints couple
            impulse = np.linalg.lstsq(together, speeds, rcond=_RANK)[0]
        return StateEvaluation(state, v=state.v - R @ (moved @ impulse))


def _least_energy(basis: Array, free: Array, limits: Array) -> tuple[Array, Array]:
    """Forces f (k,) within limits that minimize ``f^T P^T P f / 2 + f^T free``, and a mask of forces below limits.

    Args:
        basis: matrix P (r, k).
        free: linear coefficients (k,).
        limits: largest forces (k,), positive.
    """
    scaled = basis * limits
    size = np.abs(scaled).max(initial=0.0)
    # Nothing that the rows may move: each force opposes its own speed alone.
    if not size > 0:
        return -limits * np.sign(free), np.zeros(len(limits), dtype=bool)
    # Sizes of one: the solver's tolerances are absolute.
    scaled, wanted = scaled / size, free * limits / size**2
    # P^T target = free turns the energy into a sum of squares, which lsq_linear bounds.
    target, *_ = np.linalg.lstsq(scaled.T, wanted, rcond=_RANK)
    # BVLS ends at an exact set of active bounds: rows at their limit slide, the others stick.
    found = scipy.optimize.lsq_linear(scaled, -target, bounds=(-1.0, 1.0), method="bvls", tol=_RANK)
    return found.x * limits, found.active_mask == 0


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
        # Damping and friction as the kernel takes them, of one run.
        self._losses = dynamics.damping, friction.entries, friction.limits[None]
        self._explicit = LieRungeKutta4(dynamics.reduced.robot)
        self._integrator = ExponentialRungeKutta4(dynamics.reduced.robot)

    def compiled(
        self, q: Array, y: Array, T: Array, h: float, steps: int, end: Array
    ) -> tuple[Array, Array, float] | None:
        """Result of ``advance`` by the kernel; None for rows of a user, and for steps that leave the chart.

        Args:
            q, y, T, h, steps: as for ``advance``.
            end: array for the state y at the end; of no steps, for the generalized forces (nv,) of dry friction.
        """
        by = self._dynamics.chart.evaluator
        if by.data.rheonomic:
            return None
        q_end, status, roughness = np.empty_like(q), np.zeros(1), np.empty(1)
        by.calls.integrate((by.calls,), q, y, T, h, steps, None, q_end, end, status, roughness, None, *self._losses)
        return (q_end, end, float(roughness[0])) if status[0] == 1.0 else None

    def friction_force(self, q: Array, y: Array, T: Array) -> Array:
        """Generalized forces (nv,) of dry friction at a state.

        Args:
            q: configuration (nq,).
            y: state of the integrator.
            T: actuator inputs (p,).
        """
        found = self.compiled(q, y, T, INSTANT, 0, np.empty(self._dynamics.reduced.n))
        if found is not None:
            return found[1]
        state = self._dynamics.at(q, y)
        linear, w_dot = self._linear(state, T)
        friction = self.friction.forces_in_step(state, w_dot, linear, INSTANT)
        return friction.forces @ self.friction.rows

    def advance(self, q: Array, y: Array, T: Array, h: float, steps: int) -> tuple[Array, Array, float]:
        """Return the state after equal steps of a time h under inputs T, and the roughness; infinite at a stop.

        Args:
            q: configuration (nq,).
            y: state of the integrator.
            T: actuator inputs (p,), constant during the steps.
            h: duration of each step [s].
            steps: number of steps.

        Raises:
            DivergenceError: velocities or accelerations are not finite.
        """
        found = self.compiled(q, y, T, h, steps, np.empty_like(y))
        if found is not None:
            return found
        roughness = 0.0
        for _ in range(steps):
            q, y, rough = self._step(q, y, T, h)
            roughness += rough
        return q, y, roughness

    def _step(self, q: Array, y: Array, T: Array, h: float) -> tuple[Array, Array, float]:
        """State after one step, and the roughness, by NumPy."""
        limits = self.friction.limits
        # A bound of two stops a row: the rest of the step then has no more events.
        events, remaining, roughness = 2 * len(limits), h, 0.0
        short = 1e-6  # time to rest below which a row counts as stopped, relative to the step
        while True:
            state = self._dynamics.at(q, y)
            linear, w_dot = self._linear(state, T)
            friction = self.friction.forces_in_step(state, w_dot, linear, remaining)
            first = float(friction.stops.min(initial=np.inf))
            if events and remaining <= first < np.inf:  # a row comes to rest at the end of the step
                y = self._stopped(state, y, friction.resting)
                q, y, _ = self._smooth(q, y, T, self._sliding_forces(friction), friction.resting, linear, remaining)
                return q, self._stopped(self._dynamics.at(q, y), y, friction.sticking), np.inf
            if events == 0 or first >= remaining:
                y = self._stopped(state, y, friction.sticking)
                q, y, rough = self._smooth(q, y, T, friction.forces, friction.sticking, linear, remaining)
                return q, y, roughness + rough
            events, roughness = events - 1, np.inf
            stopping = friction.stops <= (1.0 + short) * first
            if first < short * h:
                y = self._stopped(state, y, friction.resting | stopping)
                continue
            # Up to the first stop no row changes between sliding and sticking, so the step is smooth.
            q, y, _ = self._smooth(q, y, T, self._sliding_forces(friction), friction.resting, linear, first)
            y = self._stopped(self._dynamics.at(q, y), y, friction.resting | stopping)
            remaining -= first

    def _sliding_forces(self, friction: FrictionForces) -> Array:
        """Friction forces (k,) until the first row comes to rest."""
        return np.where(np.isinf(friction.stops), friction.forces, -self.friction.limits * np.sign(friction.speeds))

    def _stopped(self, state: StateEvaluation, y: Array, which: Array) -> Array:
        """Return y with the selected rows (k,) at rest. The lost kinetic energy is work of friction."""
        after = self.friction.stopped(state, which)
        if after is state:
            return y
        y = y.copy()
        y[: len(after.v2)] = after.v2
        # Impulses of friction do negative work: the energy balance of a run stays closed.
        y[-1] += after.kinetic_energy - state.kinetic_energy
        return y

    def _smooth(
        self, q: Array, y: Array, T: Array, forces: Array, sticking: Array, linear: LinearPart, h: float
    ) -> tuple[Array, Array, float]:
        """Integrate one step without events, with constant friction forces (k,) and rows (k,) that stick.

        The integrator uses work minus the kinetic energy ``|a|^2 / 2`` of the frozen inertia. Damping cancels in that
        difference; otherwise the integral of work would contain decays faster than the step.
        """
        r, dynamics = len(linear.decay), self._dynamics
        external = forces @ self.friction.rows if len(forces) else None
        stopped = partial(self.friction.stopped, which=sticking) if sticking.any() else None
        # No friction acts in this step: the compiled step of the plant without it does.
        if stopped is None and external is None and dynamics.damping is None:
            return dynamics.advance(q, y, T, h, 1)
        smooth = dynamics.derivative(T, external, stopped)
        if dynamics.damping is None:
            q, end, roughness = self._explicit.measured_step(smooth, q, y, h, r)
            return q, self._stopped(dynamics.at(q, end), end, sticking), roughness

        def rate(p: Array, x: Array) -> tuple[Array, Array]:
            v, y_dot = smooth(p, x)
            y_dot[-1] -= (linear.inverse @ x[:r]).dot(linear.inverse @ y_dot[:r])
            return v, y_dot

        start = y.copy()
        start[-1] -= _half_square(linear.inverse @ y[:r])
        q, end, roughness = self._integrator.step(rate, linear, q, start, h)
        end[-1] += _half_square(linear.inverse @ end[:r])
        return q, self._stopped(dynamics.at(q, end), end, sticking), roughness

    def _linear(self, state: StateEvaluation, T: Array) -> tuple[LinearPart, Array]:
        """Linear part of the motion at a state, and accelerations (r,) without dry friction."""
        dynamics = self._dynamics
        R, H, damping = state.R, state.H, dynamics.damping
        flow = state.flow(T, damping)
        if damping is None:
            # Modes with unit inertia; without damping any such basis does, and Cholesky is the cheapest.
            modes = np.linalg.inv(np.linalg.cholesky(H)).T
            others = np.zeros((dynamics.integrands.size + dynamics.reduced.rheonomic + 1, len(H)))
            return LinearPart(modes, modes.T @ H, np.zeros(len(H)), R @ modes, others), flow.v2_dot
        decay, modes = scipy.linalg.eigh(R.T @ (damping[:, None] * R), H)
        # Rounding of an undamped mode would let it grow.
        decay = np.maximum(decay, 0.0)
        inverse = modes.T @ H
        integrals = dynamics.integrands.jacobian(state.position) @ R @ modes
        time = np.zeros((int(dynamics.reduced.rheonomic), len(H)))  # it flows at a constant rate
        force = state.B @ T - damping * state.v
        power = modes.T @ apply_transposed(R, force) - inverse @ flow.v2_dot  # minus the rate of kinetic energy
        others = np.vstack([integrals, time, power])
        return LinearPart(modes, inverse, decay, R @ modes, others), flow.v2_dot


def _half_square(a: Array) -> float:
    return 0.5 * float(a.dot(a))
