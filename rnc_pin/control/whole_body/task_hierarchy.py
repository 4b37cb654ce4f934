"""Tasks of a program in reduced velocities, level by level: a lexicographic cascade of least squares within limits.

At each level, the rows J of its tasks are restricted to the null space Z of the levels above. In the coordinates of the
singular value decomposition of ``J Z`` the program has the identity as Hessian. So it needs no regularisation in the
directions that tasks determine, and without active limits its solution is that of linear equations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.array_shapes import Bool, Float
from rnc_pin.control.whole_body.limit_stack import LimitStack, ProgramBounds, distinct, nearest_point
from rnc_pin.control.whole_body.limits.control_limit import ControlSample
from rnc_pin.control.whole_body.tasks import BoundOutput, ControlTask, OutputsTogether
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.reduced_model import ReducedModel

_SAMPLED_DAMPING = 2.0  # the inverse of the largest factor per sample
_ATTAINED = 1e-7  # residual, relative to the rate, that is rounding
_RANK = 1e-8  # singular value, relative to the rows of the level, below which a direction is free
_FREE_COST = 1e-3  # cost of a direction that no task determines, relative to the least determined direction
_TOUCHING = 1e-12  # relative excess of a limit that is rounding
_EXCEEDED = 1e-8  # excess of a limit above which it gave way


class SampledDamping(NamedTuple):
    """Damping of tasks that limits keep from their rates: without it, a sampled loop can oscillate between its limits.

    A level minimises ``|J v - rate|^2``. If limits leave a residual rho, the gradient ``J^T rho`` turns with the
    configuration q: its slope is ``N = sum_i rho_i d^2 x_i / dq^2``. The program decides the velocity at the end of a
    sample, at the configuration that the velocity at the start predicts there. So in a motion n that limits leave free,
    one sample of duration h multiplies a velocity by

        -h n^T N n / |J n|^2

    Near a stationary point of the residual, ``|J n|`` is small. Below -1, the velocity changes its sign at every sample
    and grows up to a limit. Heavy joints are slower because of their efforts; light joints reverse within a sample.

    A joint that rotates about an axis with the lever ``|J_i|`` has ``|N_ii| <= |rho| |J_i|``. So the cost
    ``2 h |rho| |J_i| v_i^2`` bounds the factor of a joint by 1/2, at any distance of the goal. It is zero where tasks
    attain their rates. Levenberg-Marquardt methods of inverse kinematics damp by the residual likewise (T. Sugihara,
    IEEE Transactions on Robotics 27 (2011) 984-991).
    """

    dt: float
    """Duration of the sample [s]."""
    motion: Float[Array, "r n"]
    """Reduced velocity at the end of the sample, per unknown of the program."""
    rest: Float[Array, " r"]
    """Value of ``motion`` times the unknowns at which the robot is at rest."""
    levers: Sequence[Float[Array, " r"]]
    """Norm of each column of the curved rows of each level on the reduced velocities, with the roots of weights."""
    curved: Sequence[Bool[Array, " k"]]
    """Masks of the rows of each level whose Jacobian depends on the configuration; a constant one has no slope N."""

    def rows(self, level: int, residual: Array, rate: Array) -> tuple[Array, Array] | None:
        """Return rows (r, n) of the damping and their desired values (r,); None if a level attains its rate.

        Args:
            level: index of the level.
            residual: residual of the level (k,) that limits cause: less the one that conflicting tasks have anyway. So
                the cost grows from zero when a limit becomes active.
            rate: its rate (k,).
        """
        residual = residual[self.curved[level]]
        size = float(np.sqrt(residual @ residual))
        if size <= _ATTAINED * (1.0 + float(np.sqrt(rate @ rate))):
            return None
        root = np.sqrt(_SAMPLED_DAMPING * self.dt * size * self.levers[level])
        return root[:, None] * self.motion, root * self.rest


def column_norms(jacobian: Float[Array, "k r"], curved: Bool[Array, " k"]) -> Float[Array, " r"]:
    """Return the norm of each column of the curved rows."""
    jacobian = jacobian[curved]
    return np.asarray(np.sqrt(np.einsum("kr,kr->r", jacobian, jacobian)))


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
    damping: float = 0.0,
    multipliers: Array | None = None,
    before: Sequence[Array] = (),
    sampled: SampledDamping | None = None,
) -> RelaxedSolution:
    """Solve the levels; limits that exclude each other give way.

    Args:
        levels, bounds, damping, sampled: as for ``solve_cascade``.
        multipliers: multipliers of all limits in a similar program, (levels, k), to start from.
        limits: the limits, in the order in which they give way.
        before: groups of further places of the bounds that come before the limits.
    """
    start = None if multipliers is None else multipliers[:, bounds.places]
    found = solve_cascade(levels, bounds, damping, start, sampled)
    if found is not None:
        return RelaxedSolution(found.unknowns, bounds.spread(found.multipliers), np.zeros(bounds.total))
    found = solve_cascade(levels, limits.relaxed(bounds, before), damping, None, sampled)
    if found is None:  # rounding: even the wider limits exclude each other
        found = CascadeSolution(np.zeros(bounds.rows.shape[1]), np.zeros((max(len(levels), 1), len(bounds.lower))))
    excess = bounds.excess(found.unknowns)
    excess[excess < _EXCEEDED] = 0.0
    return RelaxedSolution(found.unknowns, bounds.spread(found.multipliers), bounds.spread(excess))


class _FreeDirections(NamedTuple):
    """Unknowns ``kept + Z z`` that higher levels leave free."""

    kept: Array
    """Solution of the higher levels (n,)."""
    Z: Array | None
    """Null space of the higher levels, (n, k); None for all directions."""

    def rows(self, jacobian: Array) -> Array:
        """Rows on z, from rows on the unknowns."""
        return jacobian if self.Z is None else jacobian @ self.Z

    def rest(self, jacobian: Array, rate: Array) -> Array:
        """Part of the rates of rows that z has to attain."""
        return rate if self.Z is None else rate - jacobian @ self.kept

    def outward(self, T: Array) -> Array:
        """Directions of the unknowns, from directions of z as columns."""
        return T if self.Z is None else self.Z @ T


_Nearest = Callable[[_FreeDirections, Array, Array, Array | None], tuple[Array, Array] | None]
"""Unknowns ``kept + T y`` and multipliers, with the y nearest to a goal within the limits."""


def solve_cascade(
    levels: Sequence[TaskLevel],
    bounds: ProgramBounds,
    damping: float,
    multipliers: Array | None = None,
    sampled: SampledDamping | None = None,
) -> CascadeSolution | None:
    """Solve the levels from the highest to the lowest; None if no velocity satisfies the limits.

    Args:
        levels: tasks, highest level first.
        bounds: limits.
        damping: cost of the velocity at every level, which bounds it near singular configurations.
        multipliers: multipliers of a similar cascade, (levels, k), to start from.
        sampled: damping of levels that limits keep from their rates; by default none.
    """
    rows, r, k = bounds.rows, bounds.rows.shape[1], len(bounds.lower)
    levels = levels or [TaskLevel(np.zeros((0, r)), np.zeros(0))]
    found = np.zeros((len(levels), k))
    room = _TOUCHING * (1.0 + np.abs(rows).sum(axis=1))
    low, high = bounds.lower - room, bounds.upper + room
    free, nearest = _FreeDirections(np.zeros(r), None), partial(_nearest, bounds)
    unknowns = None
    for index, (J, rate) in enumerate(levels):
        own, rate = free.rows(J), free.rest(J, rate)
        least = _RANK * max(float(np.sqrt(np.vdot(J, J))), 1e-300)
        start = None if multipliers is None else multipliers[index]
        whole = _distance_form(own, rate, least, damping)
        if whole is not None:  # the level leaves nothing to lower ones
            goal, T = whole[0], free.outward(whole[1])
            ahead = free.kept + T @ goal
            reached = rows @ ahead
            if (reached <= high).all() and (reached >= low).all():
                unknowns = ahead
            elif (solved := nearest(free, goal, T, start)) is not None:
                unknowns, found[index] = solved
                cost = None if sampled is None else sampled.rows(index, J @ (unknowns - ahead), rate)
                if cost is not None:
                    solved = _solve_damped(nearest, own, rate, cost, free, least, damping, found[index])
                    unknowns, found[index] = solved or (unknowns, found[index])
            break
        left, values, right = np.linalg.svd(own, full_matrices=len(own) < own.shape[1])
        rank = len(values) if not len(values) or values[-1] > least else int((values > least).sum())
        values, unused = values[:rank], right[rank:]
        scales = np.hypot(values, damping) if damping else values
        goal = values * (rate @ left[:, :rank]) / scales
        # Directions that the level determines, in units of its rate (r, rank).
        inward = free.outward(right[:rank].T / scales)
        ahead = kept = free.kept + inward @ goal
        reached = rows @ ahead
        if (reached <= high).all() and (reached >= low).all():
            unknowns = ahead
        else:
            T = inward
            if len(unused):
                cheap = _FREE_COST * (float(scales[-1]) if rank else 1.0)
                T = np.hstack([inward, free.outward(unused.T) / cheap])
                goal = np.concatenate([goal, np.zeros(len(unused))])
            offset = rows @ free.kept
            point = nearest_point(goal, rows @ T, bounds.lower - offset, bounds.upper - offset, start)
            if point is None:
                break  # at a lower level: rounding left no room
            unknowns, found[index] = free.kept + T @ point.point, point.multipliers
            determined = point.point[:rank]
            if sampled is not None and (cost := sampled.rows(index, J @ (unknowns - ahead), rate)):
                level = _damped_level(own, rate, cost, free, damping * right[:rank])
                if (damped := _solve_level(nearest, level, free, found[index])) is not None:
                    unknowns, found[index] = damped
                    z = unknowns - free.kept if free.Z is None else free.Z.T @ (unknowns - free.kept)
                    determined = scales * (right[:rank] @ z)
            kept = free.kept + inward @ determined
        if not len(unused):
            break
        free = _FreeDirections(kept, free.outward(unused.T))
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
    nearest: _Nearest,
    own: Array,
    rate: Array,
    cost: tuple[Array, Array],
    free: _FreeDirections,
    least: float,
    damping: float,
    start: Array,
) -> tuple[Array, Array] | None:
    """Unknowns and multipliers of a level that determines all unknowns, with further rows that damp it."""
    found = _distance_form(own, rate, least, damping, (free.rows(cost[0]), free.rest(*cost)))
    if found is None:
        return _solve_level(nearest, _damped_level(own, rate, cost, free, damping * np.eye(own.shape[1])), free, start)
    return nearest(free, found[0], free.outward(found[1]), start)


def _nearest(
    bounds: ProgramBounds,
    free: _FreeDirections,
    goal: Array,
    T: Array,
    start: Array | None,
) -> tuple[Array, Array] | None:
    lower, upper = bounds.lower, bounds.upper
    if free.kept.any():
        offset = bounds.rows @ free.kept
        lower, upper = lower - offset, upper - offset
    point = nearest_point(goal, bounds.rows @ T, lower, upper, start)
    return None if point is None else (free.kept + T @ point.point, point.multipliers)


def _damped_level(
    own: Array, rate: Array, cost: tuple[Array, Array], free: _FreeDirections, damping: Array
) -> TaskLevel:
    """Level with further rows, which damp it, in the null space of the levels above."""
    rows = np.vstack([own, damping, free.rows(cost[0])])
    return TaskLevel(rows, np.concatenate([rate, np.zeros(len(damping)), free.rest(*cost)]))


def _solve_level(
    nearest: _Nearest, level: TaskLevel, free: _FreeDirections, start: Array
) -> tuple[Array, Array] | None:
    """Unknowns and multipliers that solve one level within the limits; None if rounding left no room."""
    J, rate = level
    left, values, right = np.linalg.svd(J, full_matrices=len(J) < J.shape[1])
    rank = int((values > _RANK * values[0]).sum())
    T = np.hstack([right[:rank].T / values[:rank], right[rank:].T / (_FREE_COST * values[rank - 1])])
    goal = np.concatenate([rate @ left[:, :rank], np.zeros(T.shape[1] - rank)])
    return nearest(free, goal, free.outward(T), start)
