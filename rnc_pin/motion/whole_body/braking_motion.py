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

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConstraintError, DivergenceError, SingularityError
from rnc_pin.math.linear_algebra import clipped, inverse
from rnc_pin.model.coordinates import ConfigurationManifold
from rnc_pin.model.integrators import ReducedMotion
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.motion.whole_body.limit_stack import ContactBounds, ContactCones, LimitStack
from rnc_pin.motion.whole_body.limits.control_limit import ControlSample, HeldMotion, LimitRows, known_state
from rnc_pin.motion.whole_body.whole_body_program import SampleCount

_TOLERANCE = 2e-7  # [rad, m, and per second] excess over a limit that is an error of the integration
_REST = 1e-4  # [rad/s, m/s] speed that counts as rest: its inputs remove it within a sample
# Work is counted in Runge-Kutta steps, not in time, so that runs repeat.
_DECISION, _CHECK = 20, 10  # work of a decision, and of a check beside its steps
_MOST_WORK = 5400  # for the check of a state that a user asks for
_BUDGET, _PACE = 200, 40e3  # work in a sample that may follow a kept motion instead: at least, and per second
_AGAIN = 280  # work in a sample without one to follow, about 5 ms: limits that cannot hold are tried again and again
_SMALL = 0.1  # speed of a joint that does not count, relative to the largest
_PART = 0.75  # of the time in which joints stop: inputs are held that long
_RESERVE = 1.1  # of the time in which efforts stop all joints
_LEAST = 1e-14  # effect of an input on the energy, relative to the sum of all
_FREE_COST = 1e-9  # of inputs that do not change the energy, relative to the others
_UNUSED, _GROUND = 0.1, 0.3  # parts of limits by rows, and of conditions of the ground, that the law leaves unused
_FEW = 8  # samples under the same inputs: fewer need not end with a whole step
_EASED = 0.125  # of the way back to the program in each verified sample
_SAME = 1e-6  # [rad, m, and per second] difference to the predicted state at which a kept motion is followed
_BEYOND = 1e-3  # [rad/s, m/s] motion that limits ask for, in which the program goes on without a verified motion
_CHANGED = 1e-2, 5e-2, 0.1  # change of configuration, velocity and time [s] after which verification is tried again
# Of the solver, which needs up to 100 iterations. Where it cycles, its own limit of 10,000 takes 8 ms.
_SOLVED, _INFINITE, _ITERATIONS = 1, 1e30, 500
_STEP = 0.01  # [s] Runge-Kutta step in shorter samples: motions err by 2e-7
_COARSE, _DOUBT = 4, 1e-4  # steps in one that is tried first, and the largest error that they may cause
_DRIFT = 0.03  # part of the speed by which a motion may differ from the one that is wanted
_SHORT = 32  # steps of a motion that need not be coarse; as many are traced at once
_CHECKED = 8  # steps before a check: more are in vain where a limit gives way at once, or the motion diverges
_DOUBTFUL = "a limit gives way by less than the error of coarse steps"
_LONG = "a braking motion takes more steps than a sample has time for"
_ROUNDING = 1e-6  # of a number of steps


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
    together: bool = True
    """True if all joints come to rest at the same time."""
    work: int = 0
    """Work that led to it."""


class BrakingState(NamedTuple):
    """Record of braking motions from one sample to the next."""

    kept: BrakingMotion | None = None
    """Rest of a verified braking motion, from the predicted end of the last sample."""
    share: float = 1.0
    """Part of the way from the last inputs to the program's; it grows slowly, lest the robot stops and goes."""
    last: Float[Array, " p"] | None = None
    """Inputs of the last sample."""
    failed: Float[Array, " k"] | None = None
    """Configuration, reduced velocity and time of the last attempt in units of a change, if it was in vain."""
    braked: SampleCount = SampleCount()
    """Samples that executed a braking motion, or inputs between it and the program's."""
    unverified: SampleCount = SampleCount()
    """Samples without a verified braking motion: the program went on."""


_Decided = tuple[Array, Array, Array]
"""State q, v2 and the inputs (p,) that are held from it on."""


class _Part(NamedTuple):
    """Part of a braking motion, and what the next part begins with."""

    end: StateEvaluation
    inputs: Float[Array, "m p"]
    """Inputs of its samples."""
    decided: list[_Decided]
    problem: str | None
    """Limit that gives way."""
    left: int
    """Work that is left."""
    coarse: int
    """Length of steps, relative to the finest ones."""
    doubt: float = 0.0
    """Error of velocities that coarse steps may have caused so far."""


class Braking:
    """Braking motions of one program.

    Where efforts and ground allow, all joints stop together, at a constant deceleration. Elsewhere the law removes as
    much kinetic energy as they allow, with inputs that are held over a part of the time to rest. So a motion takes few
    decisions, and a sample has a budget of them. Its inputs are those that are executed.

    Limits of joints are checked in each Runge-Kutta step, within it too; other limits after whole samples, as many as
    their ``spacing`` allows at the speed. Steps are coarse where the error that they may cause leaves all limits of
    joints.

    Args:
        reduced: the model.
        limits: limits of motion.
        contacts: conditions of the ground.
        names: names of all limits (k,); those of motion come first, those of the ground last.
        dt: duration of a sample [s].
        longest: longest braking motion [s].
    """

    def __init__(
        self,
        reduced: ReducedModel,
        limits: LimitStack,
        contacts: ContactCones,
        names: tuple[str, ...],
        dt: float,
        longest: float,
    ) -> None:
        self._reduced, self._limits, self._contacts = reduced, limits, contacts
        self._names, self._dt, self._longest = names, dt, longest
        self._motion, self._manifold = ReducedMotion(reduced.robot), ConfigurationManifold(reduced.robot.model)
        self._budget = min(max(_BUDGET, round(_PACE * dt)), _MOST_WORK)
        self._coarse = _COARSE if limits.spacing == np.inf else 1
        self._fine = max(1, int(_STEP / dt + _ROUNDING))  # samples of the finest step
        self._late = f"the robot does not come to rest within {longest:g} s"
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
        state: BrakingState,
    ) -> tuple[BrakedSample, BrakingState]:
        """Return the sample to execute, and the state after it.

        The first of these outcomes that holds:

        1. Unverified: no motion is kept, and an attempt near this state and time was in vain.
        2. Planned: a braking motion from the end of the program's sample is verified, and is kept from now on.
        3. Eased: the same in place of 2 for some samples after one that braked; a part of the way back to the program.
        4. Unverified: limits ask for motion, or nothing is kept and the budget is used up.
        5. Kept: the next sample of the kept motion, if the robot is where that motion begins.
        6. New: the first sample of a braking motion from the present state. If that motion is not verified, a robot
           that has left its kept motion brakes all the same, and the sample counts as unverified. Others go on by 7.
        7. Unverified: there is no such motion, or its sample exceeds a limit.

        In 1, 4 and 7 the sample is the planned one, and nothing is kept after it.

        Args:
            start: state at its start.
            t: time of its start [s].
            before: amount by which this state exceeds each limit (k,).
            planned: sample of the program.
            under: sample under given inputs (p,).
            rows: limits of motion of this sample.
            ground: conditions of the ground at the start.
            state: state before it.
        """
        kept, now = state.kept, np.concatenate([start.q / _CHANGED[0], start.v2 / _CHANGED[1], [t / _CHANGED[2]]])

        def unverified(problem: str) -> tuple[BrakedSample, BrakingState]:
            count = state.unverified.and_one(t, problem)
            return planned, state._replace(kept=None, failed=now, unverified=count)

        if kept is None and state.failed is not None and np.abs(now - state.failed).max() <= 1.0:
            return planned, state._replace(unverified=state.unverified.and_one(t, state.unverified.reason))
        if kept is not None:  # a motion that starts elsewhere is no longer verified
            apart = pin.difference(self._reduced.robot.model, kept.q, start.q), start.v2 - kept.v2
            if not np.abs(np.concatenate(apart)).max() <= _SAME:
                kept, before = None, np.maximum(before, self.exceeded(start, t))
        together, share, eased = kept is None or kept.together, state.share, planned
        if kept is not None and share < 1.0 and state.last is not None:
            # Bit by bit from the last inputs back to the program. What is next to that between the kept motion and the
            # program keeps the conditions of the ground, as both do.
            first, way = kept.inputs[0], planned.T - kept.inputs[0]
            aim = state.last + share * (planned.T - state.last) - first
            eased = under(first + min(max(float(aim @ way) / max(float(way @ way), 1e-300), 0.0), 1.0) * way)
        asked = np.maximum(rows.lower, -rows.upper)[~self._limits.judged_by_rows[rows.places]]
        moved = bool((asked > _BEYOND).any())  # limits ask for motion: an obstacle comes nearer, or one is exceeded
        budget = max(self._budget, _AGAIN) if kept is None or moved else self._budget
        broken = self._broken(eased.exceeded, np.maximum(before, _TOLERANCE))
        after = BrakingMotion(eased.q, eased.v2, np.zeros((0, len(before))), broken)
        if broken is None:
            end = known_state(self._reduced, eased.q, eased.v2, t + self._dt)
            after = self.motion(end, t + self._dt, before, ground, together, budget)
        if after.problem is None:
            braked = state.braked if eased is planned else state.braked.and_one(t, state.braked.reason)
            share = min(1.0, share + _EASED)
            return eased, state._replace(kept=after, failed=None, share=share, last=eased.T, braked=braked)
        if moved or (kept is None and after.work >= budget):
            return unverified(after.problem)
        braked = state.braked.and_one(t, after.problem)
        if kept is None:  # the present state can still be safe where the planned end is not
            kept = self.motion(start, t, before, ground, together, budget - after.work)
        if kept.problem is not None and (state.kept is None or not len(kept.inputs)):
            return unverified(kept.problem)
        braking = under(kept.inputs[0])
        problem = self._broken(braking.exceeded, np.maximum(before, _SAME))
        if problem is not None:  # an obstacle came nearer
            return unverified(problem)
        # A plant that is not the model brakes by a motion that is not verified.
        missing = state.unverified.and_one(t, kept.problem or "")
        state = state._replace(braked=braked, failed=None, unverified=missing, share=_EASED, last=braking.T)
        rest = kept.inputs[1:] if len(kept.inputs) > 1 else kept.inputs
        # What the budget left out in this sample comes first in the next one.
        return braking, state._replace(kept=BrakingMotion(braking.q, braking.v2, rest, None, not together))

    def motion(
        self,
        start: StateEvaluation,
        t: float,
        before: Array,
        ground: ContactBounds,
        together: bool = True,
        budget: int = _MOST_WORK,
    ) -> BrakingMotion:
        """Roll out the braking motion from a state until rest.

        Args:
            start: the state.
            t: its time [s].
            before: amount by which it exceeds each limit (k,). A motion that does not increase it is verified too: a
                joint beyond its limit may rest or return.
            ground: conditions of the ground near this state, with which the motion is planned.
            together: way that is tried first, that of the last motion: see ``BrakingMotion``.
            budget: largest work.
        """
        work, most, named = 0, min(budget, _MOST_WORK // 2), None
        for way in (together, not together):
            for coarse in (self._coarse, 1):  # the finest steps only where coarse ones cannot tell
                found = self._rolled_out(start, t, before, ground, way, coarse, min(budget - work, most))
                work += found.work
                if found.problem != _DOUBTFUL:
                    break
            if found.problem not in (_LONG, _DOUBTFUL):
                named = found.problem
            if work >= budget or found.problem in (None, self._late):
                break
        # A limit that one way names tells more than the lack of time for the other.
        return found._replace(problem=named or found.problem, work=work)

    def _rolled_out(
        self,
        start: StateEvaluation,
        t: float,
        before: Array,
        ground: ContactBounds,
        together: bool,
        coarse: int,
        budget: int,
    ) -> BrakingMotion:
        """Motion whose joints come to rest at the same time, or each as fast as it can.

        Its steps are at most ``coarse`` times as long as the finest.
        """
        inputs: list[Array] = []
        decided: list[_Decided] = []
        problem: str | None = self._late
        # A joint that has stopped would hinder the others: from then on, all stop together.
        speed, first = np.abs(start.v2), together
        slow = np.where(speed > _SMALL * speed.max(initial=0.0), _SMALL * speed, 0.0)
        allowed, most = np.maximum(before, _TOLERANCE), round(self._longest / self._dt) + 1
        part = _Part(start, np.zeros((0, self._reduced.p)), [], None, budget, coarse)
        try:
            while part.left > 0:
                T, held, stops = self._law(part.end, t, ground, together)
                if not held:
                    inputs.append(T)
                    problem = self._ground_problem([*decided, (part.end.q, part.end.v2, T)], allowed)
                    break
                if len(inputs) + held > most:
                    break
                part = self._together(held, part, t, allowed) if stops else self._under(T, held, part, t, allowed)
                inputs, decided = inputs + list(part.inputs), decided + part.decided
                if part.problem is not None:
                    problem = part.problem
                    break
                t += len(part.inputs) * self._dt
                together = together or bool(np.count_nonzero(slow) > 1 and (np.abs(part.end.v2) < slow).any())
            else:
                problem = _LONG
        except (SingularityError, DivergenceError, ConstraintError) as error:
            problem = str(error)
        return BrakingMotion(start.q, start.v2, np.array(inputs), problem, first, budget - part.left)

    def _under(self, T: Array, held: int, last: _Part, t: float, allowed: Array) -> _Part:
        """Part after the last one under the same inputs, at most over some samples.

        Half of the way to a limit that gives way is left: constant inputs suit a part of the way.
        """
        state, coarse, left = last.end, last.coarse, last.left - _DECISION
        samples, problem = min(held, self._between_checks(state)), None
        while True:
            longest = coarse * self._fine  # samples of a step
            samples = min(samples, _CHECKED * longest)
            if samples >= _FEW:  # whole samples in each step: all states on the way are ends of samples
                samples -= min(samples % longest, samples % -(-samples // longest))
            trace, errors = self._samples(state, T[None], samples, coarse)
            doubts, count = last.doubt + errors, len(errors)
            end, excess, checks = self._exceeded_along(trace, count, samples * self._dt / count, state, t, allowed)
            left -= _CHECK * checks + count
            inside, beyond = self._judged(excess, doubts, allowed)
            if inside.all():
                break
            good = int(inside.argmin())
            known = (good // 2 if beyond[good] else good) if self._limits.spacing == np.inf else 0
            while known * samples % count:
                known -= 1
            if known:
                samples, doubts = known * samples // count, doubts[:known]
                end = known_state(self._reduced, trace[0][known], trace[1][known], t + samples * self._dt)
                break
            if not beyond[good] and coarse > 1:
                coarse //= 2  # these steps cannot tell
            elif samples > 1:
                samples = max((good + 1) * samples // (2 * count), 1)
            else:
                problem = self._broken(excess.max(axis=0), allowed) or _DOUBTFUL
                break
        decided = [(state.q, state.v2, T)]
        return _Part(end, np.tile(T, (samples, 1)), decided, problem, left, coarse, doubts[-1])

    def _together(self, held: int, last: _Part, t: float, allowed: Array) -> _Part:
        """Part after the last one in which all joints come to rest together after some samples, or the begin of it.

        The inputs are those of a constant deceleration, each held over a step, or over two coarse ones. So a joint that
        rests at its limit stays there. Where the motion leaves this one, the next decision takes over.
        """
        state, coarse = last.end, min(last.coarse, -(-held // (_SHORT * self._fine)))
        length = min((2 * coarse if coarse > 1 else 1) * self._fine, held, self._between_checks(state))
        count, speed = -(-held // length), np.abs(state.v2).max()
        T, wanted = self._inputs_to_rest(state, count, count * length * self._dt)
        doubt, left, done = last.doubt, last.left - _DECISION, 0
        decided, found, apart = list[_Decided](), None, np.zeros(1, dtype=bool)
        while done < count and found is None and not apart[-1] and left > 0:
            some = T[done : done + _SHORT]
            trace, errors = self._samples(state, some, length, coarse)
            (q, v2, *_), steps = trace, len(errors) // len(some)
            apart = np.abs(v2[steps::steps] - wanted[done : done + _SHORT]).max(axis=1) > _DRIFT * speed
            if apart.any():
                apart = apart[: apart.argmax() + 1]
            size = len(apart)
            used, doubts = size * steps, doubt + errors[: size * steps]
            state, excess, checks = self._exceeded_along(trace, used, length * self._dt / steps, state, t, allowed)
            left -= _CHECK * checks + len(errors)
            inside, beyond = self._judged(excess, doubts, allowed)
            if not inside.all():
                found = self._broken(excess.max(axis=0), allowed) if beyond.any() else _DOUBTFUL
            each = -(-size // _CHECKED)  # as few states as that: the ground's conditions take longer
            decided += zip(q[: used : each * steps], v2[: used : each * steps], some[:size:each], strict=False)
            doubt, done, t = doubts[-1], done + size, t + size * length * self._dt
        # Blocks that lead elsewhere at once are too long.
        coarse = last.coarse if done > 1 else max(coarse // 2, 1)
        return _Part(state, np.repeat(T[:done], length, axis=0), decided, found, left, coarse, doubt)

    def _inputs_to_rest(self, state: StateEvaluation, count: int, whole: float) -> tuple[Array, Array]:
        """Inputs (count, p) of a constant deceleration to rest in equal parts of a time, v2 (count, r) after each."""
        share = np.arange(1, count + 1) / count
        middle = share - 0.5 / count
        ways = whole * (middle - 0.5 * middle**2)[:, None] * state.v
        q = self._manifold.integrate(np.broadcast_to(state.q, (count, len(state.q))), ways)
        along = known_state(self._reduced, q, (1.0 - middle)[:, None] * state.v2)
        T = along.configuration.allocated(along.inverse_dynamics(np.tile(-state.v2 / whole, (count, 1))))
        return clipped(T, self._efforts), (1.0 - share)[:, None] * state.v2

    def _between_checks(self, state: StateEvaluation) -> int:
        """Number of samples after which limits that do not know each step have to be checked."""
        speed = max(float(np.abs(state.v2).max()), 1e-9)
        return int(min(max(1.0, self._limits.spacing / (speed * self._dt)), self._longest / self._dt))

    @staticmethod
    def _judged(excess: Array, doubts: Array, allowed: Array) -> tuple[Array, Array]:
        """Masks of the steps (K,) that certainly keep all limits, and of those at which one certainly gives way."""
        inside = (excess <= allowed - doubts[:, None]).all(axis=1) & (doubts <= _DOUBT)
        return inside, (excess > allowed + doubts[:, None]).any(axis=1)

    def exceeded(self, state: StateEvaluation, t: float) -> Float[Array, " k"]:
        """Amount by which a state exceeds each limit of motion."""
        others = np.zeros(len(self._names) - len(self._limits.names))
        return np.concatenate([self._limits.exceeded(state, t), others])

    def _law(
        self, state: StateEvaluation, t: float, contacts: ContactBounds, together: bool
    ) -> tuple[Array, int, bool]:
        """Inputs, the number of samples for which they are held, zero at rest, and True if all joints stop in them.

        Inputs that stop all joints within a time h are ``load + impulse / h``.
        """
        effects, adverse = state.input_accelerations
        p = self._reduced.p
        ground, upper = contacts.rows, contacts.upper - _GROUND * np.abs(contacts.upper)
        # With more inputs than motions, those of least norm stop the robot.
        inverted = inverse(effects) if p == len(effects) else np.linalg.pinv(effects)
        load, impulse = -inverted @ adverse, -inverted @ state.v2
        room = np.concatenate([self._efforts - load, self._efforts + load, upper - ground[:, :p] @ load])
        used = np.concatenate([impulse, -impulse, ground[:, :p] @ impulse])
        if (room >= 0.0).all():  # efforts and ground carry the load with some room, which the impulse uses
            shortest = np.divide(used, room, out=np.where(used > 0.0, np.inf, 0.0), where=room > 0.0).max(initial=0.0)
            held = 1 if shortest <= self._dt else int(np.ceil(_RESERVE * min(shortest, self._longest) / self._dt))
            if (held == 1 or together) and shortest < self._longest and self._may_stop(state, t, held):
                moving = np.abs(state.v).max(initial=0.0) > _REST
                return load + impulse / (held * self._dt), held if moving else 0, held > 1
        slowing, speed = self._slowing(effects, adverse, state, t, ground, upper), np.abs(state.v2)
        T = slowing(self._dt)
        rate = effects @ T + adverse
        stops = (state.v2 * rate < 0.0) & (speed > _SMALL * speed.max(initial=0.0))
        shortest = np.divide(speed, np.abs(rate), out=np.full(len(rate), self._longest), where=stops).min()
        # Of the next joint at rest, some time is left to the next decision: its deceleration changes on the way.
        held = int(_PART * shortest / self._dt)
        return (T, 1, False) if held < 2 else (slowing(held * self._dt), held, False)

    def _may_stop(self, state: StateEvaluation, t: float, held: int) -> bool:
        """True unless limits that rows judge, such as those of accelerations, exclude rest after some samples."""
        if not self._limits.judged_by_rows.any():
            return True
        sample = ControlSample(self._reduced, t, state.q, state.v2, held * self._dt, state)
        motion = self._limits.rows(sample, braking=True)
        room = self._spare(motion)
        return bool((motion.lower + room <= 0.0).all() and (motion.upper - room >= 0.0).all())

    def _spare(self, motion: LimitRows) -> Array:
        """Part of the limits that stays unused (k,)."""
        judged = self._limits.judged_by_rows[motion.places]
        return np.where(judged, 0.5 * _UNUSED * (motion.upper - motion.lower), 0.0)

    def _slowing(
        self, effects: Array, adverse: Array, state: StateEvaluation, t: float, ground: Array, above: Array
    ) -> Callable[[float], Array]:
        """Inputs that leave the least kinetic energy after a time within efforts, ground and the rows of limits."""
        p, size = self._reduced.p, ground.shape[1]
        pushes = state.input_matrix.T
        metric = pushes @ effects
        scales = np.ones(size)  # light joints and heavy ones
        own = metric.diagonal()
        scales[:p] = 1.0 / np.sqrt(np.maximum(own, _LEAST * own.sum()))
        hessian = np.diag(np.full(size, _FREE_COST))
        hessian[:p, :p] += metric * scales[:p] * scales[:p, None]
        box = np.full(size, _INFINITE)
        box[:p] = self._efforts / scales[:p]
        gradient = np.zeros(size)

        def after(h: float) -> Array:
            motion = self._limits.rows(ControlSample(self._reduced, t, state.q, state.v2, h, state), braking=True)
            J = motion.jacobian.dot(state.R)
            rows = np.zeros((len(ground) + len(J), size))
            rows[: len(ground)], rows[len(ground) :, :p] = ground, J.dot(effects)
            rows *= scales
            # The energy after h is |effects T + offset|^2 h^2 / 2 in the metric of the inertia.
            offset, room = state.v2 / h + adverse, self._spare(motion)
            gradient[:p], passive = scales[:p] * pushes.dot(offset), J.dot(offset)
            lower = np.concatenate([-box, np.full(len(above), -_INFINITE), (motion.lower + room) / h - passive])
            upper = np.concatenate([box, above, (motion.upper - room) / h - passive])
            for count in (len(rows), len(ground)):  # limits that no inputs keep are named where they are checked
                kinds = np.zeros(size + count, dtype=np.int32)
                given = rows[:count], upper[: len(kinds)], lower[: len(kinds)], kinds
                x, _, status, _ = daqp.solve(hessian, gradient, *given, iter_limit=_ITERATIONS)
                if status == _SOLVED:
                    return clipped((scales * x)[:p], self._efforts)
            raise DivergenceError("no efforts brake within the conditions of the ground")

        return after

    def _samples(self, start: StateEvaluation, T: Array, length: int, coarse: int) -> tuple[tuple[Array, ...], Array]:
        """Trace of K equal steps as of ``ReducedMotion.trace``, and the error (K,) that each of them may have.

        The error of coarse steps is the difference to Simpson's rule: over two steps, both err by the fifth order.

        Args:
            start: state at their start.
            T: inputs (b, p), each held over some samples.
            length: number of these samples.
            coarse: length of steps, relative to the finest ones.
        """
        finest = -(-length // self._fine)
        steps = max(-(-finest // coarse), min(finest, 2))  # Simpson's rule takes two
        count, evaluator = len(T) * steps, self._reduced.evaluator
        h, errors = len(T) * length * self._dt / count, np.zeros((len(T), steps, self._reduced.r))
        trace = self._motion.trace(evaluator, start.q, start.v2, np.repeat(T, steps, axis=0), h, count)
        if steps < finest:
            q, v2, _, rates, _ = trace
            # Rates jump with the inputs: each end of inputs has its own.
            ends = known_state(self._reduced, q[steps::steps].copy(), v2[steps::steps].copy())
            u, a = (
                np.concatenate([each.reshape(len(T), steps, -1), stop[:, None]], axis=1)
                for each, stop in zip((v2[:-1], rates), (ends.v2, ends.v2_dot(T)), strict=True)
            )
            missed = u[:, 2:] - u[:, :-2] - h / 3.0 * (a[:, :-2] + 4.0 * a[:, 1:-1] + a[:, 2:])
            errors[:, 1:] = np.abs(missed)
        doubts = errors.reshape(count, -1).cumsum(axis=0).max(axis=1).reshape(len(T), steps)
        doubts[:, 0] = doubts[:, min(steps, 2) - 1]  # Simpson's rule concerns both
        return trace, doubts.ravel()

    def _exceeded_along(
        self, trace: tuple[Array, ...], count: int, h: float, start: StateEvaluation, t: float, allowed: Array
    ) -> tuple[StateEvaluation, Array, int]:
        """State after the first steps of a trace, their excess (count, k), and the number of checks.

        Limits that do not know each step are checked at the end and after each ``spacing``, until one gives way.
        """
        limits, stop, (q, v2, v, _, way) = self._limits, count + 1, trace
        end = known_state(self._reduced, q[count], v2[count], t + count * h)
        motion = HeldMotion(q[:stop], np.vstack([v[:count], end.v]), v2[:stop], way[:count] / h, h)
        found = np.full((count, len(self._names)), -np.inf)
        own, state, checks, last = found[:, : len(limits.names)], start, 0, 0
        own[:] = limits.along(motion)
        ways = np.concatenate([[0.0], np.abs(motion.v2[:-1]).max(axis=1) * h]).cumsum()
        while last < count and (not last or (found[last - 1] <= allowed).all()):
            previous, first, reach = state, last, np.searchsorted(ways, ways[last] + limits.spacing, side="right")
            last, checks = int(np.clip(reach - 1, last + 1, count)), checks + 1
            now, then = t + first * h, t + last * h
            state = end if last == count else known_state(self._reduced, q[last], v2[last], then)
            if limits.spacing < np.inf:
                rows = None
                if limits.ends_judged_by_rows:
                    sample = ControlSample(self._reduced, now, previous.q, previous.v2, then - now, previous)
                    rows = limits.rows(sample, braking=True)
                np.maximum(own[last - 1], limits.exceeded(state, then, rows, at_ends=True), out=own[last - 1])
        return state, found, checks

    def _ground_problem(self, decided: list[_Decided], allowed: Array) -> str | None:
        """Condition of the ground that inputs violate at their states."""
        if not self._contacts.names:
            return None
        q, v2, T = (np.array(each) for each in zip(*decided, strict=True))
        excess = np.zeros(len(self._names))
        excess[-len(self._contacts.names) :] = self._contacts.excess(self._reduced.at(q, v2), T)
        return self._broken(excess, allowed)

    def _broken(self, exceeded: Array, allowed: Array) -> str | None:
        """First limit that is exceeded by more than is allowed."""
        beyond = exceeded > allowed
        if not beyond.any():
            return None
        worst = int(np.argmax(beyond))
        return f"{self._names[worst]} gives way by {exceeded[worst]:.2g}"
