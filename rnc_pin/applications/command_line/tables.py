"""Terminal tables of errors and invariants of runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from rnc_pin.simulation import OutputNames, Summary
from rnc_pin.verdict import weight_of

if TYPE_CHECKING:
    from rnc_pin.applications.sweep.reports import SweepStatistics  # sweeps import joblib


def print_table(
    console: Console, title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], numbers: bool = False
) -> None:
    """Print a table under its title.

    Args:
        console: console for the table.
        title: line above the table.
        columns: headings.
        rows: cells of each row.
        numbers: True to align all columns but the first at their right ends.
    """
    table = Table(title=title, title_justify="left", title_style="bold")
    for index, column in enumerate(columns):
        table.add_column(column, justify="right" if numbers and index else "left")
    for row in rows:
        table.add_row(*row)
    console.print(table, highlight=False)


def print_summary(summary: Summary, outputs: OutputNames | None = None) -> None:
    """Print errors and invariants of a run.

    Args:
        summary: summary of the run.
        outputs: outputs and inputs of the run, for their units.
    """
    units = _units(outputs or OutputNames())
    console = Console(markup=False, emoji=False)
    word = summary.get("verdict", summary["outcome"])
    console.print(f"{summary['scenario']}: {word}", style="bold", highlight=False)
    errors = Table("output")
    for column in ("final error", "largest error", "rms error"):
        errors.add_column(column, justify="right")
    for name in summary["final_error"]:
        figures = (each[name] for each in (summary["final_error"], summary["max_error"], summary["rms_error"]))
        errors.add_row(name + units.get(name, ""), *(f"{figure:.2e}" for figure in figures))
    for name, figure in summary.get("goal_error", {}).items():
        if name not in summary["final_error"]:
            errors.add_row(name, f"{figure:.2e}", "-", "-")
    if errors.row_count:
        console.print(errors)
    for finding in summary.get("findings", ()):
        how = weight_of(str(finding["kind"]), str(finding["severity"]), summary.get("accepted", ()))
        console.print(f"{how}: {finding['message']}", highlight=False, soft_wrap=True)
    invariants = Table(show_header=False, box=None, pad_edge=False)
    invariants.add_column()
    invariants.add_column(justify="right")
    invariants.add_row("simulated time", f"{summary['duration']:.2f} s")
    if summary["wall_time"]:
        invariants.add_row(
            "simulation computed in", f"{summary['wall_time']:.2f} s ({summary['realtime_factor']:.1f} x real time)"
        )
    invariants.add_row("constraint residual, largest", f"{summary['constraint_residual_max']:.1e} m/s or rad/s")
    if summary["position_residual_max"]:
        invariants.add_row("position residual, largest", f"{summary['position_residual_max']:.1e} m or rad")
    if summary["energy_drift"] is not None:  # needs the work of the plant
        invariants.add_row("energy less work, drift", f"{summary['energy_drift']:.1e} (relative)")
    if summary["min_singular_value"] is not None:
        invariants.add_row("singular value of E, smallest", f"{summary['min_singular_value']:.3g} (0: singular)")
    if "off_tracking_max" in summary:
        invariants.add_row("trailer off the driven path, largest", f"{summary['off_tracking_max']:.1e} m")
    if summary["lift_off"] is not None:
        lowest = f"{summary['lift_off']['lowest']:.3g} N"
        invariants.add_row(f"normal force of {summary['lift_off']['contact']}, lowest", lowest)
    for words, nearest in (
        ("distance to obstacles, smallest", summary.get("smallest_distance")),
        ("distance between links, smallest", summary.get("smallest_own_distance")),
    ):
        if nearest is not None:
            pair, at = " / ".join(nearest["bodies"]), f"t = {nearest['time']:.2f} s"
            invariants.add_row(words, f"{nearest['distance']:.3g} m, {pair} at {at}")
    inputs = dict(zip(outputs.T, outputs.T_units, strict=False)) if outputs else {}
    for name, figure in summary["max_input"].items():
        invariants.add_row(f"input {name}, largest", f"{figure:.3g} {inputs.get(name, '')}".rstrip())
    console.print(invariants)


def _units(outputs: OutputNames) -> dict[str, str]:
    """Unit of each output in brackets, by name."""
    return {
        name: f" [{unit}]"
        for columns in (outputs.x1, outputs.x2)
        for name, unit in zip(columns.names, columns.units, strict=True)
        if unit
    }


def print_files(folder: Path, names: Sequence[str]) -> None:
    """Print the folder and the names of written files."""
    console = Console(markup=False, emoji=False)
    console.print(f"in {folder}: {', '.join(names)}", highlight=False, soft_wrap=True)


def print_elapsed(elapsed: float, simulation: float | None) -> None:
    """Print the wall time of a command and the share of the simulation [s]."""
    console = Console(markup=False, emoji=False)
    part = f", {simulation:.1f} s of it for the simulation" if simulation else ""
    console.print(f"done in {elapsed:.1f} s{part}", highlight=False)


def print_sweep_statistics(scenario: str, summary: SweepStatistics, folder: Path) -> None:
    """Print verdicts and errors of a sweep."""
    console = Console(markup=False, emoji=False)
    fine = ("succeeded", "degraded")
    failed = {kind: count for kind, count in summary["verdicts"].items() if kind not in fine}
    counts = [f"{summary['verdicts'][word]} {word}" for word in fine if word in summary["verdicts"]]
    if failed:
        kinds = ", ".join(f"{count} {kind}" for kind, count in failed.items())
        counts.append(f"{sum(failed.values())} failed ({kinds})")
    outcomes = ", ".join(counts)
    if summary["redrawn"]:
        outcomes += f" ({summary['redrawn']} draws were infeasible and drawn again)"
    rows = [
        (name, *(f"{each:.2e}" for each in (figures["median"], figures["95 %"], figures["max"])))
        for name, figures in summary["final_error"].items()
    ]
    columns = ("output", "median final error", "95 % below", "largest final error")
    print_table(console, f"{scenario}: {outcomes}", columns, rows, numbers=True)
    console.print(f"in {folder}: runs/*.parquet, distributions.png, sweep.json", highlight=False)
