"""Many runs with drawn faults, controller by controller: what is survived, and how the error grows.

    python -m benchmarks.campaign --runs 1000 --jobs 2

A run survives if it is completed and its outputs are at their goals at the end within a tenth of the way that they
went. Every other run ends with a named error, its data kept; none in NaN.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from typing import Any

import joblib
import numpy as np
from rich.console import Console
from rich.table import Table

from rnc_pin.errors import RncError
from rnc_pin.scenario.run import execute, plan

SCENARIOS: dict[str, dict[str, Any]] = {
    "space-robot": {"simulation.duration": 8.0, "simulation.dt": 0.005},
    "mobile-manipulator": {"simulation.duration": 8.0, "simulation.dt": 0.005},
    "unicycle": {"simulation.duration": 8.0, "simulation.dt": 0.005},
    "mobile-manipulator-two-phase": {"simulation.duration": 14.0, "simulation.dt": 0.005},
}
LARGEST = {
    "position_noise": 1e-3,
    "velocity_noise": 0.02,
    "position_bias": 5e-3,
    "velocity_bias": 5e-3,
    "counts": 1e-4,
    "delay": 4,
    "jitter": 0.5,
    "dropped": 0.2,
    "garbage": 0.2,
    "effort": 0.5,
    "dead_zone": 0.05,
    "friction": 0.05,
    "masses": 0.5,
    "payload": 0.1,
    "slip_speed": 0.2,
    "stuck": 1.0,
}
"""Of each fault the largest size that is drawn: in its own unit; of inputs a share of the largest without a fault, of
payloads a share of the robot's mass; of encoders one over the counts."""


def spoilt(fault: str, size: float, clean: dict[str, Any]) -> dict[str, Any]:
    """What a scenario says of a fault of some size."""
    if fault == "effort":
        return {fault: (1.0 - size) * clean["peak"]}
    if fault in ("dead_zone", "friction"):
        return {fault: size * clean["peak"]}
    if fault == "counts":
        return {fault: 1.0 / max(size, 1e-9)}
    if fault == "delay":
        return {fault: round(size)}
    if fault == "payload":
        return {fault: {"frame": clean["frame"], "mass": max(size, 1e-3) * clean["mass"], "time": 1.0}}
    if fault == "stuck":
        return {fault: {"joint": clean["joint"], "time": 10.0 * size}}
    return {fault: size, **({"slip_time": 1.0, "slip_duration": 0.1} if fault == "slip_speed" else {})}


def result(scenario: str, options: dict[str, Any]) -> tuple[str, float, bool, Any, Any]:
    """Outcome, largest final error as a share of the way, whether anything was not a number, experiment and run."""
    prepared = plan(scenario, {"comparisons": {}, **SCENARIOS[scenario], **options})
    found = execute(prepared)
    run, errors = found.trajectory, found.summary["final_error"]
    ways = [np.ptp(getattr(run, kind), axis=0) for kind in ("x2", "x1")]
    names = [name for kind in ("x2", "x1") for name in run.info.outputs.of(kind).names]
    way = dict(zip(names, np.concatenate(ways), strict=True))
    worst = max((error / max(way[name], 0.1) for name, error in errors.items()), default=np.nan)
    broken = not all(np.isfinite(array).all() for array in (run.q, run.v, run.T))
    message = found.summary.get("message", "")
    return (
        str(run.outcome) + (f": {message.split(' at ')[0][:60]}" if message else ""),
        float(worst),
        broken,
        prepared,
        run,
    )


def reference(scenario: str) -> dict[str, Any]:
    """The run without a fault, and what sizes of faults are measured by."""
    outcome, error, _, prepared, run = result(scenario, {})
    reduced = prepared.experiment.reduced
    robot = reduced.robot
    last = [name for name in robot.joint_names if name in reduced.actuation.names]
    return {
        "outcome": outcome, "error": error, "peak": float(np.abs(run.T).max()),
        "joint": (last or [robot.joint_names[-1]])[-1],
        "frame": robot.model.frames[-1].name, "mass": float(sum(each.mass for each in robot.model.inertias)),
    }  # fmt: skip


def one(scenario: str, fault: str, run: int, clean: dict[str, Any]) -> tuple[str, float, bool, float]:
    """One run: outcome, error, whether it holds NaN, and the size of the fault."""
    size = float(np.random.default_rng([run, *fault.encode()]).uniform(0.0, LARGEST[fault]))
    options = {"seed": run, "faults": spoilt(fault, size, clean), "preflight": "warn"}
    try:
        outcome, error, broken, *_ = result(scenario, options)
    except RncError as failure:
        return f"refused: {failure}"[:80], np.nan, False, size
    return outcome, error, broken, size


def main() -> int:
    """Run the campaign and print its table; the exit status says whether anything ended without a name."""
    parser = argparse.ArgumentParser(description="Many runs with drawn faults.")
    parser.add_argument("--runs", type=int, default=1000, help="of each fault and controller")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--faults", nargs="*", choices=list(LARGEST), default=list(LARGEST))
    parser.add_argument("--scenarios", nargs="*", choices=list(SCENARIOS), default=list(SCENARIOS))
    given = parser.parse_args()
    table = Table(
        "scenario", "fault", "largest", "runs", "survived", "median error", "worst error", "how the others ended"
    )
    start, nameless = time.process_time(), 0
    for scenario in given.scenarios:
        clean = reference(scenario)
        table.add_row(
            scenario, "none", "", "1", "1", f"{clean['error']:.1e}", f"{clean['error']:.1e}", clean["outcome"]
        )
        for fault in given.faults:
            calls = [joblib.delayed(one)(scenario, fault, run, clean) for run in range(given.runs)]
            rows = joblib.Parallel(given.jobs)(calls)
            done = [row for row in rows if row[0] == "completed"]
            well = [row for row in done if row[1] < 0.1]
            errors = [row[1] for row in done] or [np.nan]
            others = Counter(row[0] for row in rows if row[0] != "completed")
            if len(well) < len(done):
                others["completed, off its goal"] = len(done) - len(well)
            nameless += sum(row[2] or not row[0] for row in rows)
            table.add_row(
                scenario, fault, f"{LARGEST[fault]:g}", str(len(rows)), str(len(well)), f"{np.median(errors):.1e}",
                f"{np.max(errors):.1e}", "; ".join(f"{count} x {what}" for what, count in others.most_common(3)),
            )  # fmt: skip
            print(f"{scenario} {fault}: {len(well)} of {len(rows)}", file=sys.stderr, flush=True)
    Console(width=180).print(table)
    print(
        f"{nameless} runs with NaN or without a named end; {time.process_time() - start:.0f} s of processor time here"
    )
    return 1 if nameless else 0


if __name__ == "__main__":
    sys.exit(main())
