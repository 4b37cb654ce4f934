"""Singular configurations of the square matrices of the reduction: points on singular surfaces, or worst samples.

Random samples almost never meet a singular configuration. But between two samples whose determinants have opposite
signs, the determinant is zero somewhere. Bisection between the two samples finds such a point.

Lemma 1 holds where they are regular: its residuals at sampled states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.errors import ConstraintError, SingularityError
from rnc_pin.math.linear_algebra import unit_rows, weakest_rows
from rnc_pin.model.coordinates import ConfigurationManifold
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.printing import printed
from rnc_pin.robots.robot import Robot

MatrixOf = Callable[[np.ndarray], np.ndarray]
SignOf = Callable[[np.ndarray], float]
Support = frozenset[int] | None  # rows with a weight in the dependence; None for a sample beside a surface


@printed(configuration="rad or m")
@dataclass(frozen=True)
class Singularity:
    """Configuration at which a matrix is singular, or the worst sample.

    Attributes:
        matrix: "E" or "A4".
        rows: names of the rows that are linearly dependent at this configuration.
        smallest_singular_value: of E with unit rows, or of A4 without scaling.
        located: True for a point on a singular surface, found by bisection; False for the worst sample.
        configuration: joint values in the form of ``Robot.configuration``.
    """

    matrix: str
    rows: tuple[str, ...]
    smallest_singular_value: float
    located: bool
    configuration: dict[str, float | list[float]]


def stack_singularities(reduced: ReducedModel, configurations: np.ndarray) -> list[Singularity]:
    """Singularities of ``E = [A; J2]``, for configurations (count, nq): the outputs do not parametrise the motion.

    Args:
        reduced: the model.
        configurations: regular configurations.
    """
    names = (*reduced.constraints.names, *reduced.reducing.names)
    sign, matrix = (lambda q: _sign(reduced.at(q).scaled_stack)), (lambda q: reduced.at(q).scaled_stack)
    return _search("E", matrix, sign, names, reduced, configurations)


def task_singularities(
    reduced: ReducedModel, task: Task, tracked: Sequence[str], configurations: np.ndarray
) -> list[Singularity]:
    """Singularities of A4, rows of the vertical outputs ``tracked``: the redundant outputs cannot steer them.

    Args:
        reduced: the model.
        task: partition of the outputs.
        tracked: vertical outputs that redundant ones steer.
        configurations: regular configurations (count, nq).
    """
    rows = np.array([reduced.vertical.names.index(name) for name in tracked])
    block = np.ix_(rows, task.redundant)

    def matrix(q: np.ndarray) -> np.ndarray:
        return reduced.at(q).A_star[block]

    def sign(q: np.ndarray) -> float:
        # det E det A4 is the determinant of E with the rows of x11 instead of x22. Unlike det A4 it has no pole
        # at singular E, so it changes its sign at zeros only.
        return _sign(matrix(q)) * _sign(reduced.at(q).E)

    square = len(rows) == len(task.redundant)
    return _search("A4", matrix, sign if square else lambda q: 1.0, tracked, reduced, configurations)


def _sign(matrix: np.ndarray) -> float:
    # The sign alone: a determinant of many rows may overflow.
    return float(np.linalg.slogdet(matrix)[0])


def _search(
    what: str, matrix: MatrixOf, sign: SignOf, names: Sequence[str], reduced: ReducedModel, configurations: np.ndarray
) -> list[Singularity]:
    """Points on singular surfaces; the worst samples if no point was found."""
    samples: list[tuple[np.ndarray, np.ndarray]] = []
    for q in configurations:
        try:
            samples.append((q, matrix(q)))
        except SingularityError:  # an output is undefined at this sample
            continue
    if not samples:
        return []
    scale = float(np.median([np.linalg.norm(each, 2) for _, each in samples]))

    present = 1e-6  # weight, relative to the largest, below which the structure of a singular surface makes it zero

    def found(q: np.ndarray, value: np.ndarray, located: bool) -> tuple[Singularity, Support]:
        left, values, _ = np.linalg.svd(value)
        weights = np.abs(left[:, len(values) - 1])
        rows = weakest_rows(value, names)
        support = frozenset(np.flatnonzero(weights > present * weights.max()).tolist()) if located else None
        return Singularity(what, rows, float(values[-1]), located, reduced.robot.joint_values(q)), support

    points: list[tuple[Singularity, Support]] = []
    vanishes = 1e-7  # smallest singular value, with unit rows, that counts as zero
    for low, high in _pairs([q for q, _ in samples], sign, reduced.robot):
        try:
            q = _between(sign, reduced, low, high)
            point = found(q, matrix(q), True)
        except (SingularityError, ConstraintError):  # the path meets an undefined matrix, or a loop opens
            continue
        if point[0].smallest_singular_value < vanishes * scale:
            points.append(point)
    if points:
        return _apart(points)
    most = 3  # samples that are shown
    worst = sorted(samples, key=lambda sample: float(np.linalg.svd(sample[1], compute_uv=False)[-1]))[:most]
    return _apart([found(q, value, False) for q, value in worst])


def _apart(points: Sequence[tuple[Singularity, Support]]) -> list[Singularity]:
    """One point of each dependence: the one with most rows, which shows it best.

    Points on one surface have the same support. Two surfaces can share rows, such as a straight arm and a platform
    that faces sideways. Of samples beside a surface, all that share a row count as one.
    """
    kept: list[tuple[Singularity, Support]] = []
    for point, support in sorted(points, key=lambda each: (-len(each[0].rows), each[0].smallest_singular_value)):
        same = (set(point.rows) & set(other.rows) if support is None else support == of for other, of in kept)
        if not any(same):
            kept.append((point, support))
    return [point for point, _ in kept]


def _pairs(samples: Sequence[np.ndarray], sign: SignOf, robot: Robot) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pairs of neighbouring samples whose determinants differ in sign."""
    signs = np.array([sign(q) for q in samples])
    positive = [q for q, each in zip(samples, signs, strict=True) if each > 0]
    negative = [q for q, each in zip(samples, signs, strict=True) if each < 0]
    # The rarer sign limits the number of pairs; for each, the nearest partner gives the shortest path.
    few, many = sorted((positive, negative), key=len)
    if not few:
        return []
    most_pairs = 8  # each costs about fifty evaluations of the bisection
    distances = [[pin.distance(robot.model, q, p) for p in many] for q in few[:most_pairs]]
    return [(q, many[int(np.argmin(row))]) for q, row in zip(few, distances, strict=False)]


def _between(sign: SignOf, reduced: ReducedModel, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Zero of the determinant on the path from low to high; every point satisfies the holonomic rows."""

    def way(share: float) -> np.ndarray:
        return reduced.assembly.project(pin.interpolate(reduced.robot.model, low, high, share))

    close = 1e-15  # of a path between samples: the last bit of a share
    return way(scipy.optimize.bisect(lambda share: sign(way(share)), 0.0, 1.0, xtol=close))


# ------------------------------------------------------------------ Lemma 1


def lemma_1_residuals(
    reduced: ReducedModel, configurations: np.ndarray, seed: int = 0, step: float = 5e-4
) -> dict[str, float]:
    """Worst residuals at configurations (count, nq) with seeded random velocities.

    The residuals are: ``A R`` with unit rows and columns; ``H - H^T`` and ``Hdot - V - V^T`` relative to their size,
    with Hdot by fourth-order differences of this step; the smallest eigenvalue of H relative to its largest; and
    ``V(2 v2) - 2 V(v2)``.

    Args:
        reduced: the model.
        configurations: regular configurations.
        seed: of the velocities.
        step: step of the differences along the direction of the velocity [rad or m]. Truncation and rounding are equal
            near the default.
    """
    count = len(configurations)
    v2 = np.random.default_rng(seed).uniform(-1, 1, (count, reduced.r))
    terms = reduced.terms(configurations, v2)
    speeds = np.linalg.norm(terms.v, axis=-1, keepdims=True)
    directions = terms.v / speeds
    space = ConfigurationManifold(reduced.robot.model)
    # Along unit velocities: fast states would otherwise take a larger step.
    moved = (space.integrate(configurations, k * step * directions) for k in (-2, -1, 1, 2))
    far_behind, behind, ahead, far_ahead = (reduced.at(q).H for q in moved)
    H_dot = (far_behind - 8 * behind + 8 * ahead - far_ahead) / (12 * step) * speeds[..., None]
    V = terms.V
    # With affine constraints V is affine in v2 instead of linear.
    resting = reduced.terms(configurations, 0 * v2).V
    doubled = reduced.terms(configurations, 2 * v2).V
    eigenvalues = np.linalg.eigvalsh(terms.H)
    # Residuals are relative to both terms of the identity, so that fast or heavy systems are judged alike.
    size = np.abs(terms.H).max(axis=(1, 2)) * speeds[:, 0] + np.abs(V).max(axis=(1, 2))
    columns = terms.R / np.linalg.norm(terms.R, axis=-2, keepdims=True)
    return {
        "A R": _worst(np.abs(unit_rows(terms.A) @ columns)),
        "H - H^T": _worst(np.abs(terms.H - terms.H.mT).max(axis=(1, 2)) / np.abs(terms.H).max(axis=(1, 2))),
        "Hdot - V - V^T": _worst(np.abs(H_dot - V - V.mT).max(axis=(1, 2)) / size),
        "V linear": _worst(np.abs(doubled - 2 * V + resting).max(axis=(1, 2)) / size),
        "smallest eigenvalue of H": float((eigenvalues[:, 0] / eigenvalues[:, -1]).min()),
    }


def _worst(array: np.ndarray) -> float:
    return float(array.max(initial=0.0))
