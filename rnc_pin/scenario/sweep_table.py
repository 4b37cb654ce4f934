"""Result table of a sweep, and its statistics."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TypedDict

import numpy as np

Row = dict[str, float | str | None]
"""One run of a sweep: drawn values by dotted key, outcome and result values."""

ErrorStatistics = TypedDict("ErrorStatistics", {"median": float, "95 %": float, "max": float})
"""Statistics of the final errors of one output."""


class SweepStatistics(TypedDict):
    """Outcomes of a sweep, and final errors of the completed runs by output."""

    runs: int
    redrawn: int
    outcomes: dict[str, int]
    final_error: dict[str, ErrorStatistics]


def write_table(rows: list[Row], path: Path) -> None:
    """Write rows as CSV, with a column for each key of any row."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="")
        writer.writeheader()
        writer.writerows(rows)


def _number(row: Row, key: str) -> float:
    value = row[key]
    assert isinstance(value, float | int)
    return value


def sweep_statistics(rows: list[Row]) -> SweepStatistics:
    """Return counts of outcomes and redraws, and the median, 95th percentile and maximum of completed final errors."""
    outcomes: dict[str, int] = {}
    for row in rows:
        outcome = str(row["outcome"])
        outcomes[outcome] = outcomes.get(outcome, 0) + 1
    done = [row for row in rows if row["outcome"] == "completed"]
    names = [key for key in (done[0] if done else {}) if key.startswith("final_error.")]
    errors: dict[str, ErrorStatistics] = {
        name.removeprefix("final_error."): {
            "median": float(np.median([_number(row, name) for row in done])),
            "95 %": float(np.percentile([_number(row, name) for row in done], 95)),
            "max": float(np.max([_number(row, name) for row in done])),
        }
        for name in names
    }
    redrawn = sum(int(_number(row, "redrawn")) for row in rows)
    return {"runs": len(rows), "redrawn": redrawn, "outcomes": outcomes, "final_error": errors}
