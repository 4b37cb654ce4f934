"""Report of a command on the terminal: progress, tables of errors and invariants, verdict and exit status."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypedDict, cast

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from rnc_pin.applications.command_line import messages
from rnc_pin.applications.scenario.execution import Drawn, Result, draw_pictures, picture_names, result_names, write
from rnc_pin.applications.scenario.output_folder import OutputFolder
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import RncError
from rnc_pin.interruption import uninterrupted
from rnc_pin.printing import Line, SummaryMixin
from rnc_pin.simulation import PrintedSummary, Summary
from rnc_pin.verdict import Severity, Verdict, weight_of


class Watching(TypedDict):
    """Options of the live view."""

    speed: float
    browser: bool
    host: str


@contextmanager
def progress_bar(
    total: float, text: str, quiet: bool, restarts: bool = False
) -> Iterator[Callable[[float, str], None]]:
    """Show a progress bar on stderr; yield a callback that takes the value so far and the activity.

    Args:
        total: value at 100 %.
        text: current activity. Without a terminal this line is printed, and one each minute.
        quiet: print nothing.
        restarts: count the first value above zero as done before the start: the estimate of the remaining time leaves
            it out.
    """
    console = Console(stderr=True)
    # A log has no bar: one line says what takes the time.
    if not console.is_terminal:
        messages.announce(text, quiet)
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=quiet or not console.is_terminal,
    )
    task = bar.add_task(text, total=total)

    def reached() -> str:
        return f"{bar.tasks[0].description}: {bar.tasks[0].percentage:.0f} %"

    def advance(done: float, text: str) -> None:
        nonlocal restarts
        if restarts and done:
            bar.reset(task, completed=int(done))
            restarts = False
        bar.update(task, completed=done, description=text)

    with messages.told_each_minute(reached, quiet), bar:
        yield advance
        # A run that ended early is done too: the bar does not stop below 100 %.
        bar.update(task, completed=total)


def print_object(found: SummaryMixin, title: str, lines: Sequence[Line] = ()) -> None:
    """Print all that an object says about itself as a table.

    Args:
        found: the object.
        title: line above the table.
        lines: first lines of the table.
    """
    table = Table(show_header=False, title=title, title_justify="left", title_style="bold", show_lines=True)
    table.add_column(style="bold")
    # Long names are folded, and not cut.
    table.add_column(overflow="fold")
    for label, items in (*lines, *found.summary_lines()):
        if items:
            table.add_row(label, ("\n" if any(each.note for each in items) else ", ").join(map(str, items)))
    # Names may have brackets and colons, which Rich would read as styles and pictures.
    Console(markup=False, emoji=False).print(table, highlight=False)


_IN_TABLE = ("run", "final error", "max error", "rms error", "goal error", "comparisons")  # or in files


def print_summary(summary: Summary) -> None:
    """Print errors and invariants of a run.

    Args:
        summary: summary of the run, as ``summarize`` makes it.
    """
    console, found = Console(markup=False, emoji=False), cast(PrintedSummary, summary)
    word = summary.get("verdict", summary["outcome"])
    console.print(f"{summary['scenario']}: {word}", style="bold", highlight=False)
    errors = Table("output")
    for column in ("final error", "largest error", "rms error"):
        errors.add_column(column, justify="right")
    figures = {name: each for name, each in summary.get("goal_error", {}).items() if name not in summary["final_error"]}
    for name, last in {**summary["final_error"], **figures}.items():
        # A goal of the planner that is no output: it has an end and no history.
        history = (
            f"{each[name]:.2e}" if name in each else "-" for each in (summary["max_error"], summary["rms_error"])
        )
        unit = found.units.get(name)
        errors.add_row(f"{name} [{unit}]" if unit else name, f"{last:.2e}", *history)
    # Outputs without a reference have no errors.
    if errors.row_count:
        console.print(errors)
    for finding in summary.get("findings", ()):
        how = weight_of(str(finding["kind"]), str(finding["severity"]), summary.get("accepted", ()))
        # In one line, however narrow the terminal: scripts look for it.
        console.print(f"{how}: {finding['message']}", highlight=False, soft_wrap=True)
    if "late" in summary:
        console.print(f"note: {summary['late']['message']}", highlight=False, soft_wrap=True)
    others = Table(show_header=False, box=None, pad_edge=False)
    others.add_column(no_wrap=True)
    others.add_column(overflow="fold")
    for label, items in found.summary_lines():
        if label not in _IN_TABLE:
            others.add_row(label, ", ".join(map(str, items)))
    console.print(others)


def report_findings(verdict: Verdict, ending: str, others: str = "", told: Collection[str] = ()) -> int:
    """Print what degrades a run as warnings, and its first failure as an error. Return the exit status.

    Args:
        verdict: verdict of the run.
        ending: end of the error, such as where the results are.
        others: where the other failures are.
        told: warnings that were printed before.
    """
    for finding in verdict.findings:
        if finding.severity is not Severity.NOTE and finding not in verdict.failures and str(finding) not in told:
            messages.warn(str(finding))
    if not verdict.failures:
        return messages.DONE
    more = len(verdict.failures) - 1
    # Last, behind the warnings: this line says why the status is 1.
    messages.complain(f"{verdict.failures[0]}{f', and {more} more{others}' if more else ''}; {ending}")
    return messages.FAILED


def run_and_report(
    scenario: Scenario, out: Path | None, ending: str, force: bool, as_json: bool, simulated: Callable[[], Result]
) -> int:
    """Simulate a run into its folder. Print its summary, files, time and findings, and return the exit status.

    Args:
        scenario: scenario of the run, with all that is built.
        out: folder of the results; ``runs/SCENARIO`` with the ending if it is None.
        ending: end of the folder's usual name.
        force: True to write into a folder that rnc-pin did not create.
        as_json: print the summary as JSON, and nothing else, because a program reads it.
        simulated: function that simulates the run.
    """
    told = scenario.experiment.warnings
    for warning in told:
        messages.warn(warning)
    name = scenario.name.strip(".") or "scenario"  # a file "...yaml" must not write into ".."
    folder = out or Path("runs") / f"{name}{ending}"
    # The folder replaces files of these names, and no others.
    with uninterrupted(), OutputFolder(folder, force, result_names(scenario)) as target:
        result = simulated()
        try:
            drawn = _kept(scenario, result, target, as_json)
        except RncError as error:  # the scenario is valid, but its results cannot be written
            messages.complain(str(error))
            return messages.FAILED
    if drawn.failures:
        messages.warn(str(drawn))
    if as_json:
        messages.print_json({**result.summary, "elapsed_time": round(messages.seconds_since_start(), 3)})
    else:
        console, spent = Console(markup=False, emoji=False), result.summary["wall_time"]
        console.print(f"in {folder}: {', '.join(result.summary['files'])}", highlight=False, soft_wrap=True)
        part = f", {spent:.1f} s of it for the simulation" if spent else ""
        console.print(f"done in {messages.seconds_since_start():.1f} s{part}", highlight=False)
    where = f"results so far are in {folder}"
    status = report_findings(result.trajectory.verdict, where, " in summary.json", told)
    # Behind the verdict: a failure says more than that its pictures are missing.
    if status == messages.DONE and (result.interrupted or drawn.interrupted):
        messages.complain(f"interrupted; {where}")
        return messages.FAILED
    return status


def _kept(scenario: Scenario, result: Result, target: OutputFolder, as_json: bool) -> Drawn:
    """Write a run, print its summary, and draw its pictures last."""
    with target.writing() as fresh:
        files = write(scenario, result, fresh)
    # From here on the numbers are safe, whatever happens to the pictures.
    target.keep_so_far()
    if not as_json:
        print_summary(result.summary)
    names = picture_names(scenario)
    text = f"{scenario.name}: drawing {len(names)} pictures"
    # Pictures come last: results are in place even if drawing is interrupted.
    with target.writing() as fresh, progress_bar(len(names), text, as_json) as bar:
        drawn = draw_pictures(scenario, result, fresh, bar)
    target.keep()
    result.summary["files"] = [*files, *drawn.written]
    return drawn
