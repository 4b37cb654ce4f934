"""Many runs with drawn faults, controller by controller: what is survived, and how the error grows.

    python -m benchmarks.campaign --runs 1000 --jobs 2 --out campaign.csv

What is in the file already is not run again, so that a campaign can be interrupted and made larger.

A run survives if it is completed and its outputs are at their goals at the end within a tenth of the way that they
went, or within twice what is left there without a fault. Every other run ends with a named error, its data kept; none
in NaN.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import time
from collections import Counter
from pathlib import Path

import joblib
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.faulty_runs import LARGEST, SCENARIOS, Row, reference, rows_of

TOGETHER = 100
"""Runs that a process takes at once."""
WHOLE = 64_000
"""Runs of the whole campaign: 1,000 for each of 16 faults and 4 controllers."""


class Kept:
    """Rows of a campaign, in a file if there is one."""

    def __init__(self, path: Path | None) -> None:
        self.rows: dict[tuple[str, str, int], Row] = {}
        self._path = path
        if path is not None and path.exists():
            with path.open(newline="") as file:
                for scenario, fault, run, size, outcome, error, broken in csv.reader(file):
                    self._keep(Row(scenario, fault, int(run), float(size), outcome, float(error), broken == "True"))

    def _keep(self, row: Row) -> None:
        self.rows[row[:3]] = row

    def add(self, row: Row) -> None:
        self._keep(row)
        if self._path is not None:
            with self._path.open("a", newline="") as file:
                csv.writer(file).writerow(row)


def line(scenario: str, fault: str, rows: list[Row], clean: float) -> list[str]:
    """Of the table, for all runs with a fault."""
    done = [row for row in rows if row.outcome == "completed"]
    well = [row for row in done if _arrived(row, clean)]
    errors = [row.error for row in done] or [np.nan]
    others = Counter(row.outcome for row in rows if row.outcome != "completed")
    if len(well) < len(done):
        others["completed, off its goal"] = len(done) - len(well)
    # Up to which size at least 95 of 100 survive.
    sizes = sorted((row.size, _arrived(row, clean)) for row in rows)
    share = np.cumsum([good for _, good in sizes]) / np.arange(1, len(sizes) + 1)
    safe = max((size for (size, _), each in zip(sizes, share, strict=True) if each >= 0.95), default=0.0)
    return [
        scenario, fault, f"{LARGEST[fault]:g}", str(len(rows)), str(len(well)), f"{safe:.2g}",
        f"{np.median(errors):.1e}", f"{np.max(errors):.1e}",
        "; ".join(f"{count} x {what}" for what, count in others.most_common(3)),
    ]  # fmt: skip


def _arrived(row: Row, clean: float) -> bool:
    return row.outcome == "completed" and row.error < max(0.1, 2.0 * clean)


def main() -> int:
    """Run the campaign and print its table; the exit status says whether anything ended without a name."""
    parser = argparse.ArgumentParser(description="Many runs with drawn faults.")
    parser.add_argument("--runs", type=int, default=1000, help="of each fault and controller")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, help="CSV file that rows are added to")
    parser.add_argument("--faults", nargs="*", choices=list(LARGEST), default=list(LARGEST))
    parser.add_argument("--scenarios", nargs="*", choices=list(SCENARIOS), default=list(SCENARIOS))
    given = parser.parse_args()
    table = Table(
        "scenario", "fault", "largest", "runs", "survived", "95 % do up to", "median error", "worst error",
        "how the others ended",
    )  # fmt: skip
    kept, start, used, computed = Kept(given.out), time.perf_counter(), time.process_time(), 0
    for scenario in given.scenarios:
        clean = reference(scenario)
        table.add_row(
            scenario, "none", "", "1", "1", "", f"{clean['error']:.1e}", f"{clean['error']:.1e}", clean["outcome"]
        )
        for fault in given.faults:
            keys = [(scenario, fault, run) for run in range(given.runs)]
            due = [run for *_, run in keys if (scenario, fault, run) not in kept.rows]
            calls = [
                joblib.delayed(rows_of)(scenario, fault, due[k : k + TOGETHER], clean)
                for k in range(0, len(due), TOGETHER)
            ]
            for rows in joblib.Parallel(given.jobs, return_as="generator_unordered")(calls):
                for row in rows:
                    kept.add(row)
                computed += len(rows)
            cells = line(scenario, fault, [kept.rows[key] for key in keys], clean["error"])
            table.add_row(*cells)
            print(" ".join(cells[:5]), file=sys.stderr, flush=True)
    Console(width=180).print(table)
    nameless = sum(row.broken or not row.outcome for row in kept.rows.values())
    print(f"{nameless} of {len(kept.rows)} runs with NaN or without a named end")
    elapsed = time.perf_counter() - start
    rate = computed / elapsed
    print(
        f"{computed:,} runs in {elapsed / 60:.1f} minutes on {given.jobs} processes: {rate:.1f} runs/s; "
        f"{WHOLE:,} runs, {WHOLE // 64} of each kind, at this rate: {WHOLE / max(rate, 1e-9) / 60:.0f} minutes; "
        f"load {os.getloadavg()[0]:.1f}"
    )
    if given.jobs == 1 and computed:
        spent = time.process_time() - used
        print(
            f"processor time {spent:.0f} s, {1e3 * spent / computed:.1f} ms a run: {WHOLE:,} runs on two cores at this "
            f"cost: {WHOLE * spent / computed / 120:.1f} minutes"
        )
    return 1 if nameless else 0


if __name__ == "__main__":
    sys.exit(main())
