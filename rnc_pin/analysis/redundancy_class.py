"""Redundancy class of a task: paper (11) and its subclasses, decided on sampled configurations; and singular ones.

Random samples almost never meet a singular configuration. But between two samples whose determinants have opposite
signs, the determinant is zero somewhere. Bisection between the two samples finds such a point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.errors import ConstraintError, SingularityError
from rnc_pin.math.linear_algebra import weakest_rows
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation, kinematic_gradient
from rnc_pin.model.task import Task
from rnc_pin.printing import printed
from rnc_pin.robots.robot import Robot


@printed()
@dataclass(frozen=True)
class Evidence:
    """Numbers that decide on a class.

    Attributes:
        A3: largest entry in the rows of all vertical outputs.
        A4_singular_values: smallest and largest of the nonzero rows of A4; zeros if all rows are zero.
        A6: largest entry in the other rows.
        A5_along_x22: largest partial derivative of A5 with respect to a redundant output, all others fixed.
        steering: largest entry of ``d(A3 v21)/dx22``, if A4 is zero.
    """

    A3: float
    A4_singular_values: tuple[float, float]
    A6: float
    A5_along_x22: float
    steering: float | None


@printed()
@dataclass(frozen=True)
class Redundancy:
    """Redundancy class of a task, its partition of x1, and the reason.

    Attributes:
        redundancy_class: "1", "2", "2s" or None.
        tracked: vertical outputs x11 that the redundant outputs can steer.
        driven: vertical outputs x12 that only the primary outputs move.
        reason: in words.
        evidence: the numbers that decided; None if there is nothing to decide.
    """

    redundancy_class: str | None
    tracked: tuple[str, ...]
    driven: tuple[str, ...]
    reason: str
    evidence: Evidence | None = None


def classify(reduced: ReducedModel, task: Task, configurations: np.ndarray, seed: int = 0) -> Redundancy:
    """Sort a task into the classes of paper section 3.2, at configurations (count, nq).

    Class 1: A4 has full row rank. Class 2: A6 = 0, A4 nonsingular, A5 independent of x22. The last condition uses the
    partial derivative at fixed x21, x11 and x12. (Under the constraints, x11 moves with x22, and A5 may depend on x11.)
    Class 2s: x22 enters through A3 only, ``d(A3 v21)/dx22`` nonsingular.

    Args:
        reduced: the model.
        task: partition of the outputs.
        configurations: regular configurations; their number decides how sure the class is.
        seed: of the primary velocities.
    """
    names = task.vertical_names
    if not len(task.redundant) or not names:
        reason = "no redundant output" if names else "no vertical output"
        return Redundancy(None, (), names, reason)
    here = reduced.at(configurations)
    A = here.A_star[:, task.vertical]
    # Derivatives of A_star along the motion of each redundant output alone, (count, k, r, r2).
    A_along = kinematic_gradient(here, task.redundant)[:, task.vertical]
    part = 1e-9  # of the largest entry of A, at least 1: what is below is rounding
    zero = part * max(1.0, float(np.abs(A).max()))
    A3, A4 = A[..., task.primary], A[..., task.redundant]
    A3_along = A_along[:, :, task.primary]  # (count, k, r1, r2)
    # Away from zero, where nothing steers, and different for each output, so that effects do not cancel.
    v21 = np.random.default_rng(seed).uniform(0.5, 1.5, len(task.primary))
    steering = np.einsum("nkij,i->nkj", A3_along, v21)

    moved, steered = largest_entries(A4) > zero, largest_entries(steering) > zero
    tracked = moved if moved.any() else steered
    A5_along = _partial(here, task)[:, ~tracked]
    A5_depends = _largest(A5_along) > zero
    redundancy_class, reason = _decide(A4[:, moved], steering[:, steered], moved, A5_depends)
    if redundancy_class != "2s":
        tracked = moved

    above, below = (tuple(np.array(names)[flags].tolist()) for flags in (tracked, ~tracked))
    values = np.linalg.svd(A4[:, moved], compute_uv=False) if moved.any() else np.zeros(1)
    ends, steers = (float(values.min()), float(values.max())), None if moved.any() else _largest(steering)
    evidence = Evidence(_largest(A3), ends, _largest(A4[:, ~moved]), _largest(A5_along), steers)
    return Redundancy(redundancy_class, above, below, reason, evidence)


def _partial(here: ConfigurationEvaluation, task: Task) -> np.ndarray:
    """Partial derivatives (count, k, r1, r2) of ``A_star``'s columns of x21 with respect to x22.

    The paper's coordinates are (x1, x2): one redundant output moves while all other outputs of the task are fixed. The
    constraints forbid this motion, but a derivative allows it. Coordinates that are not outputs move as little as
    possible. If dependent outputs make this impossible, the result is the derivative under the constraints.
    """
    J1 = here.J1[:, task.vertical]
    J = np.concatenate([J1, here.J2], axis=1)
    ways = motions_alone(J, J1.shape[1] + task.redundant, here.R[..., task.redundant])
    return np.moveaxis(rates_along(here, ways), 1, -1)[:, task.vertical][:, :, task.primary]


def motions_alone(J: np.ndarray, moved: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    """Return the motions (count, nv, j) that move the j rows ``moved`` of J (count, k, nv), each alone.

    Args:
        J: Jacobians.
        moved: indices of the rows (j,).
        otherwise: motions (count, nv, j) in place of motions that dependent rows make impossible.
    """
    alone = np.eye(J.shape[1])[:, moved]
    least = 1e-9  # of the largest singular value of all outputs' Jacobian
    ways = np.linalg.pinv(J, rcond=least) @ alone
    possible_error = 1e-6  # largest motion of outputs that must not move
    possible = np.abs(J @ ways - alone).max(axis=1, keepdims=True) < possible_error
    return np.asarray(np.where(possible, ways, otherwise))


def rates_along(here: ConfigurationEvaluation, ways: np.ndarray) -> np.ndarray:
    """Return the derivatives (count, j, k, r) of ``A_star`` along motions (count, nv, j).

    Args:
        here: evaluation at configurations (count, nq).
        ways: the motions.
    """
    each = (StateEvaluation(here, v=np.ascontiguousarray(way)).A_star_dot for way in np.moveaxis(ways, -1, 0))
    return np.stack(list(each), axis=1)


def _decide(A4: np.ndarray, steering: np.ndarray, moved: np.ndarray, A5_depends: bool) -> tuple[str | None, str]:
    """Class and reason, from the nonzero rows of A4 and of ``d(A3 v21)/dx22``."""
    _, rows, columns = A4.shape
    moves = f"{rows} vertical output{'s'[: rows != 1]} moved by {columns} redundant one{'s'[: columns != 1]}"
    if not rows:
        if steering.shape[1] == columns and has_full_row_rank(steering):
            return "2s", "A4 = 0: the rates of x22 move no vertical output, but its value steers A3 v21"
        return None, "A4 = 0, and the values of x22 do not steer A3 v21 either"
    if rows > columns:
        return None, f"{moves}: too few to steer them all"
    if not has_full_row_rank(A4):
        return None, f"{moves}, but A4 has not full row rank"
    if moved.all():
        wide = " (more redundant than vertical outputs: some freedom is left)" if columns > rows else ""
        return "1", f"A4 has full row rank{wide}"
    if rows < columns:
        return None, f"{moves}: class 2 needs as many of both"
    if A5_depends:
        return None, f"{moves}, but A5 depends on x22"
    return "2", "A6 = 0, A4 nonsingular and A5 independent of x22"


def largest_entries(matrices: np.ndarray) -> np.ndarray:
    """Return the largest entry of each row (k,).

    Args:
        matrices: (count, k, l).
    """
    return np.asarray(np.abs(matrices).max(axis=(0, 2), initial=0.0))


def _largest(array: np.ndarray) -> float:
    return float(np.abs(array).max(initial=0.0))


def has_full_row_rank(matrices: np.ndarray) -> bool:
    """Return True if matrices have rank k at most samples: presumably at all but isolated configurations.

    Args:
        matrices: (count, k, l).
    """
    values = np.linalg.svd(matrices, compute_uv=False)
    if matrices.shape[-2] > matrices.shape[-1]:
        return False
    # A few samples may lie near a singular surface: nine of ten decide.
    good = values[:, -1] > 1e-6 * np.maximum(values[:, 0], 1e-12)
    return bool(good.mean() > 0.9)


# ------------------------------------------------------------------ singular configurations of E and of A4

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
    most_pairs = 8  # each costs about fifty evaluations of the bisection
    distances = [[pin.distance(robot.model, q, p) for p in many] for q in few[:most_pairs]]
    return [(q, many[int(np.argmin(row))]) for q, row in zip(few, distances, strict=False)]


def _between(sign: SignOf, reduced: ReducedModel, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Zero of the determinant on the path from low to high; every point satisfies the holonomic rows."""

    def way(share: float) -> np.ndarray:
        return reduced.assembly.project(pin.interpolate(reduced.robot.model, low, high, share))

    close = 1e-15  # of a path between samples: the last bit of a share
    return way(scipy.optimize.bisect(lambda share: sign(way(share)), 0.0, 1.0, xtol=close))
