"""Cost of sweeps.

One sweep of N short runs on K processes: runs per second, memory of the main process and of its workers on the way,
and size on disk. With ``--out`` the folder remains, and the same command continues a sweep that was interrupted.

``--units`` adds the costs of which a sweep consists:

* a run: processor time of one short run, with everything read and built anew, and with what runs share;
* a row: what the main process does for each run that a worker finished, its memory over the number of rows, and bytes
  on disk;
* a projection from these unit costs: 1e8 runs on a cluster.

Times of units are processor times. Those of sweeps are wall times, and mean something on an idle machine only.
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
from benchmarks.processes import children
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.sweep.rows import results_of
from rnc_pin.applications.sweep.scenario_runs import ScenarioRuns, draws_of
from rnc_pin.applications.sweep.sweep_folder import RunStore

SCENARIO = "space-robot"
OPTIONS = {"simulation.duration": 0.05}  # 26 samples of 2 ms
_STEPS = 4  # memory is read after as many equal numbers of rows
_SHOWN = 20  # progress reports of a sweep


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
        totals["prepare"] += spent(lambda options=options, made=made: made.append(shared._scenario(options)))
        totals["simulate"] += spent(lambda made=made: made.append(execute(made[0])))
        totals["summary columns"] += spent(lambda made=made: results_of(made[1].summary))
    return {name: 1e3 * total / runs for name, total in totals.items()}


def resident(pid: int | str = "self") -> float:
    """Resident memory of a process [MiB]; zero if it has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


class Watch:
    """Progress of a sweep: its rate, and the memory of its processes.

    Attributes:
        reports: share, finished runs, time since the start [s], memory of this process and of its largest worker [MiB].
    """

    def __init__(self) -> None:
        self.start, self.reports = time.perf_counter(), list[tuple[float, int, float, float, float]]()
        self.first = -1
        """Runs of an earlier sweep in the folder; -1 before the first report."""
        self._due = 1

    def __call__(self, done: int, total: int | None) -> None:
        assert total is not None
        self.first = done if self.first < 0 else self.first
        if total > self.first and (done - self.first) * _SHOWN // (total - self.first) >= self._due:
            self._due = (done - self.first) * _SHOWN // (total - self.first) + 1
            share, elapsed = done / total, time.perf_counter() - self.start
            workers = [resident(pid) for pid in children(os.getpid())]
            self.reports.append((share, done, elapsed, resident(), max(workers, default=0.0)))
            rate = (done - self.first) / max(elapsed, 1e-9)
            left = (total - done) / max(rate, 1e-9)
            text = f"{done:,} of {total:,} runs, {rate:.0f}/s, {elapsed:.0f} s, {left:.0f} s left"
            print(f"{text}, load {os.getloadavg()[0]:.1f}", file=sys.stderr, flush=True)


def real_sweep(runs: int, jobs: int, out: Path | None) -> dict[str, Any]:
    """Rate [1/s], memory [MiB] and size [MB] of a sweep."""
    with tempfile.TemporaryDirectory() as folder:
        place, watch = Path(folder) / "sweep" if out is None else out, Watch()
        results = rnc.sweep(SCENARIO, runs, options=OPTIONS, jobs=jobs, out=place, progress=watch)
        elapsed = time.perf_counter() - watch.start
        size = sum(path.stat().st_size for path in place.rglob("*") if path.is_file())
        outcomes, count = results.outcomes, len(results)
    computed, some = count - watch.first, watch.reports
    if not some:
        raise SystemExit(f"{place}: is complete; nothing was left to compute")
    early, late = some[len(some) // 10], some[-1]
    steady = (late[1] - early[1]) / max(late[2] - early[2], 1e-9) if late[1] > early[1] else computed / elapsed
    return {
        "runs": count,
        "computed": computed,
        "jobs": jobs,
        "outcomes": outcomes,
        "seconds": elapsed,
        "per_second": computed / elapsed,
        "steady": steady,
        "reports": some,
        "megabytes": size / 1e6,
        "load": os.getloadavg()[0],
    }


def show_sweep(found: dict[str, Any]) -> None:
    """Print the figures of a sweep."""
    print("| share | runs | s | main process [MiB] | largest worker [MiB] |\n|---|---|---|---|---|")
    wanted = [0.1, 0.25, 0.5, 0.75, 1.0]
    some = [min(found["reports"], key=lambda report, share=share: abs(report[0] - share)) for share in wanted]
    for share, done, elapsed, main_process, worker in dict.fromkeys(some):
        print(f"| {share:.0%} | {done:,} | {elapsed:.0f} | {main_process:.0f} | {worker:.0f} |")
    said = ", ".join(f"{count:,} {outcome}" for outcome, count in found["outcomes"].items())
    print(
        f"\n{found['computed']:,} runs of 26 samples in {found['seconds']:.0f} s on {found['jobs']} processes: "
        f"{found['per_second']:.1f} runs/s, {found['steady']:.1f} after the start; {said}\n"
        f"{found['megabytes']:.1f} MB on disk, {1e6 * found['megabytes'] / found['runs']:.0f} bytes a run\n"
        f"1e5 runs at this rate: {1e5 / found['steady'] / 60:.1f} minutes; load {found['load']:.1f}"
    )


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
        "1e8 runs, workers [core hours]": 1e8 * per_run / 3600,
        "1e8 runs, main process [hours]": 1e8 * 1e-6 * row["us"] / 3600,
        "cores that one main process feeds": per_run / (1e-6 * row["us"]),
        "1e8 runs, data set [GB]": 1e8 * row["bytes"] / 1e9,
    }


def show_units(found: dict[str, Any]) -> None:
    """Print unit costs and projections."""
    print("\n| processor time of a run of 26 samples | ms |\n|---|---|")
    print(*(f"| {name} | {value:.2f} |" for name, value in found["run_ms"].items()), sep="\n")
    row = found["row"]
    print(f"\na row: {row['us']:.0f} us of the main process, {row['bytes']:.0f} bytes in the data set")
    print("\n| rows | memory of the main process [MiB] |\n|---|---|")
    print(*(f"| {count:,} | {memory} |" for count, memory in row["memory"]), sep="\n")
    print("\n| projection | |\n|---|---|")
    print(*(f"| {name} | {value:.3g} |" for name, value in found["projections"].items()), sep="\n")


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sweeps")
    parser.add_argument("--runs", type=int, default=400, help="runs of the sweep")
    parser.add_argument("--jobs", type=int, default=2, help="its processes")
    parser.add_argument("--out", type=Path, help="its folder, which remains; a temporary one by default")
    parser.add_argument("--units", action="store_true", help="measure unit costs too")
    parser.add_argument("--rows", type=int, default=100_000, help="made-up rows for the cost of a row")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args(arguments)
    found: dict[str, Any] = {"sweep": real_sweep(given.runs, given.jobs, given.out)}
    if given.units:
        run, row = run_cost(40), row_cost(given.rows)
        found |= {"run_ms": run, "row": row, "projections": projections(run, row)}
    if given.json:
        print(json.dumps(found, indent=2))
        return
    show_sweep(found["sweep"])
    if given.units:
        show_units(found)


if __name__ == "__main__":
    main(sys.argv[1:])
