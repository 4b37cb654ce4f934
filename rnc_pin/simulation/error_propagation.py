"""Propagation of the integration errors of a run along its motion, under the feedback of its controller.

The linearised error of a sampled loop obeys ``e <- Phi e + d``: Phi is the map of one sample, with the inputs that the
controller gives for the displaced state, and d is the error of the integration in that sample. Maps are taken at some
samples and hold for those around them. The plant's part is in closed form; the controller's is a difference.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.analysis import StateDerivatives, state_derivatives
from rnc_pin.control.controller import Controller, State
from rnc_pin.control.loop.options import input_of
from rnc_pin.control.whole_body.whole_body_program import WholeBodyProgram
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants import Plant, ReducedPlant
from rnc_pin.plants.reduced import IntegrationErrors
from rnc_pin.plants.reduced.constrained_dynamics import joint_rotations

MARKED = 16
"""Samples after which the sum of the errors is kept."""
_RARE = 8  # samples for each state and its displacements, after which the slope of the controller is taken again
_STEP = 1e-6  # displacement of a state [m, rad] or, relative to 1 + the largest velocity, [m/s, rad/s]
_TURN = 1e-7  # angle of the motion by which the rotation of moving frames is taken [rad or m]
_ORDER = 6  # of the series of the exponential
_SMALL = 0.5  # largest matrix whose exponential is a series
_TOGETHER = 512  # maps that are computed at once
_SWITCHES = "the active limits of the controller's program may change, and small differences decide when"
_LARGEST = 1e3  # error above which a linearised one means nothing


class ErrorMark(NamedTuple):
    """Errors of a run before a sample, and what its controller had there. Those of B runs have a leading axis.

    Attributes:
        sample: number of the sample.
        sum: sum of the errors (2 nv,) of all samples before.
        memory: state of the controller before the step; None where its slope is not taken.
        integrals: integrals of the reducing velocities (r,).
    """

    sample: int
    sum: Array
    memory: State
    integrals: Array

    def of_run(self, run: int) -> ErrorMark:
        """Return the mark of one of B runs, of which ``memory`` is a list."""
        return ErrorMark(self.sample, self.sum[run], self.memory[run], self.integrals[run])


class RunSamples(NamedTuple):
    """Samples of a run: times (N,), configurations (N, nq), velocities (N, nv) and applied inputs (N, p)."""

    t: Array
    q: Array
    v: Array
    T: Array

    def at(self, samples: Array) -> RunSamples:
        """Some of the samples."""
        return RunSamples(*(np.ascontiguousarray(each[samples]) for each in self))


def marked(sample: int) -> bool:
    """True if the sum of the errors is kept before a sample."""
    return sample % MARKED == 0


class ErrorHistory:
    """Errors of the integration along a run, and their propagation.

    Args:
        plant: plant of the run.
        reduced: model of the controller.
        controller: controller of the run.
        dt: sampling period [s].
        samples: expected number of samples.

    Attributes:
        at_the_end: errors at the end, if another one than the plant of the run has them.
        unknown: reason why the errors of this run are not known; empty if they are.
        propagates: True if the errors of the plant can be propagated: it has no dry friction, and its contacts do
            not switch.
    """

    def __init__(self, plant: Plant, reduced: ReducedModel, controller: Controller, dt: float, samples: int) -> None:
        self._plant, self._reduced, self._controller, self._dt = plant, reduced, controller, dt
        self._marks: list[ErrorMark] = []
        self.at_the_end: IntegrationErrors | None = None
        self.propagates = isinstance(plant, ReducedPlant) and not plant.rubs
        states = plant.reduced.n + plant.reduced.r if isinstance(plant, ReducedPlant) else 0
        self._period = MARKED * -(-_RARE * (states + 1) // MARKED)
        self.unknown = _SWITCHES if _switches(controller) else ""
        self.propagates = self.propagates and not self.unknown
        self._first = min(self._period, samples) // (2 * MARKED) * MARKED

    def sees(self, sample: int) -> bool:
        """True if the slope of the controller is taken at a sample."""
        return sample % self._period == self._first

    def mark(self, sample: int, memory: State, integrals: Array) -> None:
        """Keep the errors before a sample if they are due; arguments as of an ``ErrorMark``."""
        if self.propagates and marked(sample):
            plant = cast(ReducedPlant, self._plant)
            self.keep(ErrorMark(sample, plant.errors.sum, memory if self.sees(sample) else None, integrals))

    def keep(self, mark: ErrorMark) -> None:
        """Add a mark that somebody else made."""
        self._marks.append(mark)

    def largest(self, motion: RunSamples, errors: IntegrationErrors) -> Array | None:
        """Return the largest errors (2 nv,) of a run, as absolute values; None if they cannot be propagated.

        Args:
            motion: samples of the run.
            errors: errors at the end of the run.
        """
        samples, seen = len(motion.t) - 1, [each for each in self._marks if self.sees(each.sample)]
        if samples < 1 or not seen or not self.propagates:
            return None
        stride = max(1, MARKED // max(errors.most, errors.enough))
        starts = np.arange(0, samples, stride)
        ends, middles = np.minimum(starts + stride, samples), np.minimum(starts + stride // 2, samples)
        marks = np.minimum(np.r_[[each.sample for each in self._marks], samples], samples)
        sums = np.array([*(each.sum for each in self._marks), errors.sum])
        whole = np.array([np.interp(np.r_[0, ends], marks, column) for column in sums.T]).T
        nearest = np.abs(starts[:, None] - [each.sample for each in seen]).argmin(axis=1)
        try:
            there, parts = motion.at(np.array([each.sample for each in seen])), []
            gains = np.array([self._feedback(motion, each) for each in seen])
            turned = self._turned(there, gains)
            # A gain is constant in the axes of the body, of a motor for example, or in those of the world.
            if len(gains) > 1 and np.abs(np.diff(turned, axis=0)).sum() < np.abs(np.diff(gains, axis=0)).sum():
                gains = self._turned(motion.at(middles), turned[nearest], back=True)
            else:
                gains = gains[nearest]
            now = np.r_[np.zeros(gains.shape[-1]), 1.0]
            added, lengths = np.diff(whole, axis=0), ends - starts
            for part in (slice(start, start + _TOGETHER) for start in range(0, len(starts), _TOGETHER)):
                found, now = self._propagated(motion.at(middles[part]), (added[part], lengths[part], gains[part]), now)
                parts.append(found)
        except Exception:  # a controller may refuse a displaced state; the run itself is complete
            return None
        largest = np.max(parts, axis=0)
        return largest if np.isfinite(largest).all() else None

    def _propagated(self, motion: RunSamples, blocks: tuple[Array, Array, Array], now: Array) -> tuple[Array, Array]:
        """Largest errors (2 nv,) after N blocks of samples, and ``[e, 1]`` at the end.

        Args:
            motion: one sample of each block.
            blocks: errors (N, 2 nv) that each adds, numbers of samples (N,), and slopes of inputs (N, p, nv + r).
            now: error e and 1 at the start, (nv + r + 1,).
        """
        added, lengths, gains = blocks
        model, nv, slopes = self._model, self._model.n, self._slopes(motion)
        M, G = _system(model, motion, slopes, cast(ReducedPlant, self._plant).damping)
        n, p = M.shape[-1], G.shape[-1]
        held = np.zeros((len(M), n + p, n + p))
        held[:, :n, :n], held[:, :n, n:] = M * self._dt, G * self._dt
        held = _exponential(held)
        maps, R = np.zeros((len(M), n + 1, n + 1)), slopes.v_v2
        maps[:, :n, :n] = held[:, :n, :n] + held[:, :n, n:] @ gains
        Q = joint_rotations(model.robot.model, motion.q).mT
        each = np.concatenate([apply(Q, added[:, :nv]), apply(Q, added[:, nv:])], axis=1) / lengths[:, None]
        maps[:, :nv, n] = each[:, :nv]
        maps[:, nv:n, n] = np.linalg.solve(R.mT @ R, R.mT @ each[:, nv:, None])[..., 0]
        maps[:, n, n] = 1.0
        last = np.linalg.matrix_power(maps[-1], int(lengths[-1]))
        maps = np.linalg.matrix_power(maps, int(lengths[0]))
        maps[-1] = last
        errors = np.empty((len(maps), n))
        for error, one in zip(errors, maps, strict=True):
            now = one @ now
            now[:n] = np.clip(now[:n], -_LARGEST, _LARGEST)
            error[:] = now[:n]
        velocities = apply(slopes.v_q, errors[:, :nv]) + apply(R, errors[:, nv:])
        return np.abs(np.concatenate([errors[:, :nv], velocities], axis=1)).max(axis=0), now

    def _turned(self, motion: RunSamples, gains: Array, back: bool = False) -> Array:
        """Slopes (N, p, nv + r) of inputs by velocities along the axes of the world, or ``back`` along those of joints.

        The part of the velocities is that of v: its rows are in the span of R.
        """
        model, nv = self._model, self._model.n
        R = model.at(motion.q, v=motion.v, t=motion.t if model.rheonomic else None).R
        Q = joint_rotations(model.robot.model, motion.q)
        of_q, of_v = gains[..., :nv], gains[..., nv:]
        if back:
            return np.concatenate([of_q @ Q, of_v @ Q @ R], axis=-1)
        of_v = of_v @ np.linalg.solve(R.mT @ R, R.mT)
        return np.concatenate([of_q @ Q.mT, of_v @ Q.mT], axis=-1)

    @property
    def _model(self) -> ReducedModel:
        return cast(ReducedPlant, self._plant).reduced

    def _slopes(self, motion: RunSamples) -> StateDerivatives:
        model = self._model
        t = motion.t if model.rheonomic else None
        return state_derivatives(model, motion.q, self._v2(motion), motion.T, t=t)

    def _v2(self, motion: RunSamples) -> Array:
        model = self._model
        return np.ascontiguousarray(model.at(motion.q, v=motion.v, t=motion.t if model.rheonomic else None).v2)

    def _feedback(self, motion: RunSamples, seen: ErrorMark) -> Array:
        """Slope (p, nv + r) of the inputs of the controller by the state of the plant at a sample."""
        own, plant, robot = motion.at(np.array([seen.sample])), self._model, self._model.robot.model
        t, q, v2 = float(own.t[0]), own.q[0], self._v2(own)[0]

        def inputs(q: Array, v2: Array) -> Array:
            state = self._reduced.at(q, v=plant.at(q, v2, t=t).v, t=t)
            command, _ = self._controller.step(t, state.measure(seen.integrals), seen.memory)
            return cast(ReducedPlant, self._plant).saturated(input_of(self._reduced, state, command))

        here, step = inputs(q, v2), _STEP * (1.0 + np.abs(v2).max(initial=0.0))
        moved = [inputs(pin.integrate(robot, q, _STEP * e), v2) - here for e in np.eye(plant.n)]
        faster = [inputs(q, v2 + step * e) - here for e in np.eye(plant.r)]
        columns = [*(each / _STEP for each in moved), *(each / step for each in faster)]
        return np.array(columns).T.reshape(plant.p, plant.n + plant.r)


def _switches(controller: object) -> bool:
    """True if a controller, or one within it, solves a program whose active limits may change."""
    while controller is not None and not isinstance(controller, WholeBodyProgram):
        controller = getattr(controller, "target", None)
    return controller is not None


def _system(
    model: ReducedModel, motion: RunSamples, slopes: StateDerivatives, damping: Array | None
) -> tuple[Array, Array]:
    """Matrices of ``e_dot = M e + G dT`` at N states, with the error e of the configuration and of v2."""
    nv, r = model.n, model.r
    M = np.zeros((len(motion.q), nv + r, nv + r))
    M[:, :nv, :nv], M[:, :nv, nv:] = slopes.v_q + _turning(model.robot.model, motion), slopes.v_v2
    M[:, nv:, :nv], M[:, nv:, nv:] = slopes.v2_dot_q, slopes.v2_dot_v2
    if damping is not None:
        H, R = model.at(motion.q, v=motion.v, t=motion.t if model.rheonomic else None).H, slopes.v_v2
        resisted = np.linalg.solve(H, R.mT * damping)
        M[:, nv:, :nv] -= resisted @ slopes.v_q
        M[:, nv:, nv:] -= resisted @ R
    G = np.concatenate([np.zeros((len(M), nv, model.p)), slopes.v2_dot_T], axis=1)
    return M, G


def _turning(model: pin.Model, motion: RunSamples) -> Array | float:
    """Rates (N, nv, nv) at which the axes of the tangent space turn with the motion; 0 if none do."""
    if model.nq == model.nv and not any("Planar" in joint.shortname() for joint in model.joints):
        return 0.0
    h = _TURN / (1.0 + np.abs(motion.v).max(initial=0.0))
    each = [pin.dIntegrate(model, q, h * v, pin.ArgumentPosition.ARG0) for q, v in zip(motion.q, motion.v, strict=True)]
    return np.asarray((np.array(each) - np.eye(model.nv)) / h)


def _exponential(X: Array) -> Array:
    """Exponentials of matrices (N, n, n). SciPy's take them one by one, in three to seven times the time."""
    size = np.abs(X).sum(axis=-1).max(initial=0.0)
    halvings = max(0, int(np.ceil(np.log2(size / _SMALL)))) if 0.0 < size < np.inf else 0
    X, eye = X / 2.0**halvings, np.eye(X.shape[-1])
    found = eye + X / _ORDER
    for order in range(_ORDER - 1, 0, -1):
        found = eye + X @ found / order
    for _ in range(halvings):
        found = found @ found
    return np.asarray(found)
