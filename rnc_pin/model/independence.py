"""Which rows of a stack are independent, and why the others are not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import unit_rows

TOLERANCE = 1e-8  # on unit rows: sine of the angle below which a row counts as dependent
_WELL = 1e-3  # smallest singular value of a set of unit rows that is good enough to be kept in the order given


@dataclass(frozen=True)
class DroppedRow:
    """A constraint row that adds nothing, and the reason."""

    name: str
    reason: str


def select_independent(
    samples: np.ndarray, names: Sequence[str], rates: np.ndarray | None = None
) -> tuple[list[int], list[DroppedRow]]:
    """A set of rows that is independent and complete at every sample, if there is one.

    Earlier rows are preferred, so that of two equal rows the first is kept. Where the order of the rows does not give
    such a set, column-pivoted QR of ``A^T`` proposes others. Where no set serves everywhere it is the best one, and an
    evaluation chooses others where it has to.

    Args:
        samples: the rows at several configurations, (samples, k, nv).
        names: of the rows, (k,).
        rates: what ``A v`` has to be, (samples, k), where that is not zero.

    Raises:
        ConstraintError: the rank is not the same at every sample, or a row that depends on others demands another
            velocity than they do.
    """
    scale = np.abs(samples).max(initial=0.0)
    matrices = unit_rows(np.where(np.abs(samples) > 1e-12 * scale, samples, 0.0))
    ranks = [_rank(matrix) for matrix in matrices]
    if len(set(ranks)) > 1:
        raise ConstraintError(
            f"rank of the constraints changes with the configuration, from {min(ranks)} to {max(ranks)} "
            f"of {len(names)} rows ({', '.join(names)}): the reduction needs a constant one"
        )
    rank = ranks[0] if ranks else 0
    kept = _choose(matrices, rank)
    if rates is not None:
        _check_consistent(samples, rates, kept, names)
    others = [row for row in range(len(names)) if row not in kept]
    return kept, [DroppedRow(names[row], _reason(row, kept, matrices, names)) for row in others]


def _choose(matrices: np.ndarray, rank: int) -> list[int]:
    """The first set of rows that is well independent at every sample, or the one that is best at its worst sample."""
    best: list[int] = []
    margin = -1.0
    for kept in _candidates(matrices, rank):
        worst = min((_smallest(matrix[kept]) for matrix in matrices), default=1.0)
        if worst > margin:
            best, margin = kept, worst
        if worst > _WELL:
            break
    return best


def _candidates(matrices: np.ndarray, rank: int) -> Iterator[list[int]]:
    for matrix in matrices:
        yield _greedy(matrix, rank)
    for matrix in matrices if rank else ():
        yield sorted(scipy.linalg.qr(matrix.T, pivoting=True)[2][:rank].tolist())


def _smallest(matrix: np.ndarray) -> float:
    return float(np.linalg.svd(matrix, compute_uv=False)[-1]) if len(matrix) else 1.0


def _check_consistent(samples: np.ndarray, rates: np.ndarray, kept: Sequence[int], names: Sequence[str]) -> None:
    for matrix, mu in zip(samples, rates, strict=True):
        v = np.linalg.lstsq(matrix[kept], mu[kept], rcond=None)[0] if kept else np.zeros(matrix.shape[1])
        gap = np.abs(matrix @ v - mu)
        row = int(np.argmax(gap))
        if gap[row] > TOLERANCE * max(np.abs(mu).max(), np.abs(matrix).max() * np.linalg.norm(v)):
            raise ConstraintError(
                f"constraint row '{names[row]}' contradicts the others: it has to be {mu[row]:.4g} where they make it "
                f"{matrix[row] @ v:.4g}"
            )


def _rank(matrix: np.ndarray) -> int:
    if not matrix.size:
        return 0
    return int((np.linalg.svd(matrix, compute_uv=False) > TOLERANCE).sum())


def _greedy(matrix: np.ndarray, rank: int) -> list[int]:
    kept: list[int] = []
    for row in range(len(matrix)):
        if len(kept) < rank and _rank(matrix[[*kept, row]]) == len(kept) + 1:
            kept.append(row)
    return kept


def _reason(row: int, kept: Sequence[int], matrices: np.ndarray, names: Sequence[str]) -> str:
    if not matrices[:, row].any():
        return "zero at every configuration"
    involved = set()
    for matrix in matrices:
        weights = np.linalg.lstsq(matrix[list(kept)].T, matrix[row], rcond=None)[0]
        involved |= {names[k] for k, weight in zip(kept, weights, strict=True) if abs(weight) > TOLERANCE}
    return "a combination of " + ", ".join(name for name in names if name in involved)
