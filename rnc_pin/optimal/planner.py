"""Planning of optimal motions."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.errors import ConfigurationError, InfeasibleError, InputError, ModelWarning, RncError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.optimal.action_models import ActionModel, Form, Nodes, action_model
from rnc_pin.optimal.bounds import DISTANCE, BoundKind, DistanceBound, GoalRows
from rnc_pin.optimal.costs import CostKind, EffortCost, OutputCost
from rnc_pin.optimal.feedback_gains import feedback_gains
from rnc_pin.optimal.guesses import guesses, resampled
from rnc_pin.optimal.motion_plan import MotionPlan, PlanInfo
from rnc_pin.optimal.plan_outputs import output_nodes
from rnc_pin.optimal.sequential_quadratic import SequentialQuadratic, Solution, SolverSettings
from rnc_pin.optimal.transcription import Transcription
from rnc_pin.optimal.verification import verify_inputs
from rnc_pin.planning.references import Reference

_DEFAULT = SolverSettings()


def plan_motion(
    reduced: ReducedModel,
    q0: Any,
    goal: Any,
    duration: float | tuple[float, float],
    *,
    form: Form = "acceleration",
    costs: Sequence[CostKind] | None = None,
    bounds: Sequence[BoundKind] = (),
    settings: SolverSettings = _DEFAULT,
    guess: Any = None,
    seeds: int = 6,
    seed: int = 0,
    solutions: int = 1,
    v2_0: Any = None,
    at_rest: bool = True,
    time_weight: float = 0.0,
) -> MotionPlan:
    """Return an optimal motion of a reduced system from a configuration to a goal.

    Inputs are constant over equal intervals. The goal and the bounds hold at the nodes. The straight line is the first
    guess; nonholonomic systems often need one of the random guesses. The result is a local optimum: with ``solutions``
    above 1, several guesses are solved and the cheapest plan is returned. It is always verified by re-integration with
    a fine step (``info.verification``).

    Args:
        reduced: the model.
        q0: initial configuration (nq,).
        goal: values by output (name or object), a configuration (nq,), or None for terminal costs only.
        duration: duration [s], or its shortest and longest value for a free duration.
        form: "kinematic" (input v2), "acceleration" (input v2_dot) or "dynamic" (input T).
        costs: costs; ``[EffortCost()]`` by default.
        bounds: hard bounds.
        settings: settings of the solver.
        guess: another plan, or configurations (n, nq) at equal times; the straight line by default.
        seeds: number of random guesses that are tried if the first does not lead to a plan.
        seed: seed of the random guesses.
        solutions: number of plans among which the cheapest is returned.
        v2_0: initial reduced velocity (r,); zero by default. The kinematic form has none.
        at_rest: True if the motion ends at rest.
        time_weight: cost of a free duration [1/s].

    Raises:
        InfeasibleError: no guess led to a motion within tolerance; the message names the violated constraint.
        ConfigurationError: unknown form or output, or a combination that is not possible.
        InputError: wrong shapes, or a duration that is not positive.

    Warns:
        ModelWarning: refinements do not reach the accuracy, or derivatives are finite differences.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> beside = {rnc.FramePosition("sleigh", "xy"): [0.0, 1.0], rnc.FrameYaw("sleigh"): 0.0}
        >>> slow = [rnc.optimal.VelocityBound(-1.0, 1.0)]
        >>> plan = rnc.optimal.plan(reduced, robot.configuration(), beside, 6.0, bounds=slow)
        >>> bool(plan.info.verification.violation < 1e-2)
        True
    """
    problem = build_problem(
        reduced, q0, goal, duration, form, costs, bounds, settings.nodes, v2_0, at_rest, time_weight
    )
    _warn_of_differences(problem)
    solver = SequentialQuadratic(problem, settings)
    found: list[tuple[str, Solution]] = []
    failed: list[tuple[str, Solution]] = []
    relaxed = _without_distances(problem, settings)
    for name, start in guesses(problem, goal, guess, seeds, seed):
        try:
            solution = solver.solve(start if relaxed is None or name == "given" else relaxed.solve(start).iterate)
        except RncError as error:
            if not seeds:
                raise InfeasibleError(f"no plan: the guess cannot be evaluated: {error}") from None
            continue
        (failed if solution.outcome == "infeasible" else found).append((name, solution))
        if len(found) >= max(1, solutions):
            break
    if not found:
        raise InfeasibleError(_refusal(failed, problem))
    name, best = min(found, key=lambda each: each[1].cost)
    made = _completed(problem, name, best, settings)
    for _ in range(settings.refinements):
        if made.info.verification.violation <= settings.accuracy:
            break
        problem = problem.with_intervals(2 * problem.K)
        finer = SequentialQuadratic(problem, settings).solve(resampled(problem.model, best.iterate, problem.K))
        if finer.outcome == "infeasible":
            break
        finer.iterations += best.iterations
        best, made = finer, _completed(problem, name, finer, settings)
    _warn_of_inaccuracy(made, settings)
    return made


def build_problem(
    reduced: ReducedModel,
    q0: Any,
    goal: Any,
    duration: float | tuple[float, float],
    form: str,
    costs: Sequence[CostKind] | None,
    bounds: Sequence[BoundKind],
    nodes: int,
    v2_0: Any = None,
    at_rest: bool = True,
    time_weight: float = 0.0,
) -> Transcription:
    """Return the optimal control problem of ``plan``."""
    model = action_model(reduced, form)
    limits = _duration(duration)
    costs = [EffortCost()] if costs is None else list(costs)
    for cost in costs:
        if not isinstance(cost, CostKind):
            raise ConfigurationError(f"costs: expected costs of rnc.optimal, found {cost!r}")
    for bound in bounds:
        if not isinstance(bound, BoundKind):
            raise ConfigurationError(f"bounds: expected bounds of rnc.optimal, found {bound!r}")
    if limits[1] > limits[0]:
        _check_free(costs, bounds)
    if nodes < 2:
        raise InputError(f"nodes: expected at least 2, found {nodes}")
    return Transcription(
        model,
        _start(model, q0, v2_0),
        nodes,
        [cost.bind(model) for cost in costs],
        [bound.bind(model) for bound in bounds],
        None if goal is None else GoalRows(model, goal, at_rest),
        limits,
        time_weight,
    )


def _start(model: ActionModel, q0: Any, v2_0: Any) -> Nodes:
    if model.form == "kinematic" and v2_0 is not None:
        raise ConfigurationError("v2_0: the kinematic form has no initial velocity; use 'acceleration' or 'dynamic'")
    state = model.reduced.at(q0, np.zeros(model.r) if v2_0 is None else v2_0)
    if state.q.ndim != 1:
        raise InputError(f"q0: expected one configuration, found shape {state.q.shape}")
    _ = state.v
    w = np.empty((1, 0)) if model.form == "kinematic" else np.array(state.v2)[None]
    return Nodes(np.array(state.q)[None], w)


def _duration(given: Any) -> tuple[float, float]:
    try:
        low, high = given if np.ndim(given) else (given, given)
        low, high = float(low), float(high)
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


def _warn_of_differences(problem: Transcription) -> None:
    """Warn if the model has functions of a user, whose derivatives are finite differences."""
    reduced, start = problem.model.reduced, problem.start
    moving = state_derivatives(reduced, start.q[0], np.ones(reduced.r), np.ones(reduced.p))  # at rest, rates vanish
    error = float(np.max(moving.difference_error))
    if error > 0:
        text = f"derivatives of user-defined rows or outputs are finite differences (error {error:.1g} at the start)"
        warnings.warn(f"plan: {text}; nodes are evaluated one at a time", ModelWarning, stacklevel=3)


def _warn_of_inaccuracy(made: MotionPlan, settings: SolverSettings) -> None:
    """Warn if refinements were allowed and the verification still finds more than the accuracy."""
    found = made.info.verification
    if settings.refinements and found.violation > settings.accuracy > 0:
        text = f"{found.name} is violated by {found.violation:.2g} at t = {found.at:.3g} s without feedback"
        remedy = "allow more refinements, or judge a run with feedback if the motion is unstable"
        text = f"{text}, above the accuracy {settings.accuracy:g}, with {len(made.u)} intervals"
        warnings.warn(f"plan: {text}; {remedy}", ModelWarning, stacklevel=3)


def _without_distances(problem: Transcription, settings: SolverSettings) -> SequentialQuadratic | None:
    """Solver without the bounds of distances, whose motions lead past obstacles; None if there are none.

    Its iterations cost a small part of those with distances, and its solution is a good start for them.
    """
    kept = [bound for bound in problem.bounds if bound.quantity != DISTANCE]
    if len(kept) == len(problem.bounds):
        return None
    return SequentialQuadratic(problem.with_bounds(kept), settings)


def _refusal(failed: list[tuple[str, Solution]], problem: Transcription) -> str:
    if not failed:
        return "no plan: every guess met a singular configuration; give a guess, or other reducing outputs"
    name, best = min(failed, key=lambda each: each[1].violation.amount)
    worst = best.violation
    return (
        f"no plan in {best.iterate.duration:.4g} s: {worst.name} is violated by {worst.amount:.3g} at "
        f"t = {worst.time:.4g} s (best of {len(failed)} guesses: {name}); allow more time, wider bounds or more seeds"
    )


def _completed(problem: Transcription, name: str, found: Solution, settings: SolverSettings) -> MotionPlan:
    at, model = found.iterate, problem.model
    position, velocity, acceleration = output_nodes(model, at)
    reduced = model.reduced
    states = tuple(reduced.robot.velocity_names)
    if model.nw:
        states += tuple(f"{each} (rate)" for each in reduced.reducing.names)
    info = PlanInfo(
        form=model.form,
        input_names=model.input_names,
        state_names=states,
        output_names=(*reduced.reducing.names, *reduced.vertical.names),
        cost=found.cost,
        violation=found.violation.amount,
        violated=found.violation.name,
        iterations=found.iterations,
        guess=name,
        outcome=found.outcome,
        verification=verify_inputs(problem, at, settings.substeps),
        bounds=_limits_of(problem),
    )
    return MotionPlan(
        time=np.linspace(0.0, at.duration, problem.K + 1),
        q=np.array(at.q),
        w=np.array(at.w),
        u=np.array(at.u),
        K=feedback_gains(problem, at),
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        info=info,
    )


def _limits_of(problem: Transcription) -> tuple[tuple[str, str, float, float], ...]:
    return tuple(
        (bound.quantity, name, float(low), float(high))
        for bound in problem.bounds
        for name, low, high in zip(bound.names, bound.lower, bound.upper, strict=True)
        if bound.quantity not in ("", DISTANCE)
    )
