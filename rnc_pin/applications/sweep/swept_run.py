"""Row of a sweep's table: the values of one run and its results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from rnc_pin.applications.sweep.seeded_draws import Draw
from rnc_pin.errors import RncError
from rnc_pin.io import Json
from rnc_pin.simulation import Summary, Trajectory

Row: TypeAlias = dict[str, Any]
"""One run of a sweep: number, drawn values and results by column."""

ERRORS = ("final_error", "max_error", "rms_error")
"""Results by output; a column has the name of the output behind a point."""
LIMITS = "limit_excess"
"""Largest excess over joint limits, as a share of their range; a column has the kind of the limit behind a point."""
RESULTS = {
    **dict.fromkeys(("outcome", "verdict", "finding", "message", "warnings"), "text"),
    "redrawn": "integer",
    "duration": "number",
    "min_singular_value": "number",
    "constraint_residual_max": "number",
    "position_residual_max": "number",
    "energy_drift": "number",
    "off_tracking_max": "number",
    "goals_missed": "integer",
    "lowest_normal_force": "number",
    "smallest_distance": "number",
    "smallest_own_distance": "number",
    "wall_time": "number",
}
"""Kinds of the other columns of results, by name."""


Numbered: TypeAlias = tuple[int, Draw | None]
"""Number of a run, and its given values; None draws them by the number of the run."""


class Runs(Protocol):
    """Source of the rows of a sweep. It is pickled, and what it keeps between runs is not."""

    @property
    def advance_together(self) -> bool:
        """True if runs of a batch advance together, and so cost less."""
        ...

    def rows(self, batch: Sequence[Numbered]) -> list[Row]:
        """Simulate a batch of runs and return their rows, none of which depends on the others."""
        ...


def is_result_column(column: str) -> bool:
    """True for columns of results; False for drawn values."""
    return column == "run" or column in RESULTS or column.partition(".")[0] in (*ERRORS, LIMITS)


def results_of(summary: Summary) -> Row:
    """Columns of results from the summary of a run."""
    lift_off = summary["lift_off"]
    errors = {
        f"{kind}.{name}": value
        for kind, found in zip(
            ERRORS, (summary["final_error"], summary["max_error"], summary["rms_error"]), strict=True
        )
        for name, value in found.items()
    }
    first = summary.get("first_finding", {"kind": "", "message": ""})
    nearest = {"smallest_distance": summary.get("smallest_distance")}
    return {
        "outcome": summary["outcome"],
        "verdict": summary["verdict"],
        "finding": first["kind"],
        "message": first["message"],
        "duration": summary["duration"],
        **errors,
        "min_singular_value": summary["min_singular_value"],
        "constraint_residual_max": summary["constraint_residual_max"],
        "position_residual_max": summary["position_residual_max"],
        "energy_drift": summary["energy_drift"],
        **({"off_tracking_max": summary["off_tracking_max"]} if "off_tracking_max" in summary else {}),
        "goals_missed": len(summary.get("goals_missed", ())),
        "lowest_normal_force": None if lift_off is None else lift_off["lowest"],
        **{name: None if found is None else found["distance"] for name, found in nearest.items()},
        **{f"{LIMITS}.{kind}": worst["excess"] for kind, worst in summary.get("joint_limits", {}).items()},
    }


SUCCESSFUL = ("succeeded", "degraded")
"""Verdicts of runs that did not fail."""


def verdict_or_failure(verdict: str, finding: str) -> str:
    """Verdict of a run; the kind of the finding that failed it instead of "failed"."""
    return finding if verdict == "failed" else verdict


def refused(outcome: str, error: RncError) -> Row:
    """Columns of results of a run that could not start."""
    return {"outcome": outcome, "verdict": "failed", "finding": outcome, "message": str(error)}


def trajectory_file(folder: Path, run: int) -> Path:
    """File of the trajectory of a run, in the folder of its sweep."""
    return folder / "trajectories" / f"run_{run:07d}.npz"


def save_trajectory(trajectory: Trajectory, folder: str | None, run: int) -> None:
    """Write the trajectory of a run, complete or not at all; without a folder do nothing."""
    if folder is not None:
        path = trajectory_file(Path(folder), run)
        path.parent.mkdir(parents=True, exist_ok=True)
        trajectory.save(path)


def with_options_of_sweeps(options: Mapping[str, Json]) -> dict[str, Json]:
    """Options of every run of a sweep: no comparisons and plots, and preflight refuses instead of warning."""
    return {"preflight": "refuse", **options, "comparisons": {}, "plots": {}}
