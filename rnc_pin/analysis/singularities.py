"""Where a square matrix of the reduction becomes singular: the worst samples, and points on singular surfaces.

Samples alone almost never meet a singular configuration. A determinant that has both signs does: somewhere between
two such configurations it is zero, and bisection along the way from one to the other finds a point where it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.errors import SingularityError
from rnc_pin.linear_algebra import unit_rows
from rnc_pin.reduction import ReducedModel
from rnc_pin.robot import Robot
from rnc_pin.task import Task

_PAIRS = 8
_HALVINGS = 50
_VANISHES = 1e-7  # smallest singular value, of unit rows
_WORST = 3
_TAKES_PART = 0.1  # of the largest weight in the weakest combination

MatrixOf = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Singularity:
    """A configuration at which a matrix is singular, or the nearest to it that was sampled.

    Attributes:
        matrix: "E" or "A4".
        rows: names of the rows that depend on each other there.
        smallest_singular_value: of the matrix with unit rows for E, as it is for A4.
        located: whether it lies on a singular surface (found by bisection), or is only the worst sample.
        configuration: joint values, as ``Robot.configuration`` takes them.
    """

    matrix: str
    rows: tuple[str, ...]
    smallest_singular_value: float
    located: bool
    configuration: dict[str, float | list[float]]


def stack_singularities(reduced: ReducedModel, configurations: np.ndarray) -> list[Singularity]:
    """Of ``E = [A; J2]``: where the reducing outputs do not parametrise the motion. configurations (count, nq)."""
    names = (*reduced.constraints.names, *reduced.reducing.names)

    def matrix(q: np.ndarray) -> np.ndarray:
        return unit_rows(reduced.stacked_rows(q))

    return _search("E", matrix, names, reduced.robot, configurations)


def task_singularities(
    reduced: ReducedModel, task: Task, tracked: Sequence[str], configurations: np.ndarray
) -> list[Singularity]:
    """Of A4, rows of the vertical outputs ``tracked``: where the redundant outputs cannot steer them."""
    rows = np.array([reduced.vertical.names.index(name) for name in tracked])
    block = np.ix_(rows, task.redundant)

    def matrix(q: np.ndarray) -> np.ndarray:
        return reduced.terms(q, np.zeros(reduced.r)).A_star[block]

    return _search("A4", matrix, tracked, reduced.robot, configurations)


def _search(
    what: str, matrix: MatrixOf, names: Sequence[str], robot: Robot, configurations: np.ndarray
) -> list[Singularity]:
    """Points on singular surfaces; where none was found, the worst samples."""
    samples: list[tuple[np.ndarray, np.ndarray]] = []
    for q in configurations:
        try:
            samples.append((q, matrix(q)))
        except SingularityError:  # an output of its own is undefined there
            continue
    if not samples:
        return []
    scale = float(np.median([np.linalg.norm(each, 2) for _, each in samples]))

    def found(q: np.ndarray, value: np.ndarray, located: bool) -> Singularity:
        left, values, _ = np.linalg.svd(value)
        weights = np.abs(left[:, len(values) - 1])
        rows = tuple(name for name, weight in zip(names, weights, strict=True) if weight > _TAKES_PART * weights.max())
        return Singularity(what, rows, float(values[-1]), located, robot.joint_values(q))

    points: list[Singularity] = []
    for low, high in _pairs(samples, robot):
        q = _between(matrix, robot.model, low, high)
        if q is not None:
            point = found(q, matrix(q), True)
            if point.smallest_singular_value < _VANISHES * scale:
                points.append(point)
    if points:
        return _apart(points)
    worst = sorted(samples, key=lambda sample: float(np.linalg.svd(sample[1], compute_uv=False)[-1]))[:_WORST]
    return _apart([found(q, value, False) for q, value in worst])


def _apart(points: Sequence[Singularity]) -> list[Singularity]:
    """Of points that share a row only the one with most rows: there the dependence shows as a whole."""
    kept: list[Singularity] = []
    for point in sorted(points, key=lambda each: (-len(each.rows), each.smallest_singular_value)):
        if not any(set(point.rows) & set(other.rows) for other in kept):
            kept.append(point)
    return kept


def _pairs(samples: Sequence[tuple[np.ndarray, np.ndarray]], robot: Robot) -> list[tuple[np.ndarray, np.ndarray]]:
    """Neighbours whose determinants differ in sign."""
    if samples[0][1].shape[0] != samples[0][1].shape[1]:
        return []
    signs = np.array([np.linalg.slogdet(value)[0] for _, value in samples])
    rarer = 1.0 if (signs > 0).sum() <= (signs < 0).sum() else -1.0
    others = [q for (q, _), sign in zip(samples, signs, strict=True) if sign == -rarer]
    few = [q for (q, _), sign in zip(samples, signs, strict=True) if sign == rarer][:_PAIRS]
    if not others:
        return []
    distances = [[pin.distance(robot.model, q, p) for p in others] for q in few]
    return [(q, others[int(np.argmin(row))]) for q, row in zip(few, distances, strict=True)]


def _between(matrix: MatrixOf, model: pin.Model, low: np.ndarray, high: np.ndarray) -> np.ndarray | None:
    """Where on the way from low to high the determinant changes its sign."""
    try:
        sign = np.linalg.slogdet(matrix(low))[0]
        start, end = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = (start + end) / 2
            if np.linalg.slogdet(matrix(pin.interpolate(model, low, high, middle)))[0] == sign:
                start = middle
            else:
                end = middle
        q = pin.interpolate(model, low, high, start)
        matrix(q)
    except SingularityError:
        return None
    return q
