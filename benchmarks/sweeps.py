"""Cost of sweeps: ``python -m benchmarks.sweeps [--runs N] [--rows N] [--json]``.

* a run: processor time of one short run, with everything read and built anew, and with what runs share; with its parts;
* a sweep: runs per second of ``rnc.sweep`` with one and two processes, from the call to the data set, and without
  the start of the processes;
* a row: what the main process does for each run that a worker finished, its memory over the number of rows, and bytes
  on disk;
* projections from these unit costs: 1e5 runs on this machine, 1e8 runs on a cluster.

Times are processor times except those of sweeps, which are wall times and mean something on an idle machine only.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import rnc_pin as rnc
from rnc_pin.scenario.execution import execute
from rnc_pin.sweeps.run_store import RunStore
from rnc_pin.sweeps.scenario_runs import ScenarioRuns
from rnc_pin.sweeps.seeded_draws import draws_of
from rnc_pin.sweeps.swept_run import results_of

SCENARIO = "space-robot"
OPTIONS = {"simulation.duration": 0.05}  # 26 samples of 2 ms
_STEPS = 4  # memory is read after as many equal numbers of rows


def source() -> ScenarioRuns:
    draws = draws_of(SCENARIO, OPTIONS)
    return ScenarioRuns(SCENARIO, OPTIONS, draws, draws.seed)


def spent(function: Callable[[], object]) -> float:
    """Processor time of a call [s]."""
    start = time.process_time()
    function()
    return time.process_time() - start


def run_cost(runs: int) -> dict[str, float]:
    """Processor time of a short run [ms], all figures taken in turn."""
    shared = source()
    shared.row(0)
    totals = dict.fromkeys(("anew", "shared", "prepare", "simulate", "summary columns"), 0.0)
    for run in range(runs):
        totals["anew"] += spent(lambda run=run: source().row(run))
        totals["shared"] += spent(lambda run=run: shared.row(run))
        options = shared.options_of(run, next(draws_of(SCENARIO, OPTIONS).of_run(run)))
        made: list[Any] = []
        totals["prepare"] += spent(lambda options=options, made=made: made.append(shared._plan(options)))
        totals["simulate"] += spent(lambda made=made: made.append(execute(made[0])))
        totals["summary columns"] += spent(lambda made=made: results_of(made[1].summary))
    return {name: 1e3 * total / runs for name, total in totals.items()}


def sweep_rate(runs: int, jobs: int) -> dict[str, float]:
    """Runs per second of a sweep, altogether and after its first tenth [1/s]."""
    marks: dict[str, tuple[float, int]] = {}

    def progress(done: int, total: int | None) -> None:
        if done >= runs // 10:
            marks.setdefault("tenth", (time.perf_counter(), done))
            marks["last"] = time.perf_counter(), done

    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        rnc.sweep(SCENARIO, runs, options=OPTIONS, jobs=jobs, out=folder, progress=progress)
        total = time.perf_counter() - start
    (begin, first), (end, last) = marks["tenth"], marks["last"]
    return {"jobs": jobs, "whole": runs / total, "steady": (last - first) / max(end - begin, 1e-9)}


def resident() -> float:
    """Resident memory of this process [MiB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def row_cost(rows: int) -> dict[str, Any]:
    """Cost of a row in the main process: time [us], memory [MiB] over rows, bytes on disk."""
    row = source().row(0)
    numbers = [name for name, value in row.items() if isinstance(value, float)]
    generator = np.random.default_rng(0)  # numbers that cannot be compressed
    memory, elapsed = [], 0.0
    with tempfile.TemporaryDirectory() as folder:
        store = RunStore(Path(folder), {})
        RunStore(Path(folder) / "warm", {}).add([{**row, "run": run} for run in range(5000)])  # imports pyarrow
        for step in range(_STEPS):
            begin, end = step * rows // _STEPS, (step + 1) * rows // _STEPS
            for first in range(begin, end, 10):
                some = [
                    {**row, **dict(zip(numbers, generator.normal(size=len(numbers)).tolist(), strict=True)), "run": run}
                    for run in range(first, min(first + 10, end))
                ]
                elapsed += spent(lambda some=some: store.add(some))
            memory.append((end, round(resident(), 1)))
        elapsed += spent(store.finish)
        size = sum(path.stat().st_size for path in Path(folder).glob("part_*.parquet"))
    return {"us": 1e6 * elapsed / rows, "memory": memory, "bytes": size / rows}


def projections(run: dict[str, float], row: dict[str, Any]) -> dict[str, float]:
    """Unit costs times numbers of runs."""
    per_run = 1e-3 * run["shared"]
    return {
        "1e5 runs on two cores [min]": 1e5 * per_run / 2 / 60,
        "1e8 runs, workers [core hours]": 1e8 * per_run / 3600,
        "1e8 runs, main process [hours]": 1e8 * 1e-6 * row["us"] / 3600,
        "cores that one main process feeds": per_run / (1e-6 * row["us"]),
        "1e8 runs, data set [GB]": 1e8 * row["bytes"] / 1e9,
    }


def measure(runs: int, rows: int, jobs: tuple[int, ...]) -> dict[str, Any]:
    run, row = run_cost(max(3, runs // 10)), row_cost(rows)
    return {
        "run_ms": run,
        "sweeps": [sweep_rate(runs, each) for each in jobs],
        "row": row,
        "projections": projections(run, row),
        "machine": {"cpus": os.cpu_count(), "load": os.getloadavg()[0]},
    }


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sweeps")
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--rows", type=int, default=100_000)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args(arguments)
    found = measure(given.runs, given.rows, (1, 2))
    if given.json:
        print(json.dumps(found, indent=2))
        return
    print("| processor time of a run of 26 samples | ms |\n|---|---|")
    print(*(f"| {name} | {value:.2f} |" for name, value in found["run_ms"].items()), sep="\n")
    print("\n| processes | runs/s, whole sweep | runs/s, after the start |\n|---|---|---|")
    print(*(f"| {each['jobs']} | {each['whole']:.1f} | {each['steady']:.1f} |" for each in found["sweeps"]), sep="\n")
    row = found["row"]
    print(f"\na row: {row['us']:.0f} us of the main process, {row['bytes']:.0f} bytes in the data set")
    print("\n| rows | memory of the main process [MiB] |\n|---|---|")
    print(*(f"| {count:,} | {memory} |" for count, memory in row["memory"]), sep="\n")
    print("\n| projection | |\n|---|---|")
    print(*(f"| {name} | {value:.3g} |" for name, value in found["projections"].items()), sep="\n")
    print(f"\nload {found['machine']['load']:.1f} on {found['machine']['cpus']} cores")


if __name__ == "__main__":
    main(sys.argv[1:])
