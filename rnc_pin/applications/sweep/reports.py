"""Reports of a complete sweep: statistics, failures with the commands that repeat them, and distributions.

Statistics need constant memory: numbers are read in chunks, and those of quantiles are in a file.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import TypedDict

import numpy as np

from rnc_pin.applications.sweep.results import SweepResults, draw_distributions
from rnc_pin.applications.sweep.rows import SUCCESSFUL, Row
from rnc_pin.io import atomic_file, dump_json


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
