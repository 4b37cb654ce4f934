"""Reports of a complete sweep: statistics, failures with the commands that repeat them, and distributions."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rnc_pin.applications.sweep.statistics import sweep_statistics
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
