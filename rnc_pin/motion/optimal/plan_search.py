"""Search for a verified plan: guesses are solved, the cheapest solution is refined and verified, then the next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import InfeasibleError, RncError
from rnc_pin.model.coordinates import Coordinates, rotation_vector_rates
from rnc_pin.motion.optimal.bounds import DISTANCE
from rnc_pin.motion.optimal.guesses import GIVEN, resampled
from rnc_pin.motion.optimal.motion_plan import Integration, MotionPlan, PlanInfo, PlanVerification
from rnc_pin.motion.optimal.sequential_quadratic import SequentialQuadratic, Solution, SolverSettings, solve_bounded
from rnc_pin.motion.optimal.transcription import Iterate, Transcription
from rnc_pin.motion.optimal.verification import Excess, RunLoop, excess_text, plan_findings, verify_inputs, verify_loop
from rnc_pin.motion.planning.action_models import ActionModel, Nodes

_RELAXED = ("straight line", "loop", "random")  # guesses that do not tell on which side of obstacles they pass
_SAME = 0.1  # of the accuracy, but not less than the tolerance: two solutions whose states differ by less are the same


def output_nodes(
    model: ActionModel, at: Iterate
) -> tuple[Float[Array, "K 2 k"], Float[Array, "K 2 k"], Float[Array, "K 2 k"]]:
    """Reducing and vertical outputs, their rates and accelerations, with the input of the interval at both ends.

    Rotations are rotation vectors without jumps, with the derivatives of these vectors.
    """
    ends = [_measured(model, Nodes(at.q[k:][: len(at.u)], at.w[k:][: len(at.u)]), at.u) for k in (0, 1)]
    position, velocity, acceleration = np.stack(ends, axis=2)
    h, r = at.duration / len(at.u), model.r
    quasi = np.flatnonzero(model.reduced.reducing.quasi)
    rates, changes = velocity[:, :, quasi], acceleration[:, :, quasi]
    # Integral of the cubic with these rates and accelerations at the ends.
    steps = h / 2 * rates.sum(axis=1) + h**2 / 12 * (changes[:, 0] - changes[:, 1])
    total = np.concatenate([np.zeros((1, len(quasi))), np.cumsum(steps, axis=0)])
    position[:, 0, quasi], position[:, 1, quasi] = total[:-1], total[1:]
    for stack, first in ((model.reduced.reducing, 0), (model.reduced.vertical, r)):
        columns = slice(first, first + stack.size)
        _continue(stack.coordinates, position[:, :, columns], velocity[:, :, columns], acceleration[:, :, columns])
    return position, velocity, acceleration


def _measured(model: ActionModel, nodes: Nodes, u: Array) -> Float[Array, "3 n k"]:
    """Outputs, rates and accelerations at n nodes; quasi-velocities have no value yet."""
    v2 = model.velocity(nodes, u)
    v2_dot = np.zeros_like(v2) if model.form == "kinematic" else model.flow(nodes, u)[1]
    seen = model.reduced.at(nodes.q, v2).measure(np.zeros(v2.shape))
    v1_dot = np.einsum("kij,kj->ki", seen.A_star, v2_dot) + np.einsum("kij,kj->ki", seen.A_star_dot, v2)
    if seen.v1_offset_dot is not None:
        v1_dot = v1_dot + seen.v1_offset_dot
    pairs = (seen.x2, seen.x1), (v2, seen.v1), (v2_dot, v1_dot)
    return np.stack([np.concatenate(pair, axis=1) for pair in pairs])


def _continue(coordinates: Coordinates, position: Array, velocity: Array, acceleration: Array) -> None:
    """Remove jumps of angles and rotation vectors, and turn angular rates into rates of rotation vectors, in place."""
    K = len(position)
    # The end of an interval is the begin of the next one: the nodes are one sequence without jumps.
    whole = coordinates.unwrap(np.concatenate([position[:, 0], position[-1:, 1]]))
    position[:, 0], position[:, 1] = whole[:-1], whole[1:]
    for first in coordinates.rotations:
        triple = slice(first, first + 3)
        for k in range(K):
            for end in (0, 1):
                parts = (each[k, end, triple] for each in (position, velocity, acceleration))
                velocity[k, end, triple], acceleration[k, end, triple] = rotation_vector_rates(*parts)


@dataclass(frozen=True, eq=False)
class _Made:
    """Plan with its solution, and with the rows that its inputs alone exceed, largest first.

    The loop that will run is verified when it counts, because it takes long.
    """

    problem: Transcription
    unverified: MotionPlan
    solution: Solution
    alone: Integration
    beyond: tuple[Excess, ...]
    loop: RunLoop

    @cached_property
    def _followed(self) -> tuple[Integration | None, tuple[Excess, ...]]:
        """The verified loop, and rows that the motion which decides exceeds, largest first."""
        loop, plan = self.loop, self.unverified
        if loop.feedback is None:
            return None, self.beyond
        return verify_loop(self.problem, self.solution.iterate, loop.feedback(plan), loop, plan.info.accuracy)

    @property
    def excesses(self) -> tuple[Excess, ...]:
        """Rows that the motion which decides exceeds, largest first."""
        return self._followed[1]

    @cached_property
    def plan(self) -> MotionPlan:
        """The verified plan."""
        info, at = self.unverified.info, self.solution.iterate
        found = PlanVerification(self.alone, self._followed[0], info.verification.substeps, self.loop.dt)
        findings = plan_findings(self.problem, at, self.excesses, found, info.accuracy)
        holds = found.violation <= info.accuracy and info.outcome != "infeasible"
        outcome = info.outcome if holds else "unverified"
        return replace(self.unverified, info=replace(info, outcome=outcome, verification=found, findings=findings))

    @property
    def confirmed(self) -> bool:
        """True if the verification confirms the plan."""
        return self.plan.info.outcome != "unverified"


class PlanSearch:
    """Search for a plan that its verification confirms.

    Its effort is bounded: each guess has the iterations of the settings, as many for a start that ignores obstacles,
    and twice as many for improvements of its solution; all twice where limits of the robot's file matter. An iteration
    over halved intervals counts twice. A solution that another guess had in vain is not improved again.

    Args:
        problem: the problem.
        settings: settings of the solver.
        loop: the loop that will run.
    """

    def __init__(self, problem: Transcription, settings: SolverSettings, loop: RunLoop) -> None:
        self._problem, self._settings, self._loop = problem, settings, loop
        # Guesses are solved for the clearance itself: a motion that cannot keep more of it is not lost. Improvements
        # ask for the accuracy on top.
        self._narrow = problem.changed(margins={DISTANCE: np.full(problem.K + 1, -settings.accuracy)})
        self._tried = self._solved = 0
        self._failed: list[Solution] = []
        self._rejected: list[_Made] = []
        self._vain: list[Iterate] = []  # solutions of guesses whose improvements were rejected
        self._left, self._spent = 0.0, False
        self._error: RncError | None = None
        self._given: Iterate | None = None

    def run(
        self, first: tuple[str, Iterate], further: Iterator[tuple[str, Iterate]], solutions: int, enough: float
    ) -> MotionPlan:
        """Return the first verified plan: the cheapest of the wanted solutions, else the next one.

        Args:
            first: the first named guess.
            further: guesses after it.
            solutions: number of solutions that are wanted.
            enough: number of guesses after which one solution is enough.

        Raises:
            InfeasibleError: there is none.
        """
        self._given = first[1] if first[0] == GIVEN else None
        found = self._from_guesses(chain([first], further))
        pool, needed = list[Solution](), solutions
        while True:
            while self._solved < needed and not (pool and self._tried >= enough):
                more = next(found, None)
                if more is None:
                    break
                pool += more
            if not pool:
                raise self._refusal()
            # Of solutions that cost the same, the first is taken: rounding does not decide.
            costs = [each.cost for each in pool]
            most = min(costs) + self._settings.cost_tolerance * abs(min(costs))
            best = pool.pop(next(k for k, cost in enumerate(costs) if cost <= most))
            needed += 1
            # Several guesses lead to one solution: improved once more, it would fail in the same way.
            if any(self._same(best.iterate, each) for each in self._vain):
                continue
            made = self._refined(best)
            if made.confirmed:
                return made.plan
            self._rejected.append(made)
            self._vain.append(best.iterate)
            # Improvements may spoil a guess that was verified elsewhere: then it is tried as it is.
            if best.guess == GIVEN:
                pool += self._unimproved()

    def _unimproved(self) -> list[Solution]:
        """The given guess itself, if it keeps all rows and was not taken before: no solution is better than it."""
        given, self._given = self._given, None
        if given is None:
            return []
        # A guess may be a plan that its verification has confirmed: what feedback needs is no reason to refuse it.
        problem = self._problem.changed(reserve=0.0)
        at = problem.from_start(given)
        try:
            values = problem.values(at)
        except RncError:
            return []
        violation = problem.worst(values, at.duration)
        if violation.amount > self._settings.accuracy:  # that of the verification, which decides
            return []
        self._solved += 1
        return [Solution(at, values.cost, violation, 0, "feasible", guess=f"{GIVEN}, as it is")]

    def _same(self, one: Iterate, other: Iterate) -> bool:
        """True if two motions over equal intervals are the same, within a part of the accuracy."""
        apart = self._problem.model.difference(Nodes(one.q, one.w), Nodes(other.q, other.w))
        largest = max(float(np.abs(apart).max()), abs(one.duration - other.duration))
        return largest < max(_SAME * self._settings.accuracy, self._settings.tolerance)

    def _from_guesses(self, starts: Iterable[tuple[str, Iterate]]) -> Iterator[list[Solution]]:
        """Solution of each guess, from this guess alone; where there is none, the given guess itself, or nothing."""
        problem, settings = self._narrow, self._settings
        free = [bound for bound in problem.bounds if bound.quantity != DISTANCE]
        kept = [bound for bound in free if not bound.of_file]
        # Motions without the bounds of distances lead past obstacles. Their iterations cost a small part of those with
        # distances, and they are a good start for them.
        apart = problem.changed(bounds=kept) if len(free) < len(problem.bounds) else None
        for name, start in starts:
            self._tried += 1
            try:
                if apart is not None and name.startswith(_RELAXED):
                    start = SequentialQuadratic(apart, settings).solve(start).iterate
                found = replace(solve_bounded(problem, settings, start), guess=name)
                if found.outcome != "infeasible":
                    self._solved += 1
                    yield [found]
                    continue
                self._failed.append(found)
            except RncError as error:
                self._error = error
            yield self._unimproved()

    def _refined(self, solution: Solution) -> _Made:
        """Plan of a solution, improved until its verification confirms it.

        The intervals are halved until the inputs alone keep everything within the accuracy, too. If halving them no
        longer helps without feedback, but the motion with feedback is confirmed, the motion is unstable. At first,
        distances are as much larger as the accuracy, where there is room; at last, the nodes next to places that come
        too near to something keep a larger distance. Velocities and outputs that pass their limits between nodes, by
        about the square of the length of the intervals, have narrower limits at once.
        """
        settings, problem = self._settings, self._problem
        refined = 2  # times the iterations from a guess: those of all improvements of its solution
        self._left, before, at = refined * settings.iterations, np.inf, solution.iterate
        lacking = solution.iterations and problem.worst(problem.values(at), at.duration).amount > settings.tolerance
        made = self._improved(problem, solution) if lacking else None
        problem = self._narrow if lacking and made is None else problem
        found = [made or self._completed(problem, solution)]
        for _ in range(settings.refinements):
            made = found[-1]
            alone = made.alone.violation
            helps = 2.0  # factor by which halved intervals reduce a violation that they cause
            # Errors of second order fall by four when intervals are halved. One that falls by less than two belongs to
            # an unstable motion, which feedback has to hold.
            if alone <= settings.accuracy or (alone > before / helps and made.confirmed):
                break
            K, before = 2 * problem.K, alone
            # Between nodes, rows pass their limits by the square of the interval: a quarter of it will be left.
            margins = problem.margins | self._margins(problem, made, ("velocity", "output"), 0.25)
            finer = problem.changed(K=K, margins={name: np.full(K + 1, each[1]) for name, each in margins.items()})
            after = self._improved(finer, made.solution)
            if after is None:
                break
            problem = finer
            found.append(after)
        tightened = 4  # times that nodes near places that come too close get a larger distance
        for _ in range(tightened):
            made = found[-1]
            beyond = [each.quantity for each in made.excesses if each.amount > settings.accuracy]
            # Margins help rows between nodes alone: a goal that is missed, or inputs, have none.
            if not beyond or set(beyond) - {DISTANCE, "velocity", "output"}:
                break
            problem = problem.changed(margins=problem.margins | self._margins(problem, made, beyond, 1.0))
            after = self._improved(problem, made.solution)
            if after is None:
                break
            found.append(after)
        return found[-1] if found[-1].confirmed else min(found, key=_violation)

    def _margins(self, problem: Transcription, made: _Made, kinds: Sequence[str], share: float) -> dict[str, Array]:
        """Margins of rows that are violated by more than the accuracy, for a share of the violation.

        Distances have margins next to places that come too near, other rows at all nodes. The goal keeps its place, so
        that the last node has none.
        """
        margins, h = dict[str, Array](), made.unverified.duration / problem.K
        for each in made.excesses:
            if each.quantity not in kinds or share * each.amount <= self._settings.accuracy:
                continue
            name, near = each.title, slice(0, problem.K)
            if each.quantity == DISTANCE:
                k = min(int(each.time / h), problem.K - 1)
                name, near = DISTANCE, slice(k, min(k + 2, problem.K))
            before = problem.margins.get(name, np.zeros(problem.K + 1))
            margins[name] = now = margins.get(name, before).copy()
            now[near] = np.maximum(now[near], before[near] + share * each.amount)
        return margins

    def _improved(self, problem: Transcription, solution: Solution) -> _Made | None:
        """Plan of a similar problem, solved from another solution; None if this fails, or no iterations are left."""
        start = solution.iterate
        finer = problem.K / self._problem.K
        # An iteration takes time in proportion to the number of intervals.
        most = min(int(self._left / finer), self._settings.iterations)
        if most < 1:
            self._spent = True
            return None
        if len(start.u) != problem.K:
            start = resampled(problem.model, start, problem.K)
        try:
            fewer = replace(self._settings, iterations=most)
            found = solve_bounded(problem, fewer, start, solution.weight)
        except RncError:
            return None
        self._left -= finer * found.iterations
        if found.outcome == "infeasible":
            self._spent |= found.iterations >= most
            return None
        total = found.iterations + solution.iterations
        return self._completed(problem, replace(found, iterations=total, guess=solution.guess))

    def _completed(self, problem: Transcription, found: Solution) -> _Made:
        """Plan of a solution with its verification."""
        at, model, settings = found.iterate, problem.model, self._settings
        reduced, time = model.reduced, np.linspace(0.0, at.duration, problem.K + 1)
        states = tuple(reduced.robot.velocity_names)
        if model.nw:
            states += tuple(f"{each} (rate)" for each in reduced.reducing.names)
        names = model.input_names, states, (*reduced.reducing.names, *reduced.vertical.names)
        alone, beyond = verify_inputs(problem, at, settings.substeps, settings.accuracy)
        info = PlanInfo(
            model.form, *names, found.cost, found.violation.amount, found.violation.name, found.iterations, found.guess,
            found.outcome, PlanVerification(alone, None, settings.substeps, self._loop.dt), settings.accuracy,
            self._tried, self._solved, problem.limits,
        )  # fmt: skip
        (q, w, u), K = map(np.array, (at.q, at.w, at.u)), problem.feedback_gains(at, found.linear)
        plan = MotionPlan(time, q, w, u, K, *output_nodes(model, at), info)
        return _Made(problem, plan, found, alone, beyond, self._loop)

    # ------------------------------------------------------------------ refusal

    def _refusal(self) -> InfeasibleError:
        if self._rejected:
            return self._unverified()
        if not self._failed:
            text = f"no plan: no guess can be evaluated: {self._error}"
            return InfeasibleError(f"{text}; give another guess, or other reducing outputs")
        # The guess that comes nearest tells most about what is missing.
        best = min(self._failed, key=lambda each: each.violation.amount)
        worst, duration = best.violation, best.iterate.duration
        found = InfeasibleError(
            f"no plan in {duration:.4g} s: {worst.name} is violated by {worst.amount:.3g} at t = {worst.time:.4g} s "
            f"(best of {self._tried} guesses: {best.guess}); allow more time, wider bounds or more seeds"
        )
        with suppress(RncError, np.linalg.LinAlgError):  # e.g. the motion is singular, so that it has no outputs
            found.plan = self._completed(self._problem, best).plan
        return found

    def _unverified(self) -> InfeasibleError:
        made = min(self._rejected, key=_violation)
        plan, excesses = made.plan, made.excesses
        again = "re-integration" if self._loop.feedback is None else f"a loop with samples of {self._loop.dt:g} s"
        intervals, guesses = f"up to {len(plan.u)} intervals", f"{self._solved} of {self._tried} guesses"
        allowed = "iterations (improvements took all of theirs)" if self._spent else "refinements"
        found = InfeasibleError(
            f"no verified plan in {plan.duration:.4g} s: after {again}, {excess_text(excesses[0])}; "
            f"the accuracy is {self._settings.accuracy:g}; tried {intervals} and {guesses} that have solutions "
            f"(best: {plan.info.guess}, different: {len(self._vain)}); "
            f"allow more {allowed}, more seeds, or a larger accuracy"
        )
        found.plan = plan
        return found


def _violation(made: _Made) -> tuple[bool, float]:
    """Order of plans: confirmed ones first, then by the largest violation in both integrations."""
    found = made.plan.info.verification
    return not made.confirmed, max(found.violation, found.inputs.violation) if made.confirmed else found.violation
