"""Braking motions of a program in inputs: rolled out on the model, before a sample is executed.

A state is *safe* if its braking motion keeps all limits until rest, and if efforts can hold the robot there. A program
that only enters safe states never meets limits that it cannot keep: the braking motion that was verified for the end of
the last sample is left. It is kept from sample to sample, and followed where no other one is verified. This is a
predictive safety filter with a backup law (K. P. Wabersich and M. N. Zeilinger, Automatica 129 (2021) 109597).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import daqp
import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.control.whole_body.limit_stack import ContactBounds, ContactCones, LimitStack
from rnc_pin.control.whole_body.limits.control_limit import ControlSample, LimitRows
from rnc_pin.errors import DivergenceError, SingularityError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation

_KEPT = 1e-8  # [rad, m, and per second] excess over a limit that is rounding
_SHARE, _RETURN = 0.5, 0.25  # factor and step of the share of the program's inputs beside those of a braking motion
_REST = 1e-6  # [rad/s, m/s] speed that counts as rest
_BUDGETS = {True: 40, False: 120}  # decisions and checks of a motion whose joints come to rest together, or each alone
_RESERVE = 1.1  # of the time in which efforts stop all joints
_STEP = 1.2  # time to rest over the duration for which inputs of the law are held
_LEAST = 1e-14  # effect of an input on the energy, relative to the sum of all
_FREE_COST = 1e-9  # of inputs that do not change the energy, relative to the others
_INSIDE = 0.1  # part of limits by rows that the law leaves unused
_GROUND = 0.3  # the same of the conditions of the ground, which change along a motion
_SAME = 1e-6  # [rad, m, and per second] difference to the predicted state at which a kept motion is followed
_BEYOND = 1e-3  # [rad/s, m/s] motion that limits ask for, in which the program goes on without a verified motion
_CHANGED = 1e-2, 5e-2, 0.1  # change of configuration, velocity and time [s] after which verification is tried again
_SOLVED, _INFINITE = 1, 1e30  # of the solver


class BrakedSample(NamedTuple):
    """Sample on the model."""

    T: Float[Array, " p"]
    q: Float[Array, " nq"]
    """Configuration at its end."""
    v2: Float[Array, " r"]
    """Reduced velocity at its end."""
    exceeded: Float[Array, " k"]
    """Amount by which its end exceeds each limit."""


class BrakingMotion(NamedTuple):
    """Braking motion from a state."""

    q: Float[Array, " nq"]
    v2: Float[Array, " r"]
    inputs: Float[Array, "m p"]
    """Inputs of its samples; the last ones hold the robot at rest."""
    problem: str | None
    """Reason why it does not keep all limits until rest; None if it does."""


class BackupMotion(NamedTuple):
    """Rest of a verified braking motion, or the state at which none was found."""

    motion: BrakingMotion | None = None
    """Verified motion from the predicted end of the last sample."""
    failed: tuple[float, Float[Array, " nq"], Float[Array, " r"]] | None = None
    """Time [s], configuration and reduced velocity at the last attempt, if it was in vain."""
    problem: str = ""
    """Reason of it, or of the last sample that did not execute the inputs of the program alone."""
    share: float = 1.0
    """Share of the program's inputs in the last sample; the rest is that of the kept motion."""


class BrakingCount(NamedTuple):
    """Samples of a run in which braking motions took effect, or in which none was verified."""

    braked: int = 0
    """Samples that executed a braking motion in place of the program."""
    first: float | None = None
    """Time of the first one [s]."""
    reason: str = ""
    """Reason why the program gave way at that time."""
    unverified: int = 0
    """Samples without a verified braking motion: the program went on."""
    unverified_first: float | None = None
    """Time of the first one [s]."""
    problem: str = ""
    """Reason why no braking motion was verified at that time."""

    def with_braked(self, t: float, reason: str) -> BrakingCount:
        """Count one more sample that brakes."""
        first = (t, reason) if self.first is None else (self.first, self.reason)
        return self._replace(braked=self.braked + 1, first=first[0], reason=first[1])

    def with_unverified(self, t: float, problem: str) -> BrakingCount:
        """Count one more sample without a verified braking motion."""
        first = (t, problem) if self.unverified_first is None else (self.unverified_first, self.problem)
        return self._replace(unverified=self.unverified + 1, unverified_first=first[0], problem=first[1])


class NearGround(NamedTuple):
    """Conditions of the ground near a state, with which a braking motion is planned.

    Their part by the velocity is quadratic in it, so it decreases with the kinetic energy.
    """

    rows: Float[Array, "k x"]
    rest: Float[Array, " k"]
    """Upper bounds at rest, without the part that stays unused."""
    moving: Float[Array, " k"]
    """What the velocity adds to them."""
    energy: float

    @classmethod
    def of(cls, now: ContactBounds, rest: ContactBounds, energy: float) -> NearGround:
        """Conditions from those of a state with a kinetic energy [J], and those of rest at its configuration."""
        return cls(now.rows, rest.upper - _GROUND * np.abs(rest.upper), now.upper - rest.upper, energy)

    def at(self, state: StateEvaluation) -> tuple[Array, Array]:
        """Rows on inputs and undetermined forces, and their upper bounds."""
        if not len(self.rest):
            return self.rows, self.rest
        share = min(float(state.kinetic_energy) / self.energy, 1.0) if self.energy else 0.0
        return self.rows, self.rest + share * self.moving


class BrakingDecision(NamedTuple):
    """Sample to execute."""

    sample: BrakedSample
    backup: BackupMotion
    used: BrakingCount
    """Samples so far."""


class Braking:
    """Braking motions of one program.

    The law removes as much kinetic energy as efforts and ground allow, with inputs that are held over a part of the
    time to rest. So a motion takes few decisions. Its inputs are those that are executed: limits are checked at the end
    of every sample.

    Args:
        reduced: the model.
        limits: limits of motion.
        contacts: conditions of the ground.
        ahead: configuration and reduced velocity after a number of samples, from a state and inputs.
        names: names of all limits (k,); those of motion come first, those of the ground last.
        dt: duration of a sample [s].
        longest: longest braking motion [s].
    """

    def __init__(
        self,
        reduced: ReducedModel,
        limits: LimitStack,
        contacts: ContactCones,
        ahead: Callable[[StateEvaluation, Array, int], tuple[Array, Array]],
        names: tuple[str, ...],
        dt: float,
        longest: float,
    ) -> None:
        self._reduced, self._limits, self._contacts, self._ahead = reduced, limits, contacts, ahead
        self._names, self._dt, self._longest = names, dt, longest
        self._identity = np.eye(reduced.r)
        self._efforts = np.minimum(reduced.actuation.limits, _INFINITE)

    def decide(
        self,
        start: StateEvaluation,
        t: float,
        before: Array,
        planned: BrakedSample,
        under: Callable[[Array], BrakedSample],
        rows: LimitRows,
        ground: ContactBounds,
        backup: BackupMotion,
        count: BrakingCount,
    ) -> BrakingDecision:
        """Return the sample to execute.

        It is the planned one if a braking motion from its end is verified. Otherwise it is the next sample of the kept
        motion, or half of the way to the planned one. Without a verified motion, it is the planned one.

        Args:
            start: state at its start.
            t: time of its start [s].
            before: amount by which this state exceeds each limit (k,).
            planned: sample of the program.
            under: sample under given inputs (p,).
            rows: limits of motion of this sample.
            ground: conditions of the ground at the start.
            backup: motion that is kept.
            count: samples so far.
        """
        kept = backup.motion
        if kept is not None and not self._continues(kept, start):
            kept, before = None, np.maximum(before, self.exceeded(start, t))
        if kept is None and backup.failed is not None and not _changed(backup.failed, (t, start.q, start.v2)):
            return BrakingDecision(planned, backup, count.with_unverified(t, backup.problem))
        near, share = self.ground(start, ground), 1.0 if kept is None else min(backup.share + _RETURN, 1.0)
        tried = planned
        if kept is not None and share < 1.0:
            tried = under(kept.inputs[0] + share * (planned.T - kept.inputs[0]))
        after = self._after(t, tried, before, near)
        if after.problem is None:
            count = count if tried is planned else count.with_braked(t, backup.problem)
            return BrakingDecision(tried, BackupMotion(after, None, backup.problem, share), count)
        if self._excludes_rest(rows):
            failed = BackupMotion(None, (t, start.q, start.v2), after.problem)
            return BrakingDecision(planned, failed, count.with_unverified(t, after.problem))
        if kept is None:
            kept = self.motion(start, t, before, near)
            if kept.problem is not None and backup.motion is not None and len(kept.inputs):
                count = count.with_unverified(t, kept.problem)  # the measured state is not the predicted one: brake
            elif kept.problem is not None:
                failed = BackupMotion(None, (t, start.q, start.v2), kept.problem)
                return BrakingDecision(planned, failed, count.with_unverified(t, kept.problem))
        first = under(kept.inputs[0])
        if (problem := self._broken(first.exceeded, np.maximum(before, _SAME))) is not None:  # an obstacle came nearer
            failed = BackupMotion(None, (t, start.q, start.v2), problem)
            return BrakingDecision(planned, failed, count.with_unverified(t, problem))
        share *= _SHARE  # otherwise the robot stops and goes
        mixed = under(first.T + share * (planned.T - first.T))
        further = self._after(t, mixed, before, near)
        count = count.with_braked(t, after.problem)
        if further.problem is None:
            return BrakingDecision(mixed, BackupMotion(further, None, after.problem, share), count)
        rest = kept.inputs[1:] if len(kept.inputs) > 1 else kept.inputs
        return BrakingDecision(
            first, BackupMotion(BrakingMotion(first.q, first.v2, rest, None), None, after.problem, 0.0), count
        )

    def motion(self, start: StateEvaluation, t: float, before: Array, ground: NearGround) -> BrakingMotion:
        """Roll out the braking motion from a state until rest.

        Args:
            start: the state.
            t: its time [s].
            before: amount by which it exceeds each limit (k,). A motion that does not increase it is verified too: a
                joint beyond its limit may rest or return.
            ground: conditions of the ground, at this state or near it.
        """
        found = self._rolled_out(start, t, before, ground, together=True)
        if found.problem is not None:
            found = self._rolled_out(start, t, before, ground, together=False)
        return found

    def _rolled_out(
        self, start: StateEvaluation, t: float, before: Array, ground: NearGround, together: bool
    ) -> BrakingMotion:
        """Motion whose joints come to rest at the same time after the first sample, or each as fast as it can."""
        inputs: list[Array] = []
        decided: list[tuple[Array, Array, Array]] = []
        problem: str | None
        state, held, problem = start, 1, f"the robot does not come to rest within {self._longest:g} s"
        allowed, most, spent = np.maximum(before, _KEPT), round(self._longest / self._dt) + 1, 0
        try:
            while True:
                spent += 1
                T, held, following = self._law(state, t, held, ground, together and bool(inputs))
                decided.append((state.q, state.v, T))
                if not held:
                    inputs.append(T)
                    problem = self._ground_problem(decided, allowed)
                    break
                if len(inputs) + held > most:
                    break
                if spent > _BUDGETS[together]:
                    problem = f"the braking motion takes more than {_BUDGETS[together]} evaluations"
                    break
                inputs += [T] * held
                while held:
                    samples = 1
                    if together:  # velocities decrease, so positions are between those of the ends
                        speed = max(float(np.abs(state.v2).max()), 1e-9)
                        samples = min(held, max(1, int(self._limits.spacing / (speed * self._dt))))
                    spent += 1
                    state, exceeded = self._samples(state, t, T, samples)
                    t, held = t + samples * self._dt, held - samples
                    if (found := self._broken(exceeded, allowed)) is not None:
                        return BrakingMotion(start.q, start.v2, np.array(inputs), found)
                held = 1 if together else following
        except (SingularityError, DivergenceError) as error:
            problem = str(error)
        return BrakingMotion(start.q, start.v2, np.array(inputs), problem)

    def ground(self, state: StateEvaluation, now: ContactBounds | None = None) -> NearGround:
        """Conditions of the ground near a state, which are computed by default."""
        now = self._contacts.at(state) if now is None else now
        rest = now
        if self._contacts.grips and state.v2.any():
            rest = self._contacts.at(self._reduced.at(state.q, np.zeros_like(state.v2)))
        return NearGround.of(now, rest, float(state.kinetic_energy))

    def exceeded(
        self, state: StateEvaluation, t: float, sample: ControlSample | None = None, mean: Array | None = None
    ) -> Float[Array, " k"]:
        """Amount by which a state exceeds each limit of motion."""
        found = np.zeros(len(self._names))
        rows = None if sample is None else self._limits.rows(sample, braking=True)
        found[: len(self._limits.names)] = self._limits.exceeded(state, t, rows, mean)
        return found

    def _law(
        self, state: StateEvaluation, t: float, held: int, ground: NearGround, together: bool
    ) -> tuple[Array, int, int]:
        """Inputs, the number of samples for which they are held, zero at rest, and this number for the next decision.

        Inputs that stop all joints within a time h are ``load + impulse / h``.
        """
        effects, adverse = state.row_accelerations(self._identity)
        p, (rows, upper) = self._reduced.p, ground.at(state)
        inverse = np.linalg.inv(effects) if p == len(effects) else np.linalg.pinv(effects)
        load, impulse = -inverse @ adverse, -inverse @ state.v2
        room = np.concatenate([self._efforts - load, self._efforts + load, upper - rows[:, :p] @ load])
        used = np.concatenate([impulse, -impulse, rows[:, :p] @ impulse])
        shortest = np.inf
        if (room >= 0.0).all():
            shortest = float(np.divide(used, room, out=np.where(used > 0.0, np.inf, 0.0), where=room > 0.0).max())
        if shortest <= self._dt and self._may_stop(state, t, 1):
            moving = np.abs(state.v).max(initial=0.0) > _REST
            return load + impulse / self._dt, int(moving), 1
        if together and shortest < self._longest:
            enough = int(np.ceil(_RESERVE * shortest / self._dt))
            if self._may_stop(state, t, enough):
                return load + impulse / (enough * self._dt), enough, 1
        h = held * self._dt
        motion = self._limits.rows(ControlSample(self._reduced, t, state.q, state.v2, h), braking=True)
        T = self._slowing(effects, state.v2 / h + adverse, h, state, motion, rows, upper)
        power = -float(state.v2 @ state.H @ (effects @ T + adverse))
        to_rest = float(state.v2 @ state.H @ state.v2) / power if power > 0.0 else self._longest
        return T, held, max(1, int(min(to_rest - h, self._longest) / (_STEP * self._dt)))

    def _may_stop(self, state: StateEvaluation, t: float, held: int) -> bool:
        """True unless limits that rows judge, such as those of accelerations, exclude rest after some samples."""
        if not self._limits.judged_by_rows.any():
            return True
        sample = ControlSample(self._reduced, t, state.q, state.v2, held * self._dt)
        motion = self._limits.rows(sample, braking=True)
        room = self._spare(motion)
        return bool((motion.lower + room <= 0.0).all() and (motion.upper - room >= 0.0).all())

    def _spare(self, motion: LimitRows) -> Array:
        """Part of the limits that stays unused (k,)."""
        judged = self._limits.judged_by_rows[motion.places]
        return np.where(judged, 0.5 * _INSIDE * (motion.upper - motion.lower), 0.0)

    def _slowing(
        self,
        effects: Array,
        offset: Array,
        h: float,
        state: StateEvaluation,
        motion: LimitRows,
        ground: Array,
        above: Array,
    ) -> Array:
        """Inputs that leave the least kinetic energy within efforts, ground and the rows of limits."""
        p, size = self._reduced.p, ground.shape[1]
        metric = state.input_matrix.T @ effects
        scales = np.ones(size)  # light joints and heavy ones
        scales[:p] = 1.0 / np.sqrt(np.maximum(metric.diagonal(), _LEAST * np.trace(metric)))
        hessian, gradient = _FREE_COST * np.eye(size), np.zeros(size)
        hessian[:p, :p] += metric * scales[:p] * scales[:p, None]
        gradient[:p] = scales[:p] * (state.input_matrix.T @ offset)
        J = motion.jacobian @ state.R
        own = np.zeros((len(J), size))
        own[:, :p], passive = J @ effects, J @ offset
        room = self._spare(motion)
        box = np.full(size, _INFINITE)
        box[:p] = self._efforts / scales[:p]
        rows = np.vstack([ground, own]) * scales
        lower = np.concatenate([-box, np.full(len(above), -_INFINITE), (motion.lower + room) / h - passive])
        upper = np.concatenate([box, above, (motion.upper - room) / h - passive])
        for count in (len(rows), len(ground)):  # limits that no inputs keep are named where they are checked
            stop = size + count
            kinds = np.zeros(stop, dtype=np.int32)
            x, _, status, _ = daqp.solve(hessian, gradient, rows[:count], upper[:stop], lower[:stop], kinds)
            if status == _SOLVED:
                return np.clip((scales * x)[:p], -self._efforts, self._efforts)
        raise DivergenceError("no efforts brake within the conditions of the ground")

    def _samples(self, start: StateEvaluation, t: float, T: Array, count: int) -> tuple[StateEvaluation, Array]:
        """End of samples under the same inputs, and the amount by which it exceeds each limit of motion."""
        q, v2 = self._ahead(start, T, count)
        h = count * self._dt
        end = self._reduced.at(q, v2, t=t + h)
        mean = np.asarray(pin.difference(self._reduced.robot.model, start.q, q)) / h
        sample = ControlSample(self._reduced, t, start.q, start.v2, h) if self._limits.judged_by_rows.any() else None
        return end, self.exceeded(end, t + h, sample, mean)

    def _ground_problem(self, decided: list[tuple[Array, Array, Array]], allowed: Array) -> str | None:
        """Condition of the ground that inputs violate at their states."""
        if not self._contacts.names:
            return None
        q, v, T = (np.array(each) for each in zip(*decided, strict=True))
        excess = np.zeros(len(self._names))
        excess[len(self._names) - len(self._contacts.names) :] = self._contacts.excess(self._reduced.at(q, v=v), T)
        return self._broken(excess, allowed)

    def _continues(self, kept: BrakingMotion, start: StateEvaluation) -> bool:
        """True if a state is the one that a motion starts from."""
        apart = pin.difference(self._reduced.robot.model, kept.q, start.q)
        return max(np.abs(apart).max(initial=0.0), np.abs(start.v2 - kept.v2).max(initial=0.0)) <= _SAME

    def _excludes_rest(self, rows: LimitRows) -> bool:
        """True if limits ask for motion: an obstacle comes nearer, or the robot is beyond a limit."""
        asked = np.maximum(rows.lower, -rows.upper)
        return bool((asked[~self._limits.judged_by_rows[rows.places]] > _BEYOND).any())

    def _after(self, t: float, reached: BrakedSample, before: Array, ground: NearGround) -> BrakingMotion:
        """Braking motion from the end of a sample; its problem is that of the sample if this exceeds a limit."""
        broken = self._broken(reached.exceeded, np.maximum(before, _KEPT))
        if broken is not None:
            return BrakingMotion(reached.q, reached.v2, np.zeros((0, len(reached.T))), broken)
        t += self._dt
        return self.motion(self._reduced.at(reached.q, reached.v2, t=t), t, before, ground)

    def _broken(self, exceeded: Array, allowed: Array) -> str | None:
        """First limit that is exceeded by more than is allowed."""
        beyond = exceeded > allowed
        if not beyond.any():
            return None
        worst = int(np.argmax(beyond))
        return f"{self._names[worst]} gives way by {exceeded[worst]:.2g}"


def _changed(last: tuple[float, Array, Array], now: tuple[float, Array, Array]) -> bool:
    """True if a state has changed so much that another attempt may succeed."""
    q, v2, time = _CHANGED
    return bool(now[0] - last[0] > time or np.abs(now[1] - last[1]).max() > q or np.abs(now[2] - last[2]).max() > v2)
