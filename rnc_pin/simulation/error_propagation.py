"""Propagation of the integration errors of a run along its motion, under the feedback of its controller.

The linearised error of a sampled loop obeys ``e <- Phi e + d``: Phi is the map of one sample, with the inputs that the
controller gives for the displaced state, and d is the error of the integration in that sample. Both are taken at some
samples and hold for those around them. The plant's part of Phi is in closed form; the controller's is a difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple, cast

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.analysis import StateDerivatives, state_derivatives
from rnc_pin.control.controller import Controller, State, accepts_batches, part_with, stack_states
from rnc_pin.control.loop.options import input_of
from rnc_pin.control.whole_body.whole_body_program import program_of
from rnc_pin.errors import RncError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import Plant, ReducedPlant
from rnc_pin.plants.reduced import IntegrationErrors
from rnc_pin.plants.reduced.constrained_dynamics import VelocityChart, joint_rotations

MARKED = 32
"""Samples after which a mark is kept."""
_RARE = 8  # samples for each displacement of a state, after which the slope of the controller is taken again
_STEP = 1e-6  # displacement of a state [m, rad] or, relative to 1 + the largest velocity, [m/s, rad/s]
_TURN = 1e-7  # angle of the motion by which the rotation of moving frames is taken [rad or m]
_ORDER = 6  # of the series of the exponential
_SMALL = 0.5  # largest matrix whose exponential is a series
_TOGETHER = 512  # maps that are computed at once
_SWITCHES = "the active limits of the controller's program may change, and small differences decide when"
_REMEMBERS = "the controller damps by its own state, which a propagation along the motion does not change"
_SEARCHES = "the controller searches for another motion where its slope is taken, which is no feedback"
_RANK = 1e-4  # singular value, relative to the largest, below which an input does not depend on a direction
_LARGEST = 1e6  # error above which no motion is that of the linearisation


class ErrorMark(NamedTuple):
    """Chart of the plant and state of the controller before a sample of a run. Marks of B runs have a leading axis.

    Attributes:
        sample: number of the sample.
        chart: chart of the plant.
        memory: state of the controller before the step; None where its slope is not taken.
        integrals: integrals of the reducing velocities (r,).
    """

    sample: int
    chart: VelocityChart | Sequence[VelocityChart]
    memory: State
    integrals: Array

    def of_run(self, run: int) -> ErrorMark:
        """Return the mark of one of B runs."""
        return ErrorMark(self.sample, self.chart[run], self.memory[run], self.integrals[run])  # type: ignore[index]


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
    """True if a mark is kept before a sample."""
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
        steps: substeps of the plant before each sample.
        at_the_end: errors at the end, if another one than the plant of the run has them.
        unknown: reason why the errors of this run are not known; empty if they are.
        propagates: True if the errors of the plant can be propagated: it has no dry friction, and its contacts do
            not switch.
    """

    def __init__(self, plant: Plant, reduced: ReducedModel, controller: Controller, dt: float, samples: int) -> None:
        self._plant, self._reduced, self._controller, self._dt = cast(ReducedPlant, plant), reduced, controller, dt
        self._marks: list[ErrorMark] = []
        self.steps: list[int] = []
        self.at_the_end: IntegrationErrors | None = None
        self.propagates = isinstance(plant, ReducedPlant) and not plant.rubs
        states = plant.reduced.n + plant.reduced.r if isinstance(plant, ReducedPlant) else 0
        rare = _RARE if accepts_batches(controller) else 2 * _RARE
        self._period = MARKED * -(-rare * (states + 1) // MARKED)
        self.unknown = "" if program_of(controller) is None else _SWITCHES
        self.propagates = self.propagates and not self.unknown
        self._first = min(self._period, samples) // (2 * MARKED) * MARKED

    def sees(self, sample: int) -> bool:
        """True if the slope of the controller is taken at a sample."""
        return sample % self._period == self._first

    def mark(self, sample: int, memory: State, integrals: Array) -> None:
        """Keep the substeps before a sample, and a mark if it is due; arguments as of an ``ErrorMark``."""
        if self.propagates:
            self.steps.append(self._plant.errors.used)
            if marked(sample):
                self.keep(ErrorMark(sample, self._plant.chart, memory if self.sees(sample) else None, integrals))

    def keep(self, mark: ErrorMark) -> None:
        """Add a mark that somebody else made."""
        self._marks.append(mark)

    def largest(self, motion: RunSamples, errors: IntegrationErrors) -> Array | None:
        """Return the largest errors (2 nv,) of a run, as absolute values; None if they cannot be propagated.

        They are infinite if they grow until the linearisation means nothing.

        Args:
            motion: samples of the run.
            errors: errors at the end of the run.
        """
        samples, seen = len(motion.t) - 1, [each for each in self._marks if self.sees(each.sample)]
        if samples < 1 or not seen or not self.propagates:
            return None
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # of a motion that diverges
                return self._propagated(motion, errors, seen)
        except RncError:  # at a state that the motion itself does not reach
            return None

    def _propagated(self, motion: RunSamples, errors: IntegrationErrors, seen: Sequence[ErrorMark]) -> Array:
        """Largest errors (2 nv,) of a run, as ``largest``, with the slopes at the marks ``seen``."""
        samples, plant = len(motion.t) - 1, self._plant
        steps = np.array([*self.steps[1:], errors.used])[:samples]
        starts = _starts(steps if plant.substeps is None else np.maximum(steps, errors.enough))
        lengths = np.diff(starts, append=samples)
        middles = starts + lengths // 2
        gains, steps = self._gains(motion, seen, middles), steps[middles]
        charts = [cast(VelocityChart, self._marks[each].chart) for each in middles // MARKED]
        now, parts = np.r_[np.zeros(gains.shape[-1]), 1.0], []
        places = np.append(middles, samples)
        for part in (slice(start, start + _TOGETHER) for start in range(0, len(starts), _TOGETHER)):
            added = plant.local_errors(motion.at(middles[part]), steps[part], charts[part], self._dt)
            if not (np.isfinite(added).all() and np.isfinite(gains[part]).all()):
                raise _RefusalError
            own = motion.at(places[part.start : part.stop + 1])
            found, now = self._after_blocks(own, (added, lengths[part], gains[part]), now)
            parts.append(found)
        return np.asarray(np.max(parts, axis=0))

    def _gains(self, motion: RunSamples, seen: Sequence[ErrorMark], samples: Array) -> Array:
        """Slopes (N, p, nv + r) of the inputs at samples, by those that were seen."""
        at_seen, gains = np.array([each.sample for each in seen]), np.array([self._feedback(motion, x) for x in seen])
        nearest = np.abs(samples[:, None] - at_seen).argmin(axis=1)
        if len(gains) > 1 and gains.any():
            turned = self._turned(motion.at(at_seen), gains)
            # A gain is constant in the axes of the body, of a motor for example, or in those of the world.
            if np.abs(np.diff(turned, axis=0)).sum() < np.abs(np.diff(gains, axis=0)).sum():
                return self._turned(motion.at(samples), turned[nearest], back=True)
        return gains[nearest]

    def _after_blocks(self, motion: RunSamples, blocks: tuple[Array, Array, Array], now: Array) -> tuple[Array, Array]:
        """Largest errors (2 nv,) after N blocks of samples, and ``[e, 1]`` at the end.

        Args:
            motion: one sample of each block, and one after them.
            blocks: errors (N, 2 nv) of a sample, numbers of samples (N,), and slopes of inputs (N, p, nv + r).
            now: error e and 1 at the start, (nv + r + 1,).
        """
        added, lengths, gains = blocks
        model, nv, states = self._model, self._model.n, self._states(motion)
        t = motion.t if model.rheonomic else None
        slopes = state_derivatives(model, motion.q, np.ascontiguousarray(states.v2), motion.T, t=t)
        M, G = self._system(states, motion, slopes)
        # The middle of a block of one sample is between two of these, which are at the begin of such blocks.
        halves = np.where(lengths == 1, 0.5, 0.0)[:, None, None]
        M, G = M[:-1] + halves * np.diff(M, axis=0), G[:-1] + halves * np.diff(G, axis=0)
        n, p = M.shape[-1], G.shape[-1]
        held = np.zeros((len(M), n + p, n + p))
        held[:, :n, :n], held[:, :n, n:] = M * self._dt, G * self._dt
        held = _exponential(held)
        maps, R, v_q = np.zeros((len(M), n + 1, n + 1)), slopes.v_v2[:-1], slopes.v_q[:-1]
        maps[:, :n, :n] = held[:, :n, :n] + held[:, :n, n:] @ gains
        moved = _assembled(states, model.constraints.holonomic, added[:, :nv])
        maps[:, :nv, n] = moved
        own = added[:, nv:] - apply(v_q, moved)
        maps[:, nv:n, n] = np.linalg.solve(R.mT @ R, R.mT @ own[:, :, None])[..., 0]
        maps[:, n, n] = 1.0
        for length in set(lengths.tolist()):
            own_maps = lengths == length
            maps[own_maps] = np.linalg.matrix_power(maps[own_maps], length)
        errors = np.empty((len(maps), n))
        for error, one in zip(errors, maps, strict=True):
            now = one @ now
            if not now @ now < _LARGEST**2:
                return np.full(2 * nv, np.inf), np.zeros(n + 1)
            error[:] = now[:n]
        velocities = apply(v_q, errors[:, :nv]) + apply(R, errors[:, nv:])
        return np.abs(np.concatenate([errors[:, :nv], velocities], axis=1)).max(axis=0), now

    def _system(self, states: StateEvaluation, motion: RunSamples, slopes: StateDerivatives) -> tuple[Array, Array]:
        """Matrices of ``e_dot = M e + G dT`` at N states, with the error e of the configuration and of v2."""
        (nv, r), damping = slopes.v_v2.shape[1:], self._plant.damping
        M = np.zeros((len(motion.q), nv + r, nv + r))
        M[:, :nv, :nv], M[:, :nv, nv:] = slopes.v_q + _turning(self._model.robot.model, motion), slopes.v_v2
        M[:, nv:, :nv], M[:, nv:, nv:] = slopes.v2_dot_q, slopes.v2_dot_v2
        if damping is not None:
            R = slopes.v_v2
            resisted = np.linalg.solve(states.H, R.mT * damping)
            M[:, nv:, :nv] -= resisted @ slopes.v_q
            M[:, nv:, nv:] -= resisted @ R
        G = np.concatenate([np.zeros((len(M), nv, motion.T.shape[1])), slopes.v2_dot_T], axis=1)
        return M, G

    def _turned(self, motion: RunSamples, gains: Array, back: bool = False) -> Array:
        """Slopes (N, p, nv + r) of inputs by velocities along the axes of the world, or ``back`` along those of joints.

        The part of the velocities is that of v: its rows are in the span of R.
        """
        R, Q = self._states(motion).R, joint_rotations(self._model.robot.model, motion.q)
        nv = self._model.n
        of_q, of_v = gains[..., :nv], gains[..., nv:]
        if back:
            return np.concatenate([of_q @ Q, of_v @ Q @ R], axis=-1)
        of_v = of_v @ np.linalg.solve(R.mT @ R, R.mT)
        return np.concatenate([of_q @ Q.mT, of_v @ Q.mT], axis=-1)

    @property
    def _model(self) -> ReducedModel:
        return self._plant.reduced

    def _states(self, motion: RunSamples) -> StateEvaluation:
        """Evaluations at samples."""
        return self._model.at(motion.q, v=motion.v, t=motion.t if self._model.rheonomic else None)

    def _feedback(self, motion: RunSamples, seen: ErrorMark) -> Array:
        """Slope (p, nv + r) of the inputs of the controller by the state of the plant at a sample."""
        own, plant, robot = motion.at(np.array([seen.sample])), self._model, self._model.robot.model
        t, q, v2 = float(own.t[0]), own.q[0], np.ascontiguousarray(self._states(own).v2[0])
        sizes = np.repeat([_STEP, _STEP * (1.0 + np.abs(v2).max(initial=0.0))], [plant.n, plant.r])
        everything = np.cos(np.arange(len(sizes)))  # no direction of a robot is special
        moves = sizes * np.vstack([np.zeros(len(sizes)), everything, np.eye(len(sizes))])
        displaced = np.array([pin.integrate(robot, q, each) for each in moves[:, : plant.n]]), v2 + moves[:, plant.n :]
        here, _, *moved = self._inputs(t, *displaced, seen)
        gains = np.asarray(((np.array(moved) - here) / sizes[:, None]).T)
        of_q, of_v = (np.linalg.matrix_rank(each, rtol=_RANK) for each in np.split(gains, [plant.n], axis=1))
        if of_v < of_q:
            self.unknown = _REMEMBERS
            raise _RefusalError
        return gains

    def _seen(self, t: float, q: Array, v2: Array) -> StateEvaluation:
        """States of the plant in the reduction of the controller."""
        states = self._model.at(q, v2, t=t)
        return states if self._reduced is self._model else self._reduced.at(q, v=states.v, t=t)

    def _inputs(self, t: float, q: Array, v2: Array, seen: ErrorMark) -> Array:
        """Inputs (N, p) of the controller at states, by a mark; all as the first if those of the second are."""
        plant, controller, found = self._plant, self._controller, list[Array]()
        if accepts_batches(controller):
            integrals = np.tile(seen.integrals, (len(q), 1))
            with suppress(Exception):  # of one state, which is not known
                memory = stack_states([seen.memory] * len(q))
                states = self._seen(t, q, v2)
                command, _ = controller.step(t, states.measure(integrals), memory)
                return plant.saturated(states.allocate(command.F) if command.T is None else command.T)
        for each in zip(q, v2, strict=True):
            state = self._seen(t, *each)
            try:
                command, after = controller.step(t, state.measure(seen.integrals), seen.memory)
            except Exception as error:  # the run is complete, and its controller may not know the displaced state
                raise _RefusalError from error
            now, then = (getattr(part_with(each, "searches"), "searches", 0) for each in (after, seen.memory))
            if now != then:
                self.unknown = _SEARCHES
                raise _RefusalError
            found.append(plant.saturated(input_of(self._reduced, state, command)))
            if len(found) == 2 and np.array_equal(found[0], found[1]):
                return np.tile(found[0], (len(q), 1))
        return np.array(found)


class _RefusalError(RncError):
    """A slope of a controller is not known, or an integration with fewer substeps diverges."""


def _starts(steps: Array) -> Array:
    """First samples (N,) of blocks that are as short as the substeps of the samples around them are many.

    The first blocks are short too: a motion often begins with a transient.
    """
    firsts = np.arange(0, len(steps), MARKED)
    strides = np.maximum(1, MARKED // np.maximum.reduceat(steps, firsts))
    blocks = [
        np.arange(first, min(first + MARKED, len(steps)), each)
        for first, each in zip(firsts.tolist(), strides.tolist(), strict=True)
    ]
    early = 2 ** np.arange(MARKED.bit_length())
    return np.union1d(np.concatenate(blocks), early[early < min(strides[0], len(steps))])


def _assembled(states: StateEvaluation, holonomic: Sequence[bool], moved: Array) -> Array:
    """Displacements (N, nv) after the projection of the plant, which moves against the holonomic rows only."""
    if not any(holonomic):
        return moved
    A = states.A[: len(moved), np.array(holonomic)]
    across = np.linalg.solve(states.M[: len(moved)], A.mT)
    return np.asarray(moved - apply(across, np.linalg.solve(A @ across, A @ moved[..., None])[..., 0]))


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
