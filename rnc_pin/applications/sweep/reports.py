"""Reports of a complete sweep: statistics, failures with the commands that repeat them, and distributions.

Statistics need constant memory: numbers are read in chunks, and those of quantiles are in a file.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from rnc_pin.applications.sweep.rows import LIMITS, SUCCESSFUL, Row, verdict_or_failure
from rnc_pin.io import atomic_file, dump_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rnc_pin.applications.sweep.results import SweepResults
    from rnc_pin.figures import Size
    from rnc_pin.visualization import Histogram

_MOST_PANELS = 24
_TITLES = {
    "smallest_distance": "smallest distance from obstacles [m]",
    "smallest_own_distance": "smallest distance between links [m]",
    "min_singular_value": "smallest singular value of E",
}
_BINS = (10, 40)  # smallest and largest number
_SHARES, _RUNS_IN_BIN = (4, 20), 10  # the same of shares, and the runs that one needs: a share of few runs is noise


def write_reports(results: SweepResults) -> None:
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


def failure_lines(results: SweepResults, row: Row) -> Iterator[str]:
    """Two lines about a run that did not succeed: finding and message, and the command that repeats it."""
    yield f"# run {row['run']}: {row['finding']}: {row['message']}"
    if "scenario" in results.specification:
        yield results.command(row)
    else:
        drawn = {name: row[name] for name in results.drawn if row[name] is not None}
        yield f"{results.specification['build']}({json.dumps(drawn)})"


def draw_distributions(results: SweepResults, size: Size | None, file: str | Path | None) -> Figure | None:
    """Figure of ``SweepResults.plot``, also as a file; None if no column has two different numbers."""
    from rnc_pin.figures import save
    from rnc_pin.visualization import plot_distributions

    names = [name for name in results.columns if name.startswith("final_error.")]
    names += [name for name in _TITLES if name in results.columns]
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


def _histogram(results: SweepResults, name: str) -> Histogram | None:
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
    shares, runs = name in results.drawn, len(results)
    bins = int(np.clip(runs / _RUNS_IN_BIN, *_SHARES) if shares else np.clip(np.sqrt(runs), *_BINS))
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


def quantiles(chunks: Iterable[np.ndarray], fractions: Sequence[float], folder: Path) -> list[float] | None:
    """Quantiles of numbers in chunks, each (N,), by ``numpy.quantile``; NaN is left out, None without a number.

    The numbers are in a file, whose pages the system may take from memory.

    Args:
        chunks: the numbers.
        fractions: fractions between 0 and 1.
        folder: folder of the temporary file, on a disk with room for the numbers.
    """
    with TemporaryFile(dir=folder) as file:
        for chunk in chunks:
            file.write(chunk[~np.isnan(chunk)].tobytes())
        if not file.tell():
            return None
        numbers = np.memmap(file, dtype=float, mode="r+")
        found: list[float] = np.quantile(numbers, fractions, overwrite_input=True).tolist()
        return found


class SweepStatistics(TypedDict):
    """Outcomes and verdicts of a sweep, and final errors of the completed runs by output."""

    runs: int
    redrawn: int
    outcomes: dict[str, int]
    verdicts: dict[str, int]
    final_error: dict[str, ErrorStatistics]


def completed_values(results: SweepResults, column: str) -> Iterator[np.ndarray]:
    """Yield the values of a column of numbers in completed runs, block by block; missing values are NaN."""
    for table in results.tables([column, "outcome"]):
        done = np.asarray(table.column(1).to_numpy() == "completed", dtype=bool)
        yield np.asarray(table.column(0).to_numpy(), dtype=float)[done]


def sweep_statistics(results: SweepResults) -> SweepStatistics:
    """Return counts of outcomes, verdicts and redraws, and quantiles of the final errors of completed runs."""
    errors: dict[str, ErrorStatistics] = {}
    outcomes = results.outcomes
    names = [name for name in results.columns if name.startswith("final_error.")] if "completed" in outcomes else []
    for name in names:
        found = quantiles(completed_values(results, name), (0.5, 0.95, 1.0), results.path)
        if found is not None:
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
