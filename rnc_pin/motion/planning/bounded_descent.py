"""Levenberg-Marquardt descent on a configuration manifold, with equalities and bounds."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.robots.joint_values import NO_LIMIT

_STEPS = 150
_LONGEST = 1.0  # largest step [rad or m]
_EXACT = 1e-13  # error at which the descent stops
_STATIONARY = 1e-10  # largest gradient of a minimum, and largest motion to a bound
_DAMPING, _LEAST, _MOST = 0.5, 1e-10, 1e6  # damping over the square of the error, and its limits
_STALLS = 8  # number of stalled steps that end a descent
_ROUNDING = 1e-14  # relative change of the squared error that rounding hides
_BOLDEST = 1e-4  # smallest factor of the damping
_DEPENDENT = 1e-9
_AT_LIMIT = 1e-9


class Residuals(NamedTuple):
    """Linearized problem at a configuration: ``J dq = e`` in the least-squares sense, ``H dq = -h`` exactly."""

    e: np.ndarray
    """Error (k,) to minimize."""
    J: np.ndarray
    """Jacobian (k, nv) of ``-e``."""
    h: np.ndarray
    """Residual (c,) of the equalities."""
    H: np.ndarray
    """Jacobian (c, nv) of h."""


class Descent(NamedTuple):
    """Result of a descent."""

    q: np.ndarray
    error: float
    """Length of e."""
    residual: float
    """Largest entry of h."""
    steps: int


class TangentBounds:
    """Position limits of joints in tangent coordinates.

    Args:
        model: Pinocchio model.
        lower, upper: limits (nq,); entries beyond ``NO_LIMIT`` are none.
        held: mask (nv,) of entries that do not move.
    """

    def __init__(self, model: pin.Model, lower: np.ndarray, upper: np.ndarray, held: np.ndarray) -> None:
        self.model, self.held = model, held
        entries = [
            (joint.idx_q + k, joint.idx_v + k)
            for joint in list(model.joints)[1:]
            if joint.nq == joint.nv
            for k in range(joint.nv)
        ]
        bounded = [
            (iq, iv) for iq, iv in entries if lower[iq] < upper[iq] and (lower[iq] > -NO_LIMIT or upper[iq] < NO_LIMIT)
        ]
        self.q_index = np.array([iq for iq, _ in bounded], dtype=int)
        self.v_index = np.array([iv for _, iv in bounded], dtype=int)
        self.lower, self.upper = lower[self.q_index], upper[self.q_index]

    def clip(self, q: np.ndarray) -> np.ndarray:
        """Return q with all entries within the limits; held entries too."""
        clipped = q.copy()
        clipped[self.q_index] = np.clip(q[self.q_index], self.lower, self.upper)
        return clipped

    def room(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the largest steps (nv,) down and up; zero for held entries."""
        low, high = np.full(self.model.nv, -np.inf), np.full(self.model.nv, np.inf)
        low[self.v_index], high[self.v_index] = self.lower - q[self.q_index], self.upper - q[self.q_index]
        low[self.held] = high[self.held] = 0.0
        return np.minimum(low, 0.0), np.maximum(high, 0.0)


def descend(
    evaluate: Callable[[np.ndarray], Residuals], bounds: TangentBounds, q: np.ndarray, progress: float = 1e-6
) -> Descent:
    """Minimize ``|e|`` subject to ``h = 0`` and the bounds, from a configuration (nq,) within the bounds.

    The damping starts as that of Sugihara ("Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt
    method", 2011): proportional to ``|e|^2``. So convergence is quadratic for reachable targets. Its factor grows after
    failed steps and shrinks after others. A step that meets bounds is solved again with these entries at their bounds;
    an entry that the gradient pulls back inside is free again.

    Args:
        evaluate: linearized problem at a configuration.
        bounds: position limits.
        q: start (nq,).
        progress: relative decrease of the squared error below which a step counts as stalled.
    """
    here, factor, stalls = evaluate(q), 1.0, 0
    steps = 0
    merit = _merit(here)
    while steps < _STEPS and merit > _EXACT**2 and stalls < _STALLS:
        steps += 1
        low, high = bounds.room(q)
        damping = factor * max(_DAMPING * float(here.e @ here.e), _LEAST)
        dq, gradient = _step(here, damping, low, high)
        if gradient < _STATIONARY and np.abs(here.h).max(initial=0.0) < _EXACT:
            break
        dq *= min(1.0, _LONGEST / max(float(np.abs(dq).max(initial=0.0)), 1e-300))
        ahead_q = bounds.clip(pin.integrate(bounds.model, q, dq))
        ahead = evaluate(ahead_q)
        after = _merit(ahead)
        if after <= (1.0 + _ROUNDING) * merit:  # near a minimum beyond reach, only the gradient still shows progress
            stalls = stalls + 1 if after > (1.0 - progress) * merit else 0
            q, here, merit, factor = ahead_q, ahead, after, max(factor / 4.0, _BOLDEST)
        else:
            stalls += 1
            factor *= 8.0
            if factor > _MOST:
                break
    return Descent(q, float(np.linalg.norm(here.e)), float(np.abs(here.h).max(initial=0.0)), steps)


def _merit(at: Residuals) -> float:
    """Return the square of the errors; equalities count more than targets."""
    return float(at.e @ at.e) + 100.0 * float(at.h @ at.h)


def _step(at: Residuals, damping: float, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the step (nv,) within the room, and the largest gradient along free directions or motion to a bound.

    Entries beyond their room stay at its end. One that the gradient pulls back inside is free again, in turn.
    """
    dq = np.zeros(len(low))
    movable = (high - low) > _AT_LIMIT
    free, released = movable, 0
    while True:
        fixed = ~free
        wanted = at.e - at.J[:, fixed] @ dq[fixed]
        found, gradient = _free_step(at.J[:, free], wanted, at.H[:, free], -at.h - at.H[:, fixed] @ dq[fixed], damping)
        dq[free] = found
        beyond = free & ((dq < low) | (dq > high))
        if beyond.any():
            dq[beyond] = np.clip(dq[beyond], low[beyond], high[beyond])
            free = free & ~beyond
            continue
        slope = _slope(at, damping, dq, free)
        inward = np.where(dq > low, -slope, slope)
        inward[free | ~movable] = 0.0
        if released == len(low) or inward.max(initial=0.0) <= _STATIONARY:
            return dq, max(gradient, np.abs(dq[fixed]).max(initial=0.0))
        released += 1
        free = free | (np.arange(len(low)) == np.argmax(inward))


def _slope(at: Residuals, damping: float, dq: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the descent direction (nv,) of the damped problem at a step, without what the equalities take."""
    slope = at.J.T @ (at.e - at.J @ dq) - damping * dq
    if len(at.H):
        slope = slope - at.H.T @ np.linalg.lstsq(at.H[:, free].T, slope[free], rcond=_DEPENDENT)[0]
    return np.asarray(slope)


def _free_step(J: np.ndarray, e: np.ndarray, H: np.ndarray, h: np.ndarray, damping: float) -> tuple[np.ndarray, float]:
    """Minimize ``|J x - e|^2 + damping |x|^2`` subject to ``H x = h``; return x and the largest projected gradient."""
    n = J.shape[1]
    if not n:
        return np.zeros(0), 0.0
    if not len(H):
        g = J.T @ e
        return np.linalg.solve(J.T @ J + damping * np.eye(n), g), float(np.abs(g).max())
    left, values, right = np.linalg.svd(H)
    rank = int((values > _DEPENDENT * max(values[0], 1e-300)).sum())
    first = right[:rank].T @ ((left[:, :rank].T @ h) / values[:rank])
    basis = right[rank:].T
    if not basis.shape[1]:
        return first, 0.0
    reduced = J @ basis
    g = reduced.T @ (e - J @ first)
    y = np.linalg.solve(reduced.T @ reduced + damping * np.eye(basis.shape[1]), g)
    return first + basis @ y, float(np.abs(g).max())
