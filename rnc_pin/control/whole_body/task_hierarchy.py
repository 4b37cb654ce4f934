"""Tasks of a program in reduced velocities, level by level: a lexicographic cascade of least squares within limits.

At each level, the rows J of its tasks are restricted to the null space Z of the levels above. In the coordinates of the
singular value decomposition of ``J Z`` the program has the identity as Hessian. So it needs no regularisation in the
directions that tasks determine, and without active limits its solution is that of linear equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.array_shapes import Float
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.least_distance import LeastDistanceSolver
from rnc_pin.control.whole_body.limit_stack import LimitStack, ProgramBounds, distinct
from rnc_pin.control.whole_body.sampled_damping import SampledDamping
from rnc_pin.control.whole_body.tasks.control_task import ControlTask
from rnc_pin.control.whole_body.tasks.output_task import BoundOutput, OutputsTogether
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.reduced_model import ReducedModel

_RANK = 1e-8  # singular value, relative to the rows of the level, below which a direction is free
_FREE_COST = 1e-3  # cost of a direction that no task determines, relative to the least determined direction
_TOUCHING = 1e-12  # relative excess of a limit that is rounding
_EXCEEDED = 1e-8  # excess of a limit above which it gave way


class TaskLevel(NamedTuple):
    """Tasks of one priority: the program minimises ``|J v2 - rate|^2``; rows are multiplied by roots of weights."""

    jacobian: Float[Array, "k r"]
    rate: Float[Array, " k"]


class CascadeSolution(NamedTuple):
    """Solution of all levels."""

    unknowns: Float[Array, " n"]
    """Reduced velocities, or inputs and contact forces."""
    multipliers: Float[Array, "levels k"]
    """Multipliers of the limits at each level; zero at a level that touches no limit."""


class TaskStack:
    """All tasks of a program.

    Args:
        tasks: the tasks.
        reduced: the model.

    Attributes:
        bound: the tasks of the model.
        names: name of each row, in the order of the tasks.
        levels: number of levels.
        curved: for each level, a mask of the rows whose Jacobian depends on the configuration.
    """

    def __init__(self, tasks: Sequence[ControlTask], reduced: ReducedModel) -> None:
        for each in tasks:
            if not isinstance(each, ControlTask):
                raise ConfigurationError(f"a task has to be a ControlTask, found {type(each).__name__}")
        self.bound = [each.bind(reduced) for each in tasks]
        self.names = distinct([name for each in self.bound for name in each.names])
        roots = [np.sqrt(t.numbers("weight", t.weight, len(b.names))) for t, b in zip(tasks, self.bound, strict=True)]
        priorities = sorted({each.priority for each in tasks})
        self.levels = len(priorities)
        order = sorted(range(len(tasks)), key=lambda k: tasks[k].priority)
        sizes = [len(self.bound[k].names) for k in order]
        stops = np.cumsum([0, *sizes]).tolist()
        places = {k: slice(start, stop) for k, start, stop in zip(order, stops[:-1], stops[1:], strict=True)}
        self._roots = np.concatenate([np.zeros(0), *(roots[k] for k in order)])
        ends = [max(places[k].stop for k in order if tasks[k].priority == priority) for priority in priorities]
        self._parts = [slice(start, stop) for start, stop in pairwise([0, *ends])]
        curved = np.repeat([not self.bound[k].constant for k in order], sizes).astype(bool)
        self.curved = [curved[part] for part in self._parts]
        outputs = [(each, places[k]) for k, each in enumerate(self.bound) if isinstance(each, BoundOutput)]
        self._outputs = OutputsTogether([each for each, _ in outputs], reduced) if outputs else None
        self._output_rows = np.concatenate([np.arange(0), *(np.arange(stops[-1])[where] for _, where in outputs)])
        self._others = [(each, places[k]) for k, each in enumerate(self.bound) if not isinstance(each, BoundOutput)]
        self._nv, self._affine = reduced.n, reduced.affine

    def at(self, sample: ControlSample) -> list[TaskLevel]:
        """Return the levels at the end of a sample."""
        roots = self._roots
        J, rate = np.empty((len(roots), self._nv)), np.empty(len(roots))
        if self._outputs is not None:
            J[self._output_rows], rate[self._output_rows] = self._outputs.rows(sample)
        for bound, where in self._others:
            J[where], rate[where] = bound.rows(sample)
        if self._affine:
            rate = rate - J @ sample.end.b
        weighted, rate = roots[:, None] * (J @ sample.end.R), roots * rate
        return [TaskLevel(weighted[part], rate[part]) for part in self._parts]


class RelaxedSolution(NamedTuple):
    """Solution of all levels within limits that may have given way."""

    unknowns: Float[Array, " n"]
    multipliers: Float[Array, "levels k"]
    excess: Float[Array, " k"]
    """Amount by which each limit gave way; zero if it did not."""


def solve_within(
    levels: Sequence[TaskLevel],
    bounds: ProgramBounds,
    limits: LimitStack,
    solver: LeastDistanceSolver,
    damping: float = 0.0,
    multipliers: Array | None = None,
    before: Sequence[Array] = (),
    sampled: SampledDamping | None = None,
) -> RelaxedSolution:
    """Solve the levels; limits that exclude each other give way.

    Args:
        levels, bounds, damping, solver, sampled: as for ``solve_cascade``.
        multipliers: multipliers of all limits in a similar program, (levels, k), to start from.
        limits: the limits, in the order in which they give way.
        before: groups of further places of the bounds that come before the limits.
    """
    start = None if multipliers is None else multipliers[:, bounds.places]
    found = solve_cascade(levels, bounds, damping, solver, start, sampled)
    if found is not None:
        return RelaxedSolution(found.unknowns, bounds.spread(found.multipliers), np.zeros(bounds.total))
    found = solve_cascade(levels, limits.relaxed(bounds, solver, before), damping, solver, None, sampled)
    if found is None:  # rounding: even the wider limits exclude each other
        found = CascadeSolution(np.zeros(bounds.rows.shape[1]), np.zeros((max(len(levels), 1), len(bounds.lower))))
    excess = bounds.excess(found.unknowns)
    excess[excess < _EXCEEDED] = 0.0
    return RelaxedSolution(found.unknowns, bounds.spread(found.multipliers), bounds.spread(excess))


def solve_cascade(
    levels: Sequence[TaskLevel],
    bounds: ProgramBounds,
    damping: float,
    solver: LeastDistanceSolver,
    multipliers: Array | None = None,
    sampled: SampledDamping | None = None,
) -> CascadeSolution | None:
    """Solve the levels from the highest to the lowest; None if no velocity satisfies the limits.

    Args:
        levels: tasks, highest level first.
        bounds: limits.
        damping: cost of the velocity at every level, which bounds it near singular configurations.
        solver: solver of the programs.
        multipliers: multipliers of a similar cascade, (levels, k), to start from.
        sampled: damping of levels that limits keep from their rates; by default none.
    """
    rows, r, k = bounds.rows, bounds.rows.shape[1], len(bounds.lower)
    levels = levels or [TaskLevel(np.zeros((0, r)), np.zeros(0))]
    found = np.zeros((len(levels), k))
    room = _TOUCHING * (1.0 + np.abs(rows).sum(axis=1))
    low, high = bounds.lower - room, bounds.upper + room
    kept, Z = np.zeros(r), None  # what higher levels determine, and the null space that they leave; None: all
    unknowns = None
    for index, (J, rate) in enumerate(levels):
        own, rate = (J, rate) if Z is None else (J @ Z, rate - J @ kept)
        least = _RANK * max(float(np.sqrt(np.vdot(J, J))), 1e-300)
        start = None if multipliers is None else multipliers[index]
        whole = _distance_form(own, rate, least, damping)
        if whole is not None:  # the level leaves nothing to lower ones
            goal, T = whole if Z is None else (whole[0], Z @ whole[1])
            ahead = kept + T @ goal
            reached = rows @ ahead
            if (reached <= high).all() and (reached >= low).all():
                unknowns = ahead
            elif (solved := _nearest(goal, T, kept, bounds, solver, start)) is not None:
                unknowns, found[index] = solved
                cost = None if sampled is None else sampled.rows(index, J @ (unknowns - ahead), rate)
                if cost is not None:
                    solved = _solve_damped(own, rate, cost, kept, Z, least, damping, bounds, solver, found[index])
                    unknowns, found[index] = solved or (unknowns, found[index])
            break
        left, values, right = np.linalg.svd(own, full_matrices=len(own) < own.shape[1])
        rank = len(values) if not len(values) or values[-1] > least else int((values > least).sum())
        values, free = values[:rank], right[rank:]
        scales = np.hypot(values, damping) if damping else values
        goal = values * (rate @ left[:, :rank]) / scales
        # Directions that the level determines, in units of its rate (r, rank).
        inward = right[:rank].T / scales if Z is None else Z @ (right[:rank].T / scales)
        ahead = kept + inward @ goal
        reached = rows @ ahead
        if (reached <= high).all() and (reached >= low).all():
            unknowns = kept = ahead
        else:
            T = inward
            if len(free):
                cheap = _FREE_COST * (float(scales[-1]) if rank else 1.0)
                T = np.hstack([inward, (free.T if Z is None else Z @ free.T) / cheap])
                goal = np.concatenate([goal, np.zeros(len(free))])
            offset = rows @ kept
            nearest = solver.solve(goal, rows @ T, bounds.lower - offset, bounds.upper - offset, start)
            if nearest is None:
                break  # at a lower level: rounding left no room
            unknowns, found[index] = kept + T @ nearest.point, nearest.multipliers
            determined = nearest.point[:rank]
            if sampled is not None and (cost := sampled.rows(index, J @ (unknowns - ahead), rate)):
                level = _damped_level(own, rate, cost, kept, Z, damping * right[:rank])
                if (damped := _solve_level(level, kept, Z, bounds, solver, found[index])) is not None:
                    unknowns, found[index] = damped
                    z = unknowns - kept if Z is None else Z.T @ (unknowns - kept)
                    determined = scales * (right[:rank] @ z)
            kept = kept + inward @ determined
        if not len(free):
            break
        Z = free.T if Z is None else Z @ free.T
    return None if unknowns is None else CascadeSolution(unknowns, found)


def _distance_form(
    own: Array, rate: Array, least: float, damping: float, more: tuple[Array, Array] | None = None
) -> tuple[Array, Array] | None:
    """Goal y (n,) and T (n, n) of rows (k, n) that determine all unknowns: with ``x = T y`` their cost is a distance.

    The triangular factor of the rows takes less time than their singular values, which a level needs that leaves
    directions free. None if the singular values may be below ``least``, or without the compiled kernel.

    Args:
        own, rate: rows and their desired values.
        least: least singular value of these rows.
        damping: cost of the unknowns.
        more: further rows and their desired values.
    """
    size = own.shape[1]
    if len(own) < size:
        return None
    numbers = np.empty((size + 1, size))
    further, values = (own[:0], rate[:0]) if more is None else more
    if not _kernel.library.least_squares(own, rate, further, values, least, damping, _RANK, numbers):
        return None
    return numbers[0], numbers[1:]


def _solve_damped(
    own: Array,
    rate: Array,
    cost: tuple[Array, Array],
    kept: Array,
    Z: Array | None,
    least: float,
    damping: float,
    bounds: ProgramBounds,
    solver: LeastDistanceSolver,
    start: Array,
) -> tuple[Array, Array] | None:
    """Unknowns and multipliers of a level that determines all unknowns, with further rows that damp it."""
    jacobian, rest = cost
    more = (jacobian, rest) if Z is None else (jacobian @ Z, rest - jacobian @ kept)
    found = _distance_form(own, rate, least, damping, more)
    if found is None:
        level = _damped_level(own, rate, cost, kept, Z, damping * np.eye(own.shape[1]))
        return _solve_level(level, kept, Z, bounds, solver, start)
    goal, T = found
    return _nearest(goal, T if Z is None else Z @ T, kept, bounds, solver, start)


def _nearest(
    goal: Array, T: Array, kept: Array, bounds: ProgramBounds, solver: LeastDistanceSolver, start: Array | None
) -> tuple[Array, Array] | None:
    """Unknowns ``kept + T y`` and multipliers, with the y nearest to a goal within the limits."""
    lower, upper = bounds.lower, bounds.upper
    if kept.any():
        offset = bounds.rows @ kept
        lower, upper = lower - offset, upper - offset
    nearest = solver.solve(goal, bounds.rows @ T, lower, upper, start)
    return None if nearest is None else (kept + T @ nearest.point, nearest.multipliers)


def _damped_level(
    own: Array, rate: Array, cost: tuple[Array, Array], kept: Array, Z: Array | None, damping: Array
) -> TaskLevel:
    """Level with further rows, which damp it, in the null space Z of the levels above."""
    jacobian, rest = cost
    inside = jacobian if Z is None else jacobian @ Z
    return TaskLevel(
        np.vstack([own, damping, inside]), np.concatenate([rate, np.zeros(len(damping)), rest - jacobian @ kept])
    )


def _solve_level(
    level: TaskLevel, kept: Array, Z: Array | None, bounds: ProgramBounds, solver: LeastDistanceSolver, start: Array
) -> tuple[Array, Array] | None:
    """Unknowns and multipliers that solve one level within the limits; None if rounding left no room."""
    J, rate = level
    left, values, right = np.linalg.svd(J, full_matrices=len(J) < J.shape[1])
    rank = int((values > _RANK * values[0]).sum())
    T = np.hstack([right[:rank].T / values[:rank], right[rank:].T / (_FREE_COST * values[rank - 1])])
    goal = np.concatenate([rate @ left[:, :rank], np.zeros(T.shape[1] - rank)])
    return _nearest(goal, T if Z is None else Z @ T, kept, bounds, solver, start)
