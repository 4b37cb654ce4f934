"""What people see in the terminal: a progress bar and tables."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table


class ProgressBar:
    """A progress bar on stderr; gives a function that takes how far it is."""

    def __init__(self, console: Console, total: float, text: str, quiet: bool) -> None:
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=quiet or not console.is_terminal,
        )
        self._task = self._bar.add_task(text, total=total)
        self._shown, self._grain = 0.0, total / 400

    def __enter__(self) -> Callable[[float], None]:
        self._bar.start()
        return self._advance

    def _advance(self, done: float) -> None:
        # Called at every sample: the bar need not know of each.
        if done >= self._shown:
            self._shown = done + self._grain
            self._bar.update(self._task, completed=done)

    def __exit__(self, *error: object) -> None:
        if error[0] is None:
            self._bar.update(self._task, completed=self._bar.tasks[0].total)
        self._bar.stop()


def print_json(content: Any) -> None:
    """Print JSON on standard output."""
    click.echo(json.dumps(content, indent=2))


def print_summary(summary: dict[str, Any], folder: Path) -> None:
    """Errors and invariants of a run."""
    console = Console()
    errors = Table(title=f"{summary['scenario']}: {summary['outcome']}", title_justify="left", title_style="bold")
    errors.add_column("output")
    for column in ("final error", "largest error", "rms error"):
        errors.add_column(column, justify="right")
    for name in summary["final_error"]:
        figures = (summary[key][name] for key in ("final_error", "max_error", "rms_error"))
        errors.add_row(name, *(f"{figure:.2e}" for figure in figures))
    console.print(errors)
    invariants = Table(show_header=False, box=None, pad_edge=False)
    invariants.add_column()
    invariants.add_column(justify="right")
    invariants.add_row("simulated time", f"{summary['duration']:.2f} s")
    if summary["wall_time"]:
        invariants.add_row(
            "computed in", f"{summary['wall_time']:.2f} s ({summary['realtime_factor']:.1f} x real time)"
        )
    invariants.add_row("constraint residual, largest", f"{summary['constraint_residual_max']:.1e}")
    invariants.add_row("energy less work, drift", f"{summary['energy_drift']:.1e}")
    if summary["min_singular_value"] is not None:
        invariants.add_row("singular value of E, smallest", f"{summary['min_singular_value']:.3g}")
    if "off_tracking_max" in summary:
        invariants.add_row("trailer off the driven path, largest", f"{summary['off_tracking_max']:.1e} m")
    for name, figure in summary["max_input"].items():
        invariants.add_row(f"input {name}, largest", f"{figure:.3g}")
    console.print(invariants)
    if "files" in summary:
        console.print(f"in {folder}: {', '.join(summary['files'])}", highlight=False, soft_wrap=True)


def print_report(content: dict[str, Any]) -> None:
    """What ``inspect`` found."""
    console = Console()
    table = Table(show_header=False, title=f"{content['system']} ({content['robot']})", title_justify="left")
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    condition, lemma = content["condition"], content["lemma1"]
    dropped = [f"{row['name']}: {row['reason']}" for row in content["dropped_rows"]]
    realised = "every F can be realised" if content["actuation_rank"] == content["r"] else "not every F can be realised"
    growth = content["growth_vector"]
    whole = (
        "completely nonholonomic" if content["completely_nonholonomic"] else f"reaches {growth[-1]} of {content['n']}"
    )
    redundancy = content["redundancy"]
    table.add_row("degrees of freedom", f"{content['n']}, of which {content['r']} are left by the constraints")
    table.add_row("constraint rows kept", "\n".join(content["kept_rows"]) or "none")
    table.add_row("constraint rows dropped", "\n".join(dropped) or "none")
    table.add_row("reducing outputs", ", ".join(content["reducing"]))
    table.add_row("vertical outputs", ", ".join(content["vertical"]) or "none")
    table.add_row("actuators", f"{', '.join(content['actuators']) or 'none'}")
    table.add_row("rank of R^T B", f"{content['actuation_rank']} of {content['r']}: {realised}")
    table.add_row("growth vector", f"({', '.join(map(str, growth))}): {whole}")
    table.add_row("redundancy class", f"{content['redundancy_class'] or 'none'}: {redundancy['reason']}")
    figures = [f"{key} = {value}" for key, value in redundancy.items() if key not in ("reason", "tracked", "driven")]
    table.add_row("  evidence", "\n".join(figures) or "none")
    table.add_row(
        "condition of E",
        f"{condition['min']:.3g} to {condition['max']:.3g}, median {condition['median']:.3g}; "
        f"{content['singular_samples']} of {content['samples']} samples singular",
    )
    table.add_row(
        "Lemma 1",
        ("holds: " if content["lemma1_holds"] else "DOES NOT HOLD: ")
        + ", ".join(f"{name} {value:.1e}" for name, value in lemma.items()),
    )
    console.print(table)


def print_spread(summary: dict[str, Any], folder: Path) -> None:
    """Outcomes and errors of a sweep."""
    console = Console()
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in summary["outcomes"].items())
    if summary["redrawn"]:
        outcomes += f" ({summary['redrawn']} tasks did not pass preflight and were drawn again)"
    table = Table(title=f"{summary['scenario']}: {outcomes}", title_justify="left", title_style="bold")
    table.add_column("output")
    table.add_column("median final error", justify="right")
    table.add_column("95 % below", justify="right")
    table.add_column("largest final error", justify="right")
    for name, figures in summary["final_error"].items():
        table.add_row(name, *(f"{figures[key]:.2e}" for key in ("median", "95 %", "max")))
    console.print(table)
    console.print(f"in {folder}: sweep.csv, sweep.json and a folder for each run", highlight=False)
