"""Reports of a complete sweep: statistics, failures with the commands that repeat them, and distributions.

Statistics need constant memory; quantiles are exact, of numbers that are read in chunks.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from rnc_pin.applications.sweep.swept_run import LIMITS, SUCCESSFUL, Row, verdict_or_failure
from rnc_pin.applications.sweep.swept_runs import SweptRuns
from rnc_pin.io import atomic_file, dump_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rnc_pin.figures import Size
    from rnc_pin.visualization import Histogram

_MOST_PANELS = 24
_DRAWN_RESULTS = ("smallest_distance", "smallest_own_distance", "min_singular_value")
_TITLES = {
    "smallest_distance": "smallest distance from obstacles [m]",
    "smallest_own_distance": "smallest distance between links [m]",
    "min_singular_value": "smallest singular value of E",
}
_BINS = (10, 40)  # smallest and largest number
_SHARES, _RUNS_IN_BIN = (4, 20), 10  # the same of shares, and the runs that one needs: a share of few runs is noise


def write_reports(results: SweptRuns) -> None:
    """Write ``sweep.json``, ``failures.txt`` and ``distributions.png`` into the folder of a sweep."""
    if not len(results):
        return
    of = results.specification.get("scenario") or results.specification.get("build")
    with atomic_file(results.path / "sweep.json") as partial:
        partial.write_text(dump_json({"scenario": of, **sweep_statistics(results)}) + "\n", encoding="utf-8")
    failures = results.path / "failures.txt"
    if set(results.verdicts) - set(SUCCESSFUL):
        with atomic_file(failures) as partial, partial.open("w", encoding="utf-8") as file:
            file.writelines(f"{line}\n" for row in results.failures() for line in failure_lines(results, row))
    else:
        failures.unlink(missing_ok=True)
    draw_distributions(results, None, results.path / "distributions.png")


def failure_lines(results: SweptRuns, row: Row) -> Iterator[str]:
    """Two lines about a run that did not succeed: finding and message, and the command that repeats it."""
    yield f"# run {row['run']}: {row['finding']}: {row['message']}"
    if "scenario" in results.specification:
        yield results.command(row)
    else:
        drawn = {name: row[name] for name in results.drawn if row[name] is not None}
        yield f"{results.specification['build']}({json.dumps(drawn)})"


def draw_distributions(results: SweptRuns, size: Size | None, file: str | Path | None) -> Figure | None:
    """Figure of ``SweptRuns.plot``, also as a file; None if no column has two different numbers."""
    from rnc_pin.figures import save
    from rnc_pin.visualization import plot_distributions

    names = [name for name in results.columns if name.startswith("final_error.")]
    names += [name for name in _DRAWN_RESULTS if name in results.columns]
    names += [name for name in results.columns if name.startswith(LIMITS)]
    names += [name for name in results.drawn if name != "seed"]
    panels = [panel for name in names[:_MOST_PANELS] if (panel := _histogram(results, name)) is not None]
    if not panels:
        return None
    of = str(results.specification.get("scenario") or results.specification.get("build"))
    figure = plot_distributions(panels, f"{Path(of).stem}: {len(results)} runs" if size is None else "", size)
    if file is not None:
        save(figure, file)
    return figure


def _histogram(results: SweptRuns, name: str) -> Histogram | None:
    """Histogram of a column of numbers by verdict; None if it has no two different numbers."""
    import pyarrow as pa

    from rnc_pin.visualization import Histogram

    kind = results.table_schema.field(name).type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
        return None

    def chunks() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for table in results.tables([name, "verdict", "finding"]):
            values = np.asarray(table.column(0).to_numpy(), dtype=float)
            pairs = zip(table.column(1).to_pylist(), table.column(2).to_pylist(), strict=True)
            labels = np.array([verdict_or_failure(*pair) for pair in pairs])
            fine = np.isfinite(values)
            yield values[fine], labels[fine]

    low, high, positive = np.inf, -np.inf, np.inf
    for values, _ in chunks():
        if len(values):
            low, high = min(low, values.min()), max(high, values.max())
            positive = min(positive, values[values > 0].min(initial=np.inf))
    if not low < high:
        return None
    logarithmic = low >= 0.0 and np.isfinite(positive) and high > 100.0 * positive
    shares = name in results.drawn
    bins = int(
        np.clip(len(results) / _RUNS_IN_BIN if shares else np.sqrt(len(results)), *(_SHARES if shares else _BINS))
    )
    edges = np.geomspace(positive, high, bins + 1) if logarithmic else np.linspace(low, high, bins + 1)
    counts = {label: np.zeros(bins, dtype=int) for label in results.verdicts}
    for values, labels in chunks():
        inside = np.clip(values, edges[0], edges[-1])  # zeros go into the first bin of a logarithmic axis
        for label, count in counts.items():
            count += np.histogram(inside[labels == label], edges)[0]
    shown = {label if label in SUCCESSFUL else f"failed: {label}": count for label, count in counts.items()}
    return Histogram(_title(name), edges, shown, logarithmic, shares)


def _title(name: str) -> str:
    """Title of the axis of a column: results in words, drawn values as their keys."""
    group, _, rest = name.partition(".")
    if group == "final_error":
        return f"final error of {rest} [m or rad]"
    if group == LIMITS:
        return f"excess over {rest} limits [share of range]"
    return _TITLES.get(name, name)


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
