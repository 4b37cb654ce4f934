"""Coulomb friction with stiction: forces that minimize the kinetic energy at the end of a step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from rnc_pin.integrators import LinearPart, phi_functions
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.reduced.constrained_dynamics import check_conserved

_AT_REST = 1e-9  # speed that counts as rest, relative to the speed that friction removes in the step
_RANK = 1e-12


class FrictionForces(NamedTuple):
    """Friction during a step, one entry per row (k,).

    Attributes:
        forces: friction forces, constant during the step [N or N m].
        sticking: True for rows at rest at the end of the step.
        speeds: speeds at the start of the step [m/s or rad/s].
        stops: time at which a moving row comes to rest [s]; infinite if it does not.
    """

    forces: np.ndarray
    sticking: np.ndarray
    speeds: np.ndarray
    stops: np.ndarray

    @property
    def resting(self) -> np.ndarray:
        """True for rows (k,) that stick during the whole step."""
        return self.sticking & np.isinf(self.stops)


class DryFriction:
    """Dry friction along velocity rows: joints and actuators.

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
        limits = np.array(reduced.robot.model.upperDryFrictionLimit) if joints else np.zeros(reduced.n)
        check_conserved(reduced, limits, "joint friction")
        self._joints = np.flatnonzero(limits > 0)
        self._rows = np.eye(reduced.n)[self._joints]
        self._limits, self._p = limits[self._joints], reduced.p
        self.limits = self._limits
        self._actuators = False

    def set_actuators(self, limit: float) -> None:
        """Set the dry friction limit of every actuator [N or N m]."""
        self._actuators = limit > 0
        self.limits = np.concatenate([self._limits, np.full(self._p, limit)]) if self._actuators else self._limits

    def rows(self, state: StateEvaluation) -> np.ndarray:
        """Jacobian (k, nv) of the speeds."""
        return np.vstack([self._rows, state.B.T]) if self._actuators else self._rows

    def inputs(self, forces: np.ndarray) -> np.ndarray | float:
        """Actuator part (p,) of the forces (k,)."""
        return forces[len(self._joints) :] if self._actuators else 0.0

    def external(self, forces: np.ndarray) -> np.ndarray | None:
        """Generalized joint forces (nv,) of the forces (k,); None without joint friction."""
        return forces[: len(self._joints)] @ self._rows if len(self._joints) else None

    def forces_in_step(self, state: StateEvaluation, w_dot: np.ndarray, linear: LinearPart, h: float) -> FrictionForces:
        """Compute friction forces for a step.

        Args:
            state: state at the start of the step.
            w_dot: accelerations of the chart's velocities without friction, (r,).
            linear: linear part of the motion.
            h: duration of the step [s].
        """
        rows, limits = self.rows(state), self.limits
        growth = phi_functions(-h * linear.decay, 1)[1]
        modes = (rows @ state.R @ linear.modes).T
        speeds = rows @ state.v
        bias = rows @ (state.v_dot(w_dot) - state.R @ w_dot)  # the rows rotate relative to the chart
        free = speeds + h * (bias + modes.T @ (growth * (linear.inverse @ w_dot)))
        basis = np.sqrt(growth)[:, None] * modes
        forces, sticking = _least_energy(basis, free / h, limits)
        removable = h * (basis * basis).sum(axis=0) * limits
        at_rest = np.abs(speeds) <= _AT_REST * removable
        opposing = np.where(at_rest, forces, -limits * np.sign(speeds))
        a_dot = linear.inverse @ w_dot + modes @ opposing

        def speeds_at(t: float) -> np.ndarray:
            """Speeds (k,) after a time t while rows slide."""
            return speeds + t * (bias + modes.T @ (phi_functions(-t * linear.decay, 1)[1] * a_dot))

        stops = np.where(~at_rest & sticking, h, np.inf)
        for row in np.flatnonzero(~at_rest & (speeds * speeds_at(h) < 0)):
            stops[row] = scipy.optimize.brentq(lambda t, row=row: speeds_at(t)[row], 0.0, h, rtol=_RANK)
        return FrictionForces(forces, sticking, speeds, stops)

    def stopped(self, state: StateEvaluation, which: np.ndarray) -> StateEvaluation:
        """Return the state after impulses that stop the selected rows (k,); the inertia determines the other rows."""
        if not which.any():
            return state
        R, rows = state.R, self.rows(state)[which]
        along = rows @ R
        moved = np.linalg.solve(state.H, along.T)
        impulse = np.linalg.lstsq(along @ moved, rows @ state.v, rcond=_RANK)[0]
        return state.with_velocity(state.v - R @ (moved @ impulse))


def _least_energy(basis: np.ndarray, free: np.ndarray, limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces f (k,) within limits that minimize ``f^T P^T P f / 2 + f^T free``, and a mask of those below their limits.

    Args:
        basis: matrix P (r, k).
        free: linear coefficients (k,).
        limits: largest forces (k,), positive.
    """
    scaled = basis * limits
    size = np.abs(scaled).max(initial=0.0)
    if not size > 0:
        return -limits * np.sign(free), np.zeros(len(limits), dtype=bool)
    scaled, wanted = scaled / size, free * limits / size**2
    shares = -np.sign(wanted)  # first guess: every row slides
    if not (shares * (scaled.T @ (scaled @ shares) + wanted) < 0).all():
        target, *_ = np.linalg.lstsq(scaled.T, wanted, rcond=_RANK)
        found = scipy.optimize.lsq_linear(scaled, -target, bounds=(-1.0, 1.0), method="bvls", tol=_RANK)
        return found.x * limits, found.active_mask == 0
    return shares * limits, np.zeros(len(limits), dtype=bool)
