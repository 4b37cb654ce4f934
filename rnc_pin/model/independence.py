"""Selection of independent rows of a stack, with the reasons for dropping the others, and checks of conserved momenta.

No actuator, no passive force and no constraint reaction may act on a joint whose momentum is declared as conserved.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rnc_pin.errors import ConstraintError, SingularityError, few
from rnc_pin.math.linear_algebra import pivot_columns, unit_rows, weakest_rows
from rnc_pin.model.generalized_forces import Actuation, PassiveForces
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.rows import OutputStack, Rows, RowStack
from rnc_pin.robots.robot import Robot

TOLERANCE = 1e-8  # on unit rows: sine of the angle below which a row counts as dependent
ROUNDING = 1e-5  # the same limit for rows that are dependent except for the rounding of a file's numbers
_WELL = 1e-3  # smallest singular value of unit rows above which the first set found is kept


@dataclass(frozen=True)
class DroppedRow:
    """Redundant constraint row that is not used, with the reason.

    Attributes:
        name: name of the row.
        reason: reason in words, e.g. the rows that it is a combination of.
        rounding: sine of its angle to the kept rows if the row is dependent only to rounding; else 0.
    """

    name: str
    reason: str
    rounding: float = 0.0


class RankError(ConstraintError):
    """The rank of the constraints is not the same at every sample."""


class Selection(NamedTuple):
    """Independent rows of a stack, and the dropped rows."""

    kept: list[int]
    dropped: list[DroppedRow]
    margin: float
    """Smallest singular value of the kept unit rows, at the sample where it is largest."""
    weak: list[str]
    """Names of the rows that are closest to dependent at this sample."""


def select_independent(
    samples: np.ndarray,
    names: Sequence[str],
    rates: np.ndarray | None = None,
    lengths: np.ndarray | None = None,
    angular: np.ndarray | None = None,
) -> Selection:
    """Select a maximal set of rows that is independent at every sample, if such a set exists.

    Earlier rows are preferred: of two equal rows, the first is kept. If the order of the rows gives no such set,
    column-pivoted QR of ``A^T`` proposes others. If no set is independent at every sample, the best set is returned,
    and an evaluation selects other rows where necessary. Rows that are dependent to ``ROUNDING`` at every sample count
    as dependent, e.g. of wheels with a toe angle from rounding.

    Args:
        samples: the rows at one or more configurations, (samples, k, nv).
        names: names of the rows, (k,).
        rates: required values mu of ``A v``, (samples, k), if not zero.
        lengths: length of each row relative to which it counts as zero, (k,); 0 for rows without such a length.
        angular: True for the columns of angular velocities, (nv,). The margin compares them with the others by the
            longest lever arm of the rows, so that a robot and its small model have the same margin.

    Raises:
        RankError: the rank at some sample is lower than that of the rows at all samples together, up to rounding.
        ConstraintError: a dependent row requires a velocity that contradicts the others.
    """
    # Entries of rounding would count as directions once rows have unit length.
    scale = np.abs(samples).max(initial=0.0)
    samples = np.where(np.abs(samples) > 1e-12 * scale, samples, 0.0)
    left = np.linalg.norm(samples, axis=-1).max(axis=0)
    lengths = np.zeros(len(names)) if lengths is None else lengths
    # A row that is much shorter than its like is zero up to the rounding of a file's numbers.
    short = (left > 0) & (left < ROUNDING * lengths)
    # Of unit length, so that rows in metres and in radians count alike in the rank.
    matrices = unit_rows(np.where(short[:, None], 0.0, samples))
    exact, rough = (np.linalg.matrix_rank(matrices, tol=limit) for limit in (TOLERANCE, ROUNDING))
    # Near a singular configuration, a sample has a lower rank only for the larger tolerance.
    rank = max(rough)
    if min(exact) < rank:
        raise RankError(
            f"rank of the constraints changes with the configuration, from {min(exact)} to {max(exact)} "
            f"of {len(names)} rows ({', '.join(names)}): the reduction needs a constant one"
        )
    tolerance = ROUNDING if max(exact) > rank or short.any() else TOLERANCE
    kept = _choose(matrices, rank, tolerance)
    if rates is not None:
        _check_consistent(samples, rates, kept, names, tolerance)
    size = left / np.where(lengths > 0, lengths, np.inf)
    others = (row for row in range(len(names)) if row not in kept)
    dropped = [_dropped(row, kept, matrices, names, tolerance, float(size[row])) for row in others]
    matrices = unit_rows(matrices / _column_sizes(samples, angular))
    matrices = matrices * np.where((size > 0) & (size < _WELL), size, 1.0)[:, None]  # small rows lower the margin
    return Selection(kept, dropped, *_margin(matrices, kept, names))


def block_row_scales(rows: RowStack, samples: np.ndarray) -> np.ndarray:
    """Reference length of each row, (k,): the longest row of its block with the same unit; 0 if none is holonomic.

    Args:
        rows: stack of whole blocks.
        samples: the rows at several configurations, (samples, k, nv).
    """
    lengths, scales = np.linalg.norm(samples, axis=-1).max(axis=0, initial=0.0), np.zeros(rows.size)
    for block, where, _ in rows.places:
        units = np.array(block.units)
        for unit in set(block.units) if any(block.holonomic) else ():
            scales[where][units == unit] = lengths[where][units == unit].max()
    return scales


def defined_jacobians(
    rows: RowStack, robot: Robot, configurations: np.ndarray
) -> Iterator[tuple[PositionKinematics, np.ndarray]]:
    """Kinematics and Jacobians (size, nv) at those of some configurations at which all rows are defined.

    Args:
        rows: the rows.
        robot: the robot.
        configurations: configurations (count, nq).
    """
    kinematics = Kinematics(robot)
    for q in configurations:
        with suppress(SingularityError):
            position = kinematics.position(q)
            yield position, rows.jacobian(position)


def row_scales(robot: Robot, rows: RowStack, reducing: OutputStack, configurations: np.ndarray) -> np.ndarray:
    """Typical length of each row: the median over configurations (count, nq), or the largest if the median is zero.

    It is zero for a row that is zero to rounding, e.g. the out-of-plane row of a planar loop.

    Args:
        robot: the robot.
        rows: all constraint rows.
        reducing: reducing outputs.
        configurations: configurations (count, nq).
    """
    stack = RowStack.of([*rows.places, *reducing.places])
    found = [np.linalg.norm(jacobian, axis=-1) for _, jacobian in defined_jacobians(stack, robot, configurations)]
    lengths = np.array(found) if found else np.zeros((1, stack.size))
    # A row of rounding, e.g. out of the plane of a planar loop, must not count as a short one.
    lengths = np.where(lengths > 1e-12 * lengths.max(initial=0.0), lengths, 0.0)
    ordered, count = np.sort(lengths, axis=0), len(lengths)
    typical = (ordered[(count - 1) // 2] + ordered[count // 2]) / 2.0  # ``np.median`` would import ``numpy.ma``
    return np.where(typical > 0, typical, lengths.max(axis=0))


def _column_sizes(samples: np.ndarray, angular: np.ndarray | None) -> np.ndarray:
    """Length of each column that counts as one, (nv,): the longest lever arm for angular columns, 1 for others."""
    size = np.ones(samples.shape[-1])
    if angular is None or not angular.any() or angular.all():
        return size
    both = np.abs(samples[..., ~angular]).max(axis=-1) > 0  # only these rows compare lengths and angles
    turning = np.abs(samples[..., angular]).max(axis=-1)
    arms = turning[both & (turning > 0)]
    size[angular] = arms.max() if len(arms) else 1.0
    return size


def _margin(matrices: np.ndarray, kept: Sequence[int], names: Sequence[str]) -> tuple[float, list[str]]:
    if not kept:
        return 1.0, []
    best = max((matrix[kept] for matrix in matrices), key=_smallest)
    return _smallest(best), list(weakest_rows(best, [names[row] for row in kept]))


def _choose(matrices: np.ndarray, rank: int, tolerance: float) -> list[int]:
    """First set of rows that is well independent at every sample, else the set whose worst sample is best."""
    best, margin = list[int](), -1.0
    for kept in _candidates(matrices, rank, tolerance):
        if len(kept) < rank:
            continue  # the sample is near a singular configuration
        worst = min(_smallest(matrix[kept]) for matrix in matrices)
        if worst > margin:
            best, margin = kept, worst
        # Good enough: another search could only change which rows users read in messages.
        if worst > _WELL:
            break
    return best


def _candidates(matrices: np.ndarray, rank: int, tolerance: float) -> Iterator[list[int]]:
    for matrix in matrices:
        yield _greedy(matrix, rank, tolerance)
    # The first rows in the order of the user fail somewhere: pivoting takes the most independent ones instead.
    for matrix in matrices if rank else ():
        yield sorted(pivot_columns(matrix.T, rank)[0])


def _smallest(matrix: np.ndarray) -> float:
    return float(np.linalg.svd(matrix, compute_uv=False)[-1]) if len(matrix) else 1.0


def _check_consistent(
    samples: np.ndarray, rates: np.ndarray, kept: Sequence[int], names: Sequence[str], tolerance: float
) -> None:
    for matrix, mu in zip(samples, rates, strict=True):
        # Some velocity that satisfies the kept rows: the others have to hold for it too.
        v = np.linalg.lstsq(matrix[kept], mu[kept], rcond=None)[0]
        gap = np.abs(matrix @ v - mu)
        row = int(np.argmax(gap))
        if gap[row] > tolerance * max(np.abs(mu).max(), np.abs(matrix).max() * np.linalg.norm(v)):
            raise ConstraintError(
                f"constraint row '{names[row]}' contradicts the others: it requires {mu[row]:.4g}, the others require "
                f"{matrix[row] @ v:.4g}"
            )


def _greedy(matrix: np.ndarray, rank: int, tolerance: float) -> list[int]:
    kept: list[int] = []
    for row in range(len(matrix)):
        if len(kept) < rank and np.linalg.matrix_rank(matrix[[*kept, row]], tol=tolerance) > len(kept):
            kept.append(row)
    return kept


def _dropped(
    row: int, kept: Sequence[int], matrices: np.ndarray, names: Sequence[str], tolerance: float, size: float
) -> DroppedRow:
    """Dropped row with the reason; ``size`` is its length relative to that of rows like it."""
    if not matrices[:, row].any():
        reason = f"zero except for rounding ({size:.2g})" if size else "zero at every configuration"
        return DroppedRow(names[row], reason, size)
    involved, rounding = set(), 0.0
    for matrix in matrices:
        # The row as a combination of the kept ones, for the reason that users read.
        weights = np.linalg.lstsq(matrix[list(kept)].T, matrix[row], rcond=None)[0]
        involved |= {names[k] for k, weight in zip(kept, weights, strict=True) if abs(weight) > tolerance}
        rounding = max(rounding, float(np.linalg.norm(matrix[row] - weights @ matrix[list(kept)])))
    reason = "a combination of " + ", ".join(name for name in names if name in involved)
    if rounding <= TOLERANCE:
        return DroppedRow(names[row], reason)
    return DroppedRow(names[row], f"{reason} except for rounding ({rounding:.2g})", rounding)


# ------------------------------------------------------------------ conserved momenta

_ACTS = 1e-9  # relative entry of a row beyond rounding: a user's loop in world axes is closed to 1e-11 m


def check_momenta(
    blocks: Collection[Rows], actuation: Actuation, forces: PassiveForces, robot: Robot, samples: np.ndarray
) -> None:
    """Raise an error if an actuator or a passive force acts on a momentum that is declared as conserved.

    Args:
        blocks: bound rows of all constraints.
        actuation: the actuation matrix B(q).
        forces: the passive forces.
        robot: the robot.
        samples: configurations (samples, nq).

    Raises:
        ConstraintError: something acts on a conserved momentum; the message names both.
    """
    conserved, rounding = [block for block in blocks if block.conserved is not None], 1e-12  # of an entry of B
    kinematics, generator = Kinematics(robot), np.random.default_rng(0)
    for q in samples if conserved else ():
        # At a random velocity, because a damper acts at no other.
        at = kinematics.position(q).with_velocity(generator.uniform(-1.0, 1.0, kinematics.nv))
        columns = zip(actuation.names, np.abs(actuation.matrix(at)).T, strict=True)
        acting = [(f"actuator '{name}' drives", column, rounding) for name, column in columns]
        passive = ((each.name, np.abs(each.force(at))) for each in forces)
        acting += [(f"{name} acts on", force, _ACTS * max(1.0, float(force.max()))) for name, force in passive]
        for what, force, limit in acting:
            for block in conserved:
                if force[block.conserved].max() > limit:
                    raise ConstraintError(f"{what} {block.names[0]}, which is declared as conserved")


def check_reactions(rows: RowStack, samples: np.ndarray, lengths: np.ndarray, couplings: Collection[str] = ()) -> None:
    """Raise an error if a constraint reaction changes a momentum that is declared as conserved.

    The reaction of a row is ``A^T lambda``. It does not change the momentum of a joint if the row is zero in the
    columns of that joint. Then a rigid motion of the subtree of the joint has no effect on the row. This holds for a
    loop within the subtree, but not for a wheel on the ground or a hand on a wall. Momentum rows have no reaction.

    Args:
        rows: all constraint rows, (k,).
        samples: these rows at assembled configurations, (samples, k, nv).
        lengths: typical length of each row, (k,), relative to which it counts as zero; 0 if there is none.
        couplings: names of rows that come from the robot's file.

    Raises:
        ConstraintError: a row acts on a conserved momentum; the message gives the rows, the momentum and the remedy.
    """
    momenta = [place for place in rows.places if place.block.conserved is not None]
    # A momentum does not act on itself: its row is the statement that nothing does.
    reacts = ~rows.conserved_rows()
    if not momenta or not reacts.any():
        return
    longest = np.maximum(np.linalg.norm(samples, axis=-1).max(axis=0), lengths)
    rounding = 1e-12  # of an entry, relative to the largest entry of all rows
    limit = np.maximum(_ACTS * longest, rounding * np.abs(samples[:, reacts]).max())
    for block, *_ in momenta:
        effect = np.abs(samples[..., block.conserved]).max(axis=(0, -1))
        found = [rows.names[k] for k in np.flatnonzero(reacts & (effect > limit))]
        if not found:
            continue
        acts = f"constraint row {found[0]} acts" if len(found) == 1 else f"constraint rows {few(found)} act"
        coupled = " (mimic=False, or mimic: false, omits the file's couplings)" if {*found} & {*couplings} else ""
        momentum = block.names[0].removesuffix("[0]")
        raise ConstraintError(
            f"{acts} on {momentum}, which is declared as conserved: omit the momentum (the motion follows from the "
            f"other constraints) or what acts on it{coupled}"
        )
