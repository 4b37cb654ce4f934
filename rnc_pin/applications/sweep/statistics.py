"""Statistics of the runs of a sweep, in constant memory, with exact quantiles of numbers that are read in chunks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TypedDict

import numpy as np

from rnc_pin.applications.sweep.swept_runs import SweptRuns

ErrorStatistics = TypedDict("ErrorStatistics", {"median": float, "95 %": float, "max": float})
"""Statistics of the final errors of one output."""

Chunks = Callable[[], Iterator[np.ndarray]]
"""Source of chunks, each (N,); it is read several times."""

_BITS = 16
_BUCKETS = 1 << _BITS


def quantiles(chunks: Chunks, fractions: Sequence[float]) -> list[float]:
    """Quantiles of finite numbers with linear interpolation, equal to those of ``numpy.quantile``; NaN is left out.

    Args:
        chunks: source of the numbers, which is read five times.
        fractions: fractions between 0 and 1.
    """
    count = sum(int(np.count_nonzero(~np.isnan(chunk))) for chunk in chunks())
    if not count:
        return [float("nan")] * len(fractions)
    places = [fraction * (count - 1) for fraction in fractions]
    below = [int(place) for place in places]
    ranks = sorted({rank for low in below for rank in (low, min(low + 1, count - 1))})
    found = dict(zip(ranks, _selected(chunks, ranks), strict=True))
    return [
        _between(found[low], found[min(low + 1, count - 1)], place - low)
        for place, low in zip(places, below, strict=True)
    ]


def _between(low: float, high: float, share: float) -> float:
    if low == high:
        return low
    return high - (high - low) * (1.0 - share) if share >= 0.5 else low + (high - low) * share


def _selected(chunks: Chunks, ranks: Sequence[int]) -> list[float]:
    """Numbers of given ranks in ascending order. Each pass finds 16 more bits of them."""
    prefixes, ranks = [0] * len(ranks), list(ranks)
    for shift in range(64 - _BITS, -1, -_BITS):
        counts = [np.zeros(_BUCKETS, dtype=np.int64) for _ in ranks]
        for chunk in chunks():
            keys = _ordered(chunk[~np.isnan(chunk)])
            digits = ((keys >> np.uint64(shift)) & np.uint64(_BUCKETS - 1)).astype(np.int64)
            for place, prefix in enumerate(prefixes):
                of_prefix = digits if shift == 64 - _BITS else digits[keys >> np.uint64(shift + _BITS) == prefix]
                counts[place] += np.bincount(of_prefix, minlength=_BUCKETS)
        for place, found in enumerate(counts):
            up_to = np.cumsum(found)
            digit = int(np.searchsorted(up_to, ranks[place], side="right"))
            ranks[place] -= int(up_to[digit] - found[digit])
            prefixes[place] = prefixes[place] << _BITS | digit
    return [_number(prefix) for prefix in prefixes]


_SIGN = np.uint64(1 << 63)


def _ordered(values: np.ndarray) -> np.ndarray:
    """Integers in the order of floating-point numbers."""
    bits = np.ascontiguousarray(values, dtype=np.float64).view(np.uint64)
    return np.where(bits & _SIGN, ~bits, bits | _SIGN)


def _number(key: int) -> float:
    bits = key ^ (1 << 63) if key >> 63 else ~key & (1 << 64) - 1
    return float(np.array(bits, dtype=np.uint64).view(np.float64))


class SweepStatistics(TypedDict):
    """Outcomes and verdicts of a sweep, and final errors of the completed runs by output."""

    runs: int
    redrawn: int
    outcomes: dict[str, int]
    verdicts: dict[str, int]
    final_error: dict[str, ErrorStatistics]


def completed_values(results: SweptRuns, column: str) -> Iterator[np.ndarray]:
    """Yield the values of a column of numbers in completed runs, block by block; missing values are NaN."""
    for table in results.tables([column, "outcome"]):
        done = np.asarray(table.column(1).to_numpy() == "completed", dtype=bool)
        yield np.asarray(table.column(0).to_numpy(), dtype=float)[done]


def sweep_statistics(results: SweptRuns) -> SweepStatistics:
    """Return counts of outcomes, verdicts and redraws, and quantiles of the final errors of completed runs."""
    errors: dict[str, ErrorStatistics] = {}
    outcomes = results.outcomes
    names = [name for name in results.columns if name.startswith("final_error.")] if "completed" in outcomes else []
    for name in names:
        found = quantiles(partial(completed_values, results, name), (0.5, 0.95, 1.0))
        if not np.isnan(found[0]):
            errors[name.removeprefix("final_error.")] = {"median": found[0], "95 %": found[1], "max": found[2]}
    redrawn = 0
    if "redrawn" in results.columns:
        redrawn = sum(int(np.nansum(table.column(0).to_numpy())) for table in results.tables(["redrawn"]))
    return {
        "runs": len(results),
        "redrawn": redrawn,
        "outcomes": outcomes,
        "verdicts": results.verdicts,
        "final_error": errors,
    }
