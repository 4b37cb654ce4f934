"""Verification of planned inputs by re-integration with a fine step, without and with feedback, and its findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.collision import continuous_distances
from rnc_pin.errors import RncError
from rnc_pin.model.evaluator import PlannedFeedback
from rnc_pin.motion.optimal.bounds import DistanceRows
from rnc_pin.motion.optimal.motion_plan import Integration, PlanVerification
from rnc_pin.motion.optimal.transcription import Iterate, Transcription
from rnc_pin.motion.planning.action_models import Nodes
from rnc_pin.verdict import Finding, FindingKind, Severity

CONTACT = 1e-6  # [m], error of a measured distance
_INPUTS = {"kinematic": FindingKind.VELOCITY, "acceleration": FindingKind.ACCELERATION, "dynamic": FindingKind.EFFORT}
_KINDS = {"output": FindingKind.POSITION} | {kind: FindingKind(kind) for kind in ("goal", "velocity", "slip")}


class Excess(NamedTuple):
    """Largest amount by which a motion is beyond a limit.

    Attributes:
        quantity: quantity of the bound: "goal", "input", "velocity", "output", "distance", "" for another bound, or
            "integration" if the motion cannot be integrated.
        title: name of the row in messages.
        amount: the excess, in ``unit``.
        unit: its unit.
        time: its time [s].
        value: value of the row there; nan if there is none.
        limit: the limit that is exceeded.
    """

    quantity: str
    title: str
    amount: float
    unit: str
    time: float
    value: float
    limit: float


def verify_inputs(
    problem: Transcription, at: Iterate, substeps: int, gains: Float[Array, "K nu nx"] | None, accuracy: float
) -> tuple[PlanVerification, tuple[Excess, ...]]:
    """Integrate the inputs from the start, and compare with bounds and goal at every fine step and between them.

    Returns the result, and the rows that the motion of the integration that decides exceeds, largest first.

    Args:
        problem: the problem.
        at: the planned motion.
        substeps: integrator steps of each interval.
        gains: gains of the feedback that the run will use; its motion then decides. None if the inputs alone decide.
        accuracy: distance below a clearance up to which a motion between fine steps needs no further measurement [m].
    """
    alone, excesses = _integrated(problem, at, substeps, None, accuracy)
    followed = None
    if gains is not None:
        followed, excesses = _integrated(problem, at, substeps, gains, accuracy)
    return PlanVerification(alone, followed, substeps), excesses


def _integrated(
    problem: Transcription, at: Iterate, substeps: int, gains: Array | None, accuracy: float
) -> tuple[Integration, tuple[Excess, ...]]:
    model = problem.model
    try:
        fine = _motion(problem, at, substeps, gains)
        found = sorted(_excesses(problem, fine, substeps, accuracy), key=lambda each: -each.amount)
    except _Interrupted as error:
        lost = Excess("integration", f"re-integration: {error}", np.inf, "", error.time, np.nan, np.nan)
        return Integration(np.inf, lost.title, error.time, np.inf), (lost,)
    planned, reached = Nodes(at.q, at.w), Nodes(fine.q[::substeps], fine.w[::substeps])
    deviation = float(np.abs(model.difference(planned, reached)).max())
    if not found:
        return Integration(0.0, "", 0.0, deviation), ()
    return Integration(found[0].amount, found[0].title, found[0].time, deviation), tuple(found)


class _Interrupted(Exception):
    """The integration cannot continue, e.g. at a singular configuration or because the motion diverges."""

    def __init__(self, reason: str, time: float) -> None:
        super().__init__(reason)
        self.time = time


def _motion(problem: Transcription, at: Iterate, substeps: int, gains: Array | None) -> Iterate:
    """Motion with a fine step. Feedback acts on the state at each step, and inputs stay within their bounds."""
    model, K = problem.model, problem.K
    h = at.duration / K / substeps
    step, now = np.array([h]), problem.start
    q, w, inputs = [now.q[0]], [now.w[0]], []
    lower, upper = input_limits(problem)
    planned = None if gains is None else _planned(problem, at, substeps, h)
    feedback = None if planned is None or gains is None else PlannedFeedback(*planned, gains, lower, upper)
    found = model.reduced.evaluator.planned_motion(model.form, (q[0], w[0]), at.u, h, substeps, feedback)
    if found is not None and all(np.isfinite(each).all() for each in found):
        return Iterate(np.vstack([now.q, found[0]]), np.vstack([now.w, found[1]]), found[2], at.duration)
    for k in range(K):
        u = at.u[k : k + 1]
        for j in range(substeps):
            try:
                if gains is not None and planned is not None:
                    place = slice(k * substeps + j, k * substeps + j + 1)
                    dx = model.difference(Nodes(planned.q[place], planned.w[place]), now)[0]
                    u = at.u[k : k + 1] + gains[k] @ dx
                    u = np.clip(u, np.minimum(lower, at.u[k]), np.maximum(upper, at.u[k]))
                now = model.step(now, u, step)
            except RncError as error:
                raise _Interrupted(str(error), (k * substeps + j) * h) from None
            if not (np.isfinite(now.q).all() and np.isfinite(now.w).all()):
                raise _Interrupted("the motion diverges", (k * substeps + j) * h)
            q.append(now.q[0])
            w.append(now.w[0])
            inputs.append(u[0])
    return Iterate(np.array(q), np.array(w), np.array(inputs), at.duration)


def _planned(problem: Transcription, at: Iterate, substeps: int, h: float) -> Nodes:
    """Planned states at all fine steps, each from the node before it, as ``PlanFeedback`` has them."""
    since = np.tile(h * np.arange(substeps), problem.K)
    nodes = Nodes(np.repeat(at.q[:-1], substeps, axis=0), np.repeat(at.w[:-1], substeps, axis=0))
    return problem.model.step(nodes, np.repeat(at.u, substeps, axis=0), since)


def input_limits(problem: Transcription) -> tuple[Array, Array]:
    """Smallest and largest inputs (nu,) of all bounds."""
    names = problem.model.input_names
    lower, upper = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    for bound in problem.bounds:
        if bound.quantity == "input":
            places = [names.index(name) for name in bound.names]
            lower[places] = np.maximum(lower[places], bound.lower)
            upper[places] = np.minimum(upper[places], bound.upper)
    return lower, upper


def _excesses(problem: Transcription, fine: Iterate, substeps: int, accuracy: float) -> Iterator[Excess]:
    """Largest excess of each row that a fine motion exceeds."""
    others = [bound for bound in problem.bounds if not isinstance(bound, DistanceRows)]
    duration = (fine.duration, fine.duration)
    same = Transcription(problem.model, problem.start, len(fine.u), [], others, problem.goal, duration)
    same.begin = problem.begin
    times = same.times(fine.duration)
    try:
        rows = same.rows(fine)
    except RncError as error:
        raise _Interrupted(str(error), 0.0) from None
    for block, where in same.blocks:
        values, low, high = rows[:, where], same.lower[:, where], same.upper[:, where]
        peaks = _peaks(values, substeps) if block.of_state and block is not problem.goal else np.zeros(values.shape)
        beyond = np.maximum(low - values, values - high) + peaks
        for row, at in enumerate(beyond.argmax(axis=0).tolist()):
            amount, value = float(beyond[at, row]), float(values[at, row])
            if amount > 0:
                limit = float(high[at, row] if value - high[at, row] > low[at, row] - value else low[at, row])
                yield Excess(
                    block.quantity, block.titles[row], amount, block.units[row], float(times[at]), value, limit
                )
    for bound in problem.bounds:
        if isinstance(bound, DistanceRows):
            yield from _too_near(bound, times, fine.q, accuracy)


def _peaks(values: Float[Array, "n k"], substeps: int) -> Float[Array, "n k"]:
    """Height of a parabola through three samples above (or depth below) the middle one, if this is an extremum.

    Slopes jump between intervals, which are samples: parabolas lie within intervals.
    """
    peaks = np.zeros(values.shape)
    before, after = values[1:-1] - values[:-2], values[2:] - values[1:-1]
    bend = np.abs(after - before)
    turning = (before * after <= 0) & (bend > 0)
    found = (after + before) ** 2 / np.where(bend > 0, 8 * bend, 1.0)
    peaks[1:-1] = np.where(turning, found, 0.0)
    peaks[::substeps] = 0.0
    return peaks


def _too_near(bound: DistanceRows, times: Array, q: Array, accuracy: float) -> Iterator[Excess]:
    """Pairs that come nearer than the clearance at any time, or of which this is not certain."""
    found = continuous_distances(bound.distances, times, q, bound.clearance, 0.5 * accuracy)
    for k, pair in enumerate(bound.distances.pairs):
        distance = 0.0 if found.uncertain[k] else float(found.smallest[k])
        if distance < bound.clearance:
            title = f"distance of {pair.names[0]} and {pair.names[1]}"
            amount = bound.clearance - distance
            yield Excess(bound.quantity, title, amount, "m", float(found.time[k]), distance, bound.clearance)


def plan_findings(
    problem: Transcription, at: Iterate, excesses: Sequence[Excess], verification: PlanVerification, accuracy: float
) -> tuple[Finding, ...]:
    """Findings of a plan: rows that it exceeds by more than the accuracy fail, and assumptions are notes."""
    form = problem.model.form
    return (
        *(_of_row(each, form) for each in excesses if each.amount > accuracy),
        *_of_instability(verification, accuracy),
        *_of_unknown_efforts(problem, at),
    )


def excess_text(excess: Excess) -> str:
    """Sentence about a row that a plan exceeds."""
    unit, when = f" {excess.unit}" if excess.unit else "", f"at t = {excess.time:.4g} s"
    if excess.quantity == "integration":
        return f"the {excess.title} ({when})"
    if excess.quantity == "goal":
        return f"{excess.title} is missed by {excess.amount:.3g}{unit} {when}"
    if excess.quantity == "distance" and excess.value < -CONTACT:
        return f"{excess.title}: they penetrate each other by {-excess.value:.3g} m {when}"
    return (
        f"{excess.title} is {excess.value:.4g}{unit} {when}, beyond the limit {excess.limit:.4g} by {excess.amount:.3g}"
    )


def _of_row(excess: Excess, form: str) -> Finding:
    if excess.quantity == "distance":
        kind = FindingKind.COLLISION if excess.value < -CONTACT else FindingKind.CLEARANCE
    else:
        kind = _INPUTS[form] if excess.quantity == "input" else _KINDS.get(excess.quantity, FindingKind.PLAN)
    where = excess.title.removeprefix("goal ").removeprefix("distance of ")
    message = f"in the verified plan, {excess_text(excess)}"
    return Finding(kind, where, excess.amount, excess.unit, excess.time, Severity.FAILS, message)


def _of_instability(verification: PlanVerification, accuracy: float) -> Iterator[Finding]:
    """Note that only feedback keeps the motion on its plan."""
    alone, followed = verification.inputs, verification.feedback
    if followed is not None and followed.violation <= accuracy < alone.violation:
        text = f"without feedback, {alone.name} is violated by {alone.violation:.3g}; with feedback by"
        message = f"{text} {followed.violation:.3g}: drive the plan with feedback"
        yield Finding(FindingKind.PLAN, alone.name, alone.violation, "", alone.at, Severity.NOTE, message)


def _of_unknown_efforts(problem: Transcription, at: Iterate) -> Iterator[Finding]:
    """Efforts of joints for which the robot's file states 0: they are unknown, so nothing bounds them."""
    model = problem.model
    robot, names = model.reduced.robot, model.input_names
    bounded = {name for bound in problem.bounds if bound.quantity == "input" for name in bound.names}
    if model.form != "dynamic":
        return
    for column, (name, unit) in enumerate(zip(names, model.reduced.actuation.units, strict=True)):
        if name in bounded or name not in robot.joint_names:
            continue
        if robot.model.upperEffortLimit[robot.velocity_indices(name).start] != 0:
            continue
        largest = int(np.abs(at.u[:, column]).argmax())
        amount, time = float(abs(at.u[largest, column])), float(largest * at.duration / problem.K)
        if amount > 0:
            text = f"the plan uses {amount:.3g} {unit} at '{name}', whose effort limit in the robot's file is 0"
            message = f"{text} and counts as not stated; state it in the file or as an InputBound"
            yield Finding(FindingKind.EFFORT, name, amount, unit, time, Severity.DEGRADES, message)
