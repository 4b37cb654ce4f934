"""Least squares of many samples at once: entries are numbers, or one array over all samples; zeros cost nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from rnc_pin.errors import InfeasibleError

Entry: TypeAlias = float | np.ndarray
"""Number of all samples, or one for each (N,)."""
Row: TypeAlias = dict[int, Entry]
"""Entries of a row that are not zero, by column."""

_SINGULAR = 1e-14  # pivot relative to the diagonal


def combined(row: Mapping[int, Entry], vector: Sequence[Entry]) -> Entry:
    """Product of a row with a vector."""
    total: Entry = 0.0
    for column, entry in row.items():
        total = plus(total, times(entry, vector[column]))
    return total


def against(rows: Sequence[Row], values: Mapping[int, Entry], size: int) -> list[Entry]:
    """Product ``-L^T b`` of rows L with entries of b, by row."""
    total: list[Entry] = [0.0] * size
    for row, value in values.items():
        for column, entry in rows[row].items():
            total[column] = minus(total[column], times(entry, value))
    return total


def times(a: Entry, b: Entry) -> Entry:
    """Product, which is the number 0 if a factor is."""
    return 0.0 if is_zero(a) or is_zero(b) else a * b


def plus(a: Entry, b: Entry) -> Entry:
    """Sum."""
    return b if is_zero(a) else a if is_zero(b) else a + b


def minus(a: Entry, b: Entry) -> Entry:
    """Difference."""
    return a if is_zero(b) else -b if is_zero(a) else a - b


def is_zero(entry: Entry) -> bool:
    """True for the number 0, not for an array of zeros."""
    return isinstance(entry, float) and entry == 0.0


class NormalEquations:
    """``L^T L x = b`` by a factorization without roots, over all samples.

    Args:
        rows: rows of L.
        size: number of columns.

    Raises:
        InfeasibleError: a sample has dependent columns.
    """

    def __init__(self, rows: Sequence[Row], size: int) -> None:
        self._size = size
        normal: list[list[Entry]] = [[0.0] * size for _ in range(size)]
        for row in rows:
            for a, left in row.items():
                for b, right in row.items():
                    if b <= a:
                        normal[a][b] = plus(normal[a][b], times(left, right))
        self._factor: list[list[Entry]] = [[0.0] * size for _ in range(size)]
        self._inverses: list[Entry] = []
        for a in range(size):
            scaled: list[Entry] = []
            for b in range(a):
                value = normal[a][b]
                for c in range(b):
                    value = minus(value, times(scaled[c], self._factor[b][c]))
                scaled.append(value)
                self._factor[a][b] = times(value, self._inverses[b])
            pivot = normal[a][a]
            for b in range(a):
                pivot = minus(pivot, times(scaled[b], self._factor[a][b]))
            if not np.all(np.asarray(pivot) > _SINGULAR * np.asarray(normal[a][a])):
                raise InfeasibleError("the rows do not determine the motion of the base at each measured position")
            self._inverses.append(1.0 / pivot)

    def solve(self, right: Sequence[Entry]) -> list[Entry]:
        """Solution for a right side."""
        x = list(right)
        for a in range(self._size):
            for b in range(a):
                x[a] = minus(x[a], times(self._factor[a][b], x[b]))
        x = [times(each, inverse) for each, inverse in zip(x, self._inverses, strict=True)]
        for a in reversed(range(self._size)):
            for b in range(a + 1, self._size):
                x[a] = minus(x[a], times(self._factor[b][a], x[b]))
        return x
