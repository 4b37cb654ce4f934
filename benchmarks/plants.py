"""Every scenario on both plants: our reduced model, and the robot in MuJoCo on wheels that grip by friction.

    python -m benchmarks.plants --jobs 2

Errors are the largest of a run, without its first fifth, in which trackers still learn; one figure for all goals [m or
rad]. Of MuJoCo, slip is the largest violation of a constraint row [m/s or rad/s] and grip the largest share of it.
"""

from __future__ import annotations

import argparse
from typing import Any

import joblib
import numpy as np
from rich.console import Console
from rich.table import Table

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import RncError
from rnc_pin.simulation import Trajectory, tracking_errors

_NOISE = 1e-6  # an error below which two plants are equal


def largest_error(run: Trajectory) -> float:
    """Of all outputs that have goals, after the first fifth [m or rad]."""
    late = run.time >= 0.2 * run.time[-1]
    return max((float(np.abs(error[late]).max()) for error in tracking_errors(run).values()), default=np.nan)


def on_both(name: str, options: dict[str, Any]) -> tuple[Trajectory, Trajectory]:
    """The run of a scenario on our plant, and in MuJoCo."""
    said = {"comparisons": {}, "plots": {}, **options}
    ours, theirs = (
        execute(Scenario.load(name, {**said, "plant": plant})).trajectory for plant in ("reduced", "mujoco")
    )
    return ours, theirs


def ratio(ours: Trajectory, theirs: Trajectory) -> float:
    """Error in MuJoCo over the error of the reduced model."""
    return largest_error(theirs) / max(largest_error(ours), _NOISE)


def row(name: str, options: dict[str, Any]) -> list[str]:
    """A row of the table."""
    try:
        ours, theirs = on_both(name, options)
    except RncError as error:
        return [name, "", "", "", "", "", str(error)[:80]]
    used = theirs.friction_used[10:]
    return [
        name, f"{ours.time[-1]:g}", f"{largest_error(ours):.1e}", f"{largest_error(theirs):.1e}",
        f"{ratio(ours, theirs):.1f}", f"{np.abs(theirs.slip[10:]).max(initial=0):.0e}",
        (f"{used.max():.2f}" if used.size else "") + ("" if theirs.outcome == "completed" else f" {theirs.outcome}"),
    ]  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Every scenario on both plants.")
    parser.add_argument("--duration", type=float, help="of each run [s]; that of the scenario by default")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--scenarios", nargs="*", default=list(built_in_names()))
    given = parser.parse_args()
    options = {} if given.duration is None else {"simulation.duration": given.duration}
    table = Table("scenario", "simulated [s]", "error, ours", "error, MuJoCo", "ratio", "slip", "grip")
    calls = (joblib.delayed(row)(name, options) for name in given.scenarios)
    for cells in joblib.Parallel(given.jobs, return_as="generator")(calls):
        table.add_row(*cells)
        print(" | ".join(cells), flush=True)
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
