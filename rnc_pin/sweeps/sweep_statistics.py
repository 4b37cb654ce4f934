"""Statistics of the runs of a sweep, in constant memory."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TypedDict

import numpy as np

from rnc_pin.sweeps.order_statistics import quantiles
from rnc_pin.sweeps.sweep_results import SweepResults

ErrorStatistics = TypedDict("ErrorStatistics", {"median": float, "95 %": float, "max": float})
"""Statistics of the final errors of one output."""


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
