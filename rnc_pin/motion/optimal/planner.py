"""Planning of optimal motions: the problem from the arguments of ``rnc.optimal.plan``, and its solution."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.errors import ConfigurationError, InfeasibleError, InputError, warn
from rnc_pin.model.input_validation import (
    NotNegative,
    Positive,
    admit_configuration,
    check_instances,
    check_positive_settings,
    check_settings,
    is_count,
    is_number,
)
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.optimal.bounds import BoundKind, DistanceBound, DistanceRows, FileLimits, Goal, GoalRows, NodeBound
from rnc_pin.motion.optimal.costs import CostKind, EffortCost, NodeData, OutputCost
from rnc_pin.motion.optimal.guesses import Guess, guesses, motion_limits
from rnc_pin.motion.optimal.motion_plan import MotionPlan
from rnc_pin.motion.optimal.plan_feedback import PlanFeedback, tvlqr
from rnc_pin.motion.optimal.plan_search import PlanSearch
from rnc_pin.motion.optimal.sequential_quadratic import SolverSettings
from rnc_pin.motion.optimal.transcription import Iterate, Transcription
from rnc_pin.motion.optimal.verification import CONTACT, RunLoop
from rnc_pin.motion.planning.action_models import ActionModel, Form, Nodes, action_model
from rnc_pin.motion.planning.way import Way, intervals_along
from rnc_pin.plants import ReducedPlant
from rnc_pin.references.reference import Reference


def build_problem(
    model: ActionModel,
    start: Nodes,
    goal: GoalRows | None,
    duration: float | tuple[float, float],
    costs: Sequence[CostKind] | None,
    bounds: Sequence[BoundKind],
    nodes: int,
    limits: FileLimits | None = None,
) -> Transcription:
    """Return the optimal control problem of ``plan``. Without ``limits``, those of the robot's file do not count.

    Raises:
        InfeasibleError: the goal is beyond a limit.
    """
    times = _duration(duration)
    costs = [EffortCost()] if costs is None else costs
    check_instances("costs", costs, CostKind)
    check_instances("bounds", bounds, BoundKind)
    if times[1] > times[0]:  # functions of time have no derivative by the duration
        _check_free(costs, bounds)
    if nodes < 2:
        raise InputError(f"nodes: expected at least 2, found {nodes}")
    stated = [bound.bind(model) for bound in bounds]
    of_file = (FileLimits(False, False, False) if limits is None else limits).bind(model, stated)
    if goal is not None:
        for row in (*stated, *of_file):
            if row.quantity == "output":  # refuse a goal beyond a limit at once: no motion ends there
                _compare("goal", row, goal.values_of(row))
    return Transcription(model, start, nodes, [cost.bind(model) for cost in costs], [*stated, *of_file], goal, times)


def initial_node(model: ActionModel, q0: ArrayLike, v2_0: ArrayLike | None = None) -> Nodes:
    """Return the initial state, at rest by default.

    Raises:
        ConfigurationError: a velocity in the kinematic form.
        InputError: q0 is not one configuration.
    """
    if model.form == "kinematic" and v2_0 is not None:
        raise ConfigurationError("v2_0: the kinematic form has no initial velocity; use 'acceleration' or 'dynamic'")
    q = admit_configuration(q0, model.reduced.robot, "q0")
    state = model.reduced.at(q, np.zeros(model.r) if v2_0 is None else v2_0)
    _ = state.v  # a singular start is refused here, and not as the failure of all guesses
    return Nodes(q[None], np.empty((1, 0)) if model.form == "kinematic" else np.array(state.v2)[None])


def with_reserves(problem: Transcription, settings: SolverSettings) -> Transcription:
    """Return a problem that leaves room for what its verification accepts, and for feedback.

    Distances from obstacles are larger by the accuracy, so that a verified plan keeps what was asked for; outputs and
    velocities keep a reserve. Distances at a goal are known if it is a configuration.

    Raises:
        InfeasibleError: the start violates a bound by more than the accuracy, or the goal is too near to something.
    """
    model, start, goal, accuracy = problem.model, problem.start, problem.goal, settings.accuracy
    nodes, bounds = NodeData(model, start, None, np.full(1, problem.begin)), list[NodeBound]()
    for bound in problem.bounds:
        if isinstance(bound, DistanceRows):
            # Links of one robot have no margin: many are nearer to each other by design than the accuracy.
            ends = [check_distances("start", bound, start.q[0], problem.begin, accuracy), np.inf]
            if isinstance(goal, GoalRows) and goal.configuration is not None:
                end = problem.begin + problem.duration[1]  # nothing moves if the duration is free
                ends[1] = check_distances("goal", bound, goal.configuration, end, accuracy)
            bound = bound.beyond(accuracy, *ends) if bound.distances.obstacles else bound
        elif bound.of_state and bound.quantity in ("output", "velocity"):
            values = bound.rows(nodes, False).value[0].tolist()
            _compare("start", bound, dict(zip(bound.names, values, strict=True)), accuracy)
        bounds.append(bound)
    return problem.changed(bounds=bounds, reserve=settings.reserve)


def check_distances(what: str, bound: DistanceRows, q: Array, t: float, accuracy: float) -> float:
    """Return the smallest distance of a configuration; refuse one that is nearer to something than a bound allows.

    Links of one robot are near each other by design, and a start is where the robot is: these may fall short.

    Args:
        what: "start" or "goal", for the message.
        bound: the bound.
        q: configuration (nq,).
        t: time [s].
        accuracy: shortfall that is accepted of links among themselves, and of a start [m].

    Raises:
        InfeasibleError: it is; the message names the pair.
    """
    found = bound.at(q, t)
    smallest = float(found.distance.min(initial=np.inf))
    # A goal beside obstacles is compared to the error of coal alone: the plan ends there, and nothing can improve it.
    if smallest < bound.clearance - (CONTACT if bound.distances.obstacles and what == "goal" else accuracy):
        pair = bound.distances.pairs[found.pairs[found.distance.argmin()]]
        text = f"{what}: the distance of {pair.names[0]} and {pair.names[1]} is {smallest:.4g} m, below the"
        raise InfeasibleError(f"{text} clearance of {bound.clearance:g} m; choose another {what}, or ask for less")
    return smallest


def _duration(given: float | tuple[float, float]) -> tuple[float, float]:
    try:
        low, high = map(float, given if isinstance(given, Iterable) else (given, given))
    except (TypeError, ValueError):
        raise InputError(f"duration: expected a number or (shortest, longest), found {given!r}") from None
    if not 0 < low <= high < np.inf:
        raise InputError(f"duration: expected 0 < shortest <= longest, found {given!r}")
    return low, high


def _check_free(costs: Sequence[CostKind], bounds: Sequence[BoundKind]) -> None:
    for cost in costs:
        if isinstance(cost, OutputCost) and isinstance(cost.target, Reference):
            raise ConfigurationError("free duration: a cost follows a reference over time; give one duration")
        if callable(getattr(cost, "weight", None)):
            raise ConfigurationError("free duration: a weight depends on time; give one duration")
    for bound in bounds:
        if isinstance(bound, DistanceBound) and any(each.motion for each in bound.distances.obstacles):
            raise ConfigurationError("free duration: an obstacle moves over time; give one duration")


def _compare(what: str, bound: NodeBound, values: dict[str, float], room: float = 0.0) -> None:
    for name, title, low, high in zip(bound.names, bound.titles, bound.lower, bound.upper, strict=True):
        value = values.get(name)
        at_a_limit = 1e-9  # of a value at its limit
        around = [max(room, at_a_limit * max(1.0, abs(limit))) for limit in (low, high)]
        if value is None or low - around[0] <= value <= high + around[1]:
            continue
        side, limit = ("above", high) if value > high else ("below", low)
        source = f" of the robot's file ({bound.remedy})" if bound.remedy else " of its bound"
        raise InfeasibleError(f"{what}: {title} = {value:.6g} is {side} the limit {limit:.6g}{source}")


# ------------------------------------------------------------------ planning

_USUAL = 5  # guesses among whose solutions the cheapest is chosen, where the straight line does not hold the rows
_DEFAULT, _OF_FILE = SolverSettings(), FileLimits()

RunFeedback = Literal["tvlqr", "plan"] | Callable[[MotionPlan], PlanFeedback | ArrayLike] | None
"""Feedback that a run will use: ``rnc.tvlqr(reduced, plan)``, the gains of the plan, a function from a plan to its
``PlanFeedback`` or to gains (K, nu, nx), or None for the inputs alone."""


def plan_motion(
    reduced: ReducedModel,
    q0: ArrayLike,
    goal: Goal | None,
    duration: float | tuple[float, float],
    *,
    form: Form = "acceleration",
    costs: Sequence[CostKind] | None = None,
    bounds: Sequence[BoundKind] = (),
    limits: FileLimits | None = _OF_FILE,
    settings: SolverSettings = _DEFAULT,
    guess: Guess = None,
    seeds: Annotated[int, Ge(0), Le(1000)] = 6,
    seed: int = 0,
    solutions: Annotated[int, Ge(1), Le(1000)] | None = None,
    v2_0: ArrayLike | None = None,
    at_rest: bool = True,
    time_weight: NotNegative = 0.0,
    feedback: RunFeedback = "tvlqr",
    dt: Positive = 0.01,
    plant: ReducedPlant | None = None,
) -> MotionPlan:
    """Return an optimal motion of a reduced system from a configuration to a goal.

    Inputs are constant over equal intervals. The goal and the bounds hold at the nodes. The straight line is the first
    guess. The result is a local optimum. If the rows do not allow the straight line, a few guesses are solved, and the
    cheapest plan is returned; ``solutions`` tells how many have to lead to one.

    Verification decides. A fine step integrates the inputs alone; then the loop runs that will run the plan, sample by
    sample, with its feedback and plant. Goal, bounds and distances count at every step or sample. A plan that violates
    one by more than ``settings.accuracy`` is solved again with half the intervals' length, then from the other guesses.
    If the refinements do not help without feedback, the loop decides: the motion may be unstable.

    Args:
        reduced: the model.
        q0: initial configuration (nq,).
        goal: values by output (name or object), a configuration (nq,), or None for terminal costs only.
        duration: duration [s], or its shortest and longest value for a free duration.
        form: "kinematic" (input v2), "acceleration" (input v2_dot) or "dynamic" (input T).
        costs: costs; ``[EffortCost()]`` by default.
        bounds: hard bounds. They replace limits of the robot's file for the same rows.
        limits: limits of the robot's file that hold too: all by default; None for none. Positions and velocities hold
            in every form, efforts in the form "dynamic".
        settings: settings of the solver.
        guess: another plan, a way of ``find_way``, or configurations (n, nq) at equal times; the straight line by
            default. If the configurations of a way do not lead to a plan, a motion along it is the guess that stops
            where the velocity of the way jumps; the number of nodes is doubled for it, at most three times. If nothing
            better than a given guess is found, and the verification confirms it, it is the plan.
        seeds: number of further guesses that are tried if others do not lead to a plan. The first ones pass both sides
            of obstacles in the way of a mobile base. Shortest paths of a car in turn with random motions follow, for
            other systems loops of the shape where the rows couple the rest to it, then random motions.
        seed: seed of the random guesses.
        solutions: number of solutions among which the cheapest is returned. If fewer guesses lead to some, a warning
            and ``info.solutions`` tell. By default those of the first five guesses if the rows do not allow the
            straight line, no distances or contact forces are bounded and no guess is given; else one.
        v2_0: initial reduced velocity (r,); zero by default. The kinematic form has none.
        at_rest: True if the motion ends at rest.
        time_weight: cost of a free duration [1/s].
        feedback: feedback that the run will use: "tvlqr" for ``rnc.tvlqr(reduced, plan)``, "plan" for the gains of the
            plan, a function from a plan to its ``PlanFeedback`` or to gains, or None if it drives the inputs alone.
        dt: sampling period of the loop that will run the plan [s], which ``plan.info.verification`` states.
        plant: plant of the run, with its damping, friction and clipping; ``ReducedPlant(reduced)`` by default. In the
            kinematic form and without all actuators, inputs held over each sample move the model.

    Raises:
        InfeasibleError: no guess led to a verified motion; the message names the violated row and what was tried, and
            ``error.plan`` is the best plan. Or the start or the goal is beyond a limit.
        ConfigurationError: unknown form or output, or a combination that is not possible.
        InputError: wrong shapes, or a duration that is not positive.

    Warns:
        ModelWarning: derivatives are finite differences, or there are fewer solutions than asked for.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> beside = {rnc.FramePosition("sleigh", "xy"): [0.0, 1.0], rnc.FrameYaw("sleigh"): 0.0}
        >>> slow = [rnc.optimal.VelocityBound(-1.0, 1.0)]
        >>> plan = rnc.optimal.plan(reduced, robot.configuration(), beside, 6.0, bounds=slow)
        >>> plan.info.outcome, plan.verdict.succeeded
        ('solved', True)
    """
    model = action_model(reduced, form)
    end = None if goal is None else GoalRows(model, goal, at_rest)
    start = initial_node(model, q0, v2_0)
    wanted = solutions or 1
    check_settings(settings)
    check_positive_settings(dt=dt)
    for name, count, least in (("seeds", seeds, 0), ("solutions", wanted, 1)):
        if not is_count(count, least):
            raise ConfigurationError(f"{name}: expected an integer of at least {least}, found {count!r}")
    if not (is_number(time_weight) and time_weight >= 0):
        raise ConfigurationError(f"time_weight: expected a number of at least 0, found {time_weight!r}")

    damped = plant is not None and plant.joint_damping
    loop = RunLoop(None if feedback is None else partial(_regulator, reduced, feedback, damped), dt, plant)

    def solved(guess: Guess, settings: SolverSettings, seeds: int) -> MotionPlan:
        problem = build_problem(model, start, end, duration, costs, bounds, settings.nodes, limits)
        problem.time_weight = time_weight
        problem = with_reserves(problem, settings)  # after the refusals above, which count the limits themselves
        _warn_of_differences(problem)
        starts = guesses(problem, goal, guess, seeds + wanted - 1, seed)
        first = next(starts)
        count, enough = wanted, np.inf
        # At rest a nonholonomic robot cannot leave the straight line to first order: the solution nearest to it need
        # not be the cheapest. A guess of the caller says which one is wanted.
        if solutions is None and seeds and guess is None:
            count, enough = _USUAL if _bends(problem, first[1]) else 1, _USUAL
        return PlanSearch(problem, settings, loop).run(first, starts, count, enough)

    if isinstance(guess, Way) and not guess.v.any():
        guess = guess.q[[0, -1]]  # a way that stays has no pieces
    if isinstance(guess, Way):
        longest = _duration(duration)[1]
        # The configurations of a way alone first: a motion that need not stop at its nodes is smoother and faster.
        if wanted == 1:
            with suppress(InfeasibleError):
                points = 400  # of a way
                return solved(guess.at(np.linspace(0.0, guess.duration, points)), settings, 0)
        most = motion_limits(build_problem(model, start, end, duration, costs, bounds, settings.nodes, limits))
        settings = replace(settings, nodes=intervals_along(guess, settings.nodes, longest, most))
    made = solved(guess, settings, seeds)
    if made.info.solutions < wanted:
        found, tried = made.info.solutions, made.info.guesses
        text = f"plan: {found} solutions instead of {wanted}: the other {tried - found} of {tried} guesses led to none"
        warn(f"{text}; allow more seeds or iterations")
    return made


def _bends(problem: Transcription, line: Iterate) -> bool:
    """True if rows do not allow the straight line, and no bounds make each solution expensive."""
    if any(isinstance(each, DistanceRows) and each.distances.obstacles for each in problem.bounds):  # it takes long
        return False
    # The part of the line's velocity that reduced velocities give back: all of it, where the rows allow the line.
    v = problem.model.manifold.difference(line.q[:-1], line.q[1:]) * problem.K / line.duration
    reduced = problem.model.reduced
    allowed = reduced.at(line.q[:-1], np.einsum("kri,ki->kr", reduced.at(line.q[:-1]).J2, v)).v
    rounding = 1e-6  # of a velocity along the straight line
    return bool(np.abs(allowed - v).max() > rounding * np.abs(v).max())


def _regulator(reduced: ReducedModel, feedback: RunFeedback, damped: bool, plan: MotionPlan) -> PlanFeedback:
    """Feedback along a plan."""
    if feedback == "tvlqr":
        return tvlqr(reduced, plan, joint_damping=damped)
    found = feedback(plan) if callable(feedback) else plan.K
    if isinstance(found, PlanFeedback):
        return found
    return PlanFeedback(reduced, plan, np.asarray(found, dtype=float), joint_damping=damped)


def _warn_of_differences(problem: Transcription) -> None:
    """Warn if the model has functions of a user, whose derivatives are finite differences."""
    reduced, start = problem.model.reduced, problem.start
    moving = state_derivatives(reduced, start.q[0], np.ones(reduced.r), np.ones(reduced.p))  # at rest, rates vanish
    error = float(np.max(moving.difference_error))
    if error > 0:
        text = f"derivatives of user-defined rows or outputs are finite differences (error {error:.1g} at the start)"
        warn(f"plan: {text}; nodes are evaluated one at a time")


plan = plan_motion
"""Name of the export; a scenario has another ``plan``."""
