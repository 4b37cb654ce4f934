"""Verification of plans: their inputs integrated with a fine step, the sampled loop that will run, and findings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.collision import continuous_distances
from rnc_pin.errors import DivergenceError, RncError
from rnc_pin.motion.optimal.bounds import DistanceRows
from rnc_pin.motion.optimal.motion_plan import Integration, MotionPlan, PlanVerification
from rnc_pin.motion.optimal.plan_feedback import FeedbackState, PlanFeedback
from rnc_pin.motion.optimal.transcription import Iterate, Transcription
from rnc_pin.motion.planning.action_models import FORMS, Nodes
from rnc_pin.plants import ReducedPlant
from rnc_pin.verdict import Finding, FindingKind, Severity

CONTACT = 1e-6  # [m], error of a measured distance
_INPUTS = {"kinematic": FindingKind.VELOCITY, "acceleration": FindingKind.ACCELERATION, "dynamic": FindingKind.EFFORT}
_KINDS = {"output": FindingKind.POSITION} | {kind: FindingKind(kind) for kind in ("goal", "velocity", "slip")}


class RunLoop(NamedTuple):
    """Sampled loop that will run a plan."""

    feedback: Callable[[MotionPlan], PlanFeedback] | None
    """Feedback along a plan; None if the inputs alone decide."""
    dt: float
    """Sampling period [s]."""
    plant: ReducedPlant | None = None
    """Plant, of which a twin moves; by default that of the model."""


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
    problem: Transcription, at: Iterate, substeps: int, accuracy: float
) -> tuple[Integration, tuple[Excess, ...]]:
    """Integrate the inputs from the start, and compare with bounds and goal at every fine step and between them.

    Returns the result, and the rows that the motion exceeds, largest first.

    Args:
        problem: the problem.
        at: the planned motion.
        substeps: integrator steps of each interval.
        accuracy: distance below a clearance up to which a motion between fine steps needs no further measurement [m].
    """
    model, h, start = problem.model, at.duration / problem.K / substeps, problem.start
    u, states = np.repeat(at.u, substeps, axis=0), np.hstack([start.q[:1], start.w[:1]])
    fast, found = model.reduced.evaluator.calls, np.empty((len(u), states.shape[1]))
    parts = np.array(start.q[0]), np.array(start.w[0]), u, np.full(len(u), h), found
    known = fast.planned_steps(FORMS.index(model.form), *parts) and np.isfinite(found).all()

    def motion() -> tuple[Iterate, float]:
        if known:
            q, w = np.split(np.vstack([states, found]), [start.q.shape[1]], axis=1)
            fine = Iterate(q, w, u, at.duration)
        else:
            fine = _stepped(start, h, len(u), lambda k, now: (model.step(now, u[k : k + 1], np.array([h])), u[k]))
        # The plan knows nodes alone; between them its states are those of coarser steps.
        reached = Nodes(fine.q[::substeps], fine.w[::substeps])
        return fine, float(np.abs(model.difference(Nodes(at.q, at.w), reached)).max())

    return _judged(problem, motion, substeps, accuracy)


def verify_loop(
    problem: Transcription, at: Iterate, controller: PlanFeedback, loop: RunLoop, accuracy: float
) -> tuple[Integration, tuple[Excess, ...]]:
    """Run the sampled loop along a plan, and compare with bounds and goal at every sample.

    Inputs are held over each sample. The plant integrates under the forces that the controller commands; the inputs of
    the form move the model if it commands velocities, or if actuators do not move all directions.

    Args:
        problem: the problem.
        at: the planned motion.
        controller: feedback along it.
        loop: the loop that will run.
        accuracy: as for ``verify_inputs``.
    """
    model, dt, start, reduced = problem.model, loop.dt, problem.start, problem.model.reduced
    # Accelerations of an underactuated system are inputs of a model alone: no actuators give them.
    rank = np.linalg.matrix_rank(reduced.at(start.q[0]).input_matrix) if reduced.p else 0
    free = model.form == "kinematic" or (model.form == "acceleration" and rank < model.r)
    plant = None if free else (loop.plant or ReducedPlant(reduced)).twin()  # the caller's plant keeps its state
    rounding = 1e-6  # of a number of samples, as of runs
    count, errors = int(np.ceil(at.duration / dt - rounding)), list[float]()
    own: FeedbackState | None = None

    def advance(k: int, now: Nodes) -> tuple[Nodes, Array]:
        nonlocal own
        # In the kinematic form the model has no velocity: the loop measures the planned one.
        v2 = now.w[0] if model.nw else controller.planned(k * dt)[1]
        state = reduced.at(now.q[0], v2) if plant is None else plant.state
        command, own = controller.step(k * dt, state.measure(np.zeros(model.r)), own)
        errors.append(float(np.abs(own.dx).max()))
        diverged = 100.0  # error of a loop whose motion diverges [m, rad, m/s or rad/s]
        if not errors[-1] < diverged:  # NaN too; a loop that explodes would take long and overflow
            raise DivergenceError("the motion diverges")
        if plant is None:
            return model.step(now, own.u[None], np.array([dt])), own.u
        # Forces go to the actuators through the allocation, as in a run.
        plant.apply(own.u if command.F is None else state.allocate(command.F))
        plant.advance(dt)
        return Nodes(np.array(plant.state.q)[None], np.array(plant.state.v2)[None]), own.u

    def motion() -> tuple[Iterate, float]:
        if plant is not None:
            plant.reset(start.q[0], np.array(reduced.at(start.q[0], start.w[0]).v))
        fine = _stepped(start, dt, count, advance)
        # The last sample may end after the plan: the deviation is that from the motion which follows it.
        end = model.difference(controller.planned(count * dt)[0], Nodes(fine.q[-1:], fine.w[-1:]))
        return fine, max(*errors, float(np.abs(end).max()))

    return _judged(problem, motion, 1, accuracy)


class _Interrupted(Exception):
    """The integration cannot continue, e.g. at a singular configuration or because the motion diverges."""

    def __init__(self, reason: str, time: float) -> None:
        super().__init__(reason)
        self.time = time


def _judged(
    problem: Transcription, motion: Callable[[], tuple[Iterate, float]], substeps: int, accuracy: float
) -> tuple[Integration, tuple[Excess, ...]]:
    """Result of a motion that returns its states and its deviation from the plan."""
    try:
        fine, deviation = motion()
        found = sorted(_excesses(problem, fine, substeps, accuracy), key=lambda each: -each.amount)
    except _Interrupted as error:
        found = [Excess("integration", f"re-integration: {error}", np.inf, "", error.time, np.nan, np.nan)]
        deviation = np.inf
    worst = (found[0].amount, found[0].title, found[0].time) if found else (0.0, "", 0.0)
    return Integration(*worst, deviation), tuple(found)


def _stepped(now: Nodes, h: float, count: int, advance: Callable[[int, Nodes], tuple[Nodes, Array]]) -> Iterate:
    """Motion of a number of steps, each with its input."""
    found = [(now.q[0], now.w[0], np.empty(0))]
    for k in range(count):
        try:
            now, u = advance(k, now)
            if not (np.isfinite(now.q).all() and np.isfinite(now.w).all()):
                raise DivergenceError("the motion diverges")
        except RncError as error:
            raise _Interrupted(str(error), k * h) from None
        found.append((now.q[0], now.w[0], u))
    q, w, inputs = zip(*found, strict=True)
    return Iterate(np.array(q), np.array(w), np.array(inputs[1:]), count * h)


def _excesses(problem: Transcription, fine: Iterate, substeps: int, accuracy: float) -> Iterator[Excess]:
    """Largest excess of each row that a fine motion exceeds."""
    # A problem over the fine steps, without margins and reserves: what counts is what was asked for.
    others = [bound for bound in problem.bounds if not isinstance(bound, DistanceRows)]
    length = (fine.duration, fine.duration)
    same = problem.changed(K=len(fine.u), costs=[], bounds=others, duration=length, reserve=0.0, margins={})
    times = same.times(fine.duration)
    try:
        rows = same.rows(fine)
    except RncError as error:
        raise _Interrupted(str(error), 0.0) from None
    for block, where in same.blocks:
        values, low, high = rows[:, where], same.lower[:, where], same.upper[:, where]
        # Inputs jump, and the goal holds at one time: neither has a peak between steps.
        peaks = _peaks(values, substeps) if block.of_state and block is not problem.goal else np.zeros(values.shape)
        beyond = np.maximum(low - values, values - high) + peaks
        for row, at in enumerate(beyond.argmax(axis=0).tolist()):
            amount, value, time = float(beyond[at, row]), float(values[at, row]), float(times[at])
            if amount > 0:
                limit = float(high[at, row] if value - high[at, row] > low[at, row] - value else low[at, row])
                yield Excess(block.quantity, block.titles[row], amount, block.units[row], time, value, limit)
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
    # Where three samples do not turn, the largest is at an end, which is a sample itself.
    turning = (before * after <= 0) & (bend > 0)
    found = (after + before) ** 2 / np.where(bend > 0, 8 * bend, 1.0)
    peaks[1:-1] = np.where(turning, found, 0.0)
    peaks[::substeps] = 0.0
    return peaks


def _too_near(bound: DistanceRows, times: Array, q: Array, accuracy: float) -> Iterator[Excess]:
    """Pairs that come nearer than the clearance at any time, or of which this is not certain."""
    # Half of the accuracy: what bounds between steps leave open stays below what is accepted.
    found = continuous_distances(bound.distances, times, q, bound.clearance, 0.5 * accuracy)
    for k, pair in enumerate(bound.distances.pairs):
        # A pair of which nothing is certain, as in a motion that diverges, counts as touching.
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
    beyond = f"beyond the limit {excess.limit:.4g} by {excess.amount:.3g}"
    return f"{excess.title} is {excess.value:.4g}{unit} {when}, {beyond}"


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
        # Zero is what tools write for an unknown limit.
        unknown = name in robot.joint_names and robot.model.upperEffortLimit[robot.velocity_indices(name).start] == 0
        if not unknown or name in bounded:
            continue
        largest = int(np.abs(at.u[:, column]).argmax())
        amount, time = float(abs(at.u[largest, column])), float(largest * at.duration / problem.K)
        if amount > 0:
            text = f"the plan uses {amount:.3g} {unit} at '{name}', whose effort limit in the robot's file is 0"
            message = f"{text} and counts as not stated; state it in the file or as an InputBound"
            yield Finding(FindingKind.EFFORT, name, amount, unit, time, Severity.DEGRADES, message)
