"""Coulomb friction with stiction: forces that leave the least kinetic energy at the end of a step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, lsq_linear

from rnc_pin.errors import ConstraintError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.simulation.exponential_runge_kutta import LinearPart, phi_functions

_AT_REST = 1e-9  # speed that counts as rest, as a share of what friction takes away in the step
_RANK = 1e-12


class FrictionForces(NamedTuple):
    """Friction during a step, one entry for each row (k,).

    Attributes:
        forces: constant during the step [N or N m].
        sticking: rows that do not move at the end of the step.
        speeds: at its start [m/s or rad/s].
        stops: time after which a row that moves comes to rest; infinite where it does not [s].
    """

    forces: np.ndarray
    sticking: np.ndarray
    speeds: np.ndarray
    stops: np.ndarray

    @property
    def resting(self) -> np.ndarray:
        """Rows that stick from the start on."""
        return self.sticking & np.isinf(self.stops)


class DryFriction:
    """Friction that acts along rows of velocities: joints, and actuators.

    A force f of a row with speed s has ``|f| <= limit``, and ``f = -limit sign(s)`` while the row moves. Of the forces
    within their limits those act that leave the least kinetic energy at the end of a step. That is the solution of the
    complementarity problem of stick and slip at the level of velocities, for rows that constraints couple as well.

    Args:
        reduced: the model.
        joints: whether joints have the friction of the robot's file.

    Raises:
        ConstraintError: friction would act on a momentum that is said to be conserved.
    """

    def __init__(self, reduced: ReducedModel, joints: bool) -> None:
        limits = np.array(reduced.robot.model.upperDryFrictionLimit) if joints else np.zeros(reduced.n)
        for block, *_ in reduced.constraints.places:
            if block.conserved is not None and limits[block.conserved].any():
                raise ConstraintError(f"joint friction acts on {block.names[0]}, which is said to be conserved")
        self._joints = np.flatnonzero(limits > 0)
        self._rows = np.eye(reduced.n)[self._joints]
        self._limits, self._p = limits[self._joints], reduced.p
        self.limits = self._limits
        self._actuators = False

    def set_actuators(self, limit: float) -> None:
        """Let friction of this size work against every actuator [N or N m]."""
        self._actuators = limit > 0
        self.limits = np.concatenate([self._limits, np.full(self._p, limit)]) if self._actuators else self._limits

    def rows(self, state: StateEvaluation) -> np.ndarray:
        """Rows (k, nv) that give the speeds."""
        return np.vstack([self._rows, state.B.T]) if self._actuators else self._rows

    def inputs(self, forces: np.ndarray) -> np.ndarray | float:
        """Of the forces (k,) those at the actuators, (p,)."""
        return forces[len(self._joints) :] if self._actuators else 0.0

    def external(self, forces: np.ndarray) -> np.ndarray | None:
        """Of the forces (k,) those at the joints, (nv,); None where there are none."""
        return forces[: len(self._joints)] @ self._rows if len(self._joints) else None

    def choose(self, state: StateEvaluation, w_dot: np.ndarray, linear: LinearPart, h: float) -> FrictionForces:
        """Forces during a step.

        Args:
            state: at its start.
            w_dot: accelerations of the chart's velocities without friction, (r,).
            linear: linear part of the motion.
            h: duration of the step [s].
        """
        rows, limits = self.rows(state), self.limits
        growth = phi_functions(-h * linear.decay, 1)[1]
        modes = (rows @ state.R @ linear.modes).T
        speeds = rows @ state.v
        bent = rows @ (state.v_dot(w_dot) - state.R @ w_dot)  # as rows turn against the chart
        free = speeds + h * (bent + modes.T @ (growth * (linear.inverse @ w_dot)))
        pushed = np.sqrt(growth)[:, None] * modes
        forces, sticking = _least_energy(pushed, free / h, limits)
        taken = h * (pushed * pushed).sum(axis=0) * limits
        at_rest = np.abs(speeds) <= _AT_REST * taken
        against = np.where(at_rest, forces, -limits * np.sign(speeds))
        a_dot = linear.inverse @ w_dot + modes @ against

        def later(t: float) -> np.ndarray:
            """Speeds after a time while rows slide."""
            return speeds + t * (bent + modes.T @ (phi_functions(-t * linear.decay, 1)[1] * a_dot))

        stops = np.where(~at_rest & sticking, h, np.inf)
        for row in np.flatnonzero(~at_rest & (speeds * later(h) < 0)):
            stops[row] = brentq(lambda t, row=row: later(t)[row], 0.0, h, rtol=_RANK)
        return FrictionForces(forces, sticking, speeds, stops)

    def stopped(self, state: StateEvaluation, which: np.ndarray) -> StateEvaluation:
        """The state after impulses that bring some rows (k,) to rest; others move as the inertia lets them."""
        if not which.any():
            return state
        R, rows = state.R, self.rows(state)[which]
        along = rows @ R
        moved = np.linalg.solve(state.H, along.T)
        impulse = np.linalg.lstsq(along @ moved, rows @ state.v, rcond=_RANK)[0]
        return state.with_velocity(state.v - R @ (moved @ impulse))


def _least_energy(pushed: np.ndarray, free: np.ndarray, limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces f (k,) within limits that minimise ``f^T P^T P f / 2 + f^T free``, and which are below their limits.

    Args:
        pushed: P, (r, k).
        free: (k,).
        limits: (k,), positive.
    """
    scaled = pushed * limits
    size = np.abs(scaled).max(initial=0.0)
    if not size > 0:
        return -limits * np.sign(free), np.zeros(len(limits), dtype=bool)
    scaled, wanted = scaled / size, free * limits / size**2
    shares = -np.sign(wanted)  # every row slides: right most of the time, and seen at a glance
    if not (shares * (scaled.T @ (scaled @ shares) + wanted) < 0).all():
        target, *_ = np.linalg.lstsq(scaled.T, wanted, rcond=_RANK)
        found = lsq_linear(scaled, -target, bounds=(-1.0, 1.0), method="bvls", tol=_RANK)
        return found.x * limits, found.active_mask == 0
    return shares * limits, np.zeros(len(limits), dtype=bool)
