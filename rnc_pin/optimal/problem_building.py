"""Optimal control problems from the arguments of ``rnc.optimal.plan``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.errors import ConfigurationError, InfeasibleError, InputError
from rnc_pin.optimal.action_models import ActionModel, Nodes
from rnc_pin.optimal.bounds import BoundKind, DistanceBound, DistanceRows, GoalRows, NodeBound
from rnc_pin.optimal.costs import CostKind, EffortCost, OutputCost
from rnc_pin.optimal.file_limits import FileLimits
from rnc_pin.optimal.node_data import NodeData
from rnc_pin.optimal.transcription import Transcription
from rnc_pin.planning.references import Reference

_ROUNDING = 1e-9  # of a value at its limit


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
    costs = [EffortCost()] if costs is None else list(costs)
    for cost in costs:
        if not isinstance(cost, CostKind):
            raise ConfigurationError(f"costs: expected costs of rnc.optimal, found {cost!r}")
    for bound in bounds:
        if not isinstance(bound, BoundKind):
            raise ConfigurationError(f"bounds: expected bounds of rnc.optimal, found {bound!r}")
    if not (limits is None or isinstance(limits, FileLimits)):
        raise ConfigurationError(f"limits: expected FileLimits of rnc.optimal or None, found {limits!r}")
    if times[1] > times[0]:
        _check_free(costs, bounds)
    if nodes < 2:
        raise InputError(f"nodes: expected at least 2, found {nodes}")
    stated = [bound.bind(model) for bound in bounds]
    of_file = [] if limits is None else limits.bind(model, stated)
    if goal is not None:
        _check_goal(model, goal, stated, of_file)
    return Transcription(model, start, nodes, [cost.bind(model) for cost in costs], [*stated, *of_file], goal, times)


def initial_node(model: ActionModel, q0: ArrayLike, v2_0: ArrayLike | None = None) -> Nodes:
    """Return the initial state, at rest by default.

    Raises:
        ConfigurationError: a velocity in the kinematic form.
        InputError: q0 is not one configuration.
    """
    if model.form == "kinematic" and v2_0 is not None:
        raise ConfigurationError("v2_0: the kinematic form has no initial velocity; use 'acceleration' or 'dynamic'")
    state = model.reduced.at(q0, np.zeros(model.r) if v2_0 is None else v2_0)
    if state.q.ndim != 1:
        raise InputError(f"q0: expected one configuration, found shape {state.q.shape}")
    _ = state.v
    w = np.empty((1, 0)) if model.form == "kinematic" else np.array(state.v2)[None]
    return Nodes(np.array(state.q)[None], w)


def check_start(problem: Transcription, accuracy: float) -> None:
    """Refuse a start beyond a limit or too near to something: no motion from it is within the bounds.

    Raises:
        InfeasibleError: the start violates a bound by more than the accuracy.
    """
    model, start = problem.model, problem.start
    nodes = NodeData(model, start, None, np.full(1, problem.begin))
    for bound in problem.bounds:
        if isinstance(bound, DistanceRows):
            found = bound.distances.at(start.q[0], problem.begin, within=bound.clearance)
            if found.distance.min(initial=np.inf) < bound.clearance - accuracy:
                nearest = int(found.distance.argmin())
                pair, distance = bound.distances.pairs[found.pairs[nearest]], float(found.distance[nearest])
                text = f"start: the distance of {pair.names[0]} and {pair.names[1]} is {distance:.4g} m, below the"
                raise InfeasibleError(f"{text} clearance of {bound.clearance:g} m; start elsewhere or ask for less")
        elif bound.of_state and bound.quantity in ("output", "velocity"):
            values = bound.rows(nodes, False).value[0].tolist()
            _compare("start", bound, dict(zip(bound.names, values, strict=True)), accuracy)


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


def _check_goal(model: ActionModel, goal: GoalRows, stated: Sequence[NodeBound], of_file: Sequence[NodeBound]) -> None:
    """Refuse a goal beyond a limit at once: no motion ends there."""
    for bound in (*stated, *of_file):
        if bound.quantity != "output":
            continue
        values = goal.positions
        if goal.configuration is not None:
            nodes = NodeData(model, Nodes(goal.configuration[None], np.zeros((1, model.nw))), None, np.zeros(1))
            values = dict(zip(bound.names, bound.rows(nodes, False).value[0].tolist(), strict=True))
        _compare("goal", bound, values)


def _compare(what: str, bound: NodeBound, values: dict[str, float], room: float = 0.0) -> None:
    for name, title, low, high in zip(bound.names, bound.titles, bound.lower, bound.upper, strict=True):
        value = values.get(name)
        around = [max(room, _ROUNDING * max(1.0, abs(limit))) for limit in (low, high)]
        if value is None or low - around[0] <= value <= high + around[1]:
            continue
        side, limit = ("above", high) if value > high else ("below", low)
        source = f" of the robot's file ({bound.remedy})" if bound.remedy else " of its bound"
        raise InfeasibleError(f"{what}: {title} = {value:.6g} is {side} the limit {limit:.6g}{source}")
