"""``rnc-pin run``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Unpack

from rnc_pin.applications.command_line.messages import announce, told_each_minute
from rnc_pin.applications.command_line.report import Watching, progress_bar, run_and_report
from rnc_pin.applications.scenario.execution import Result, execute
from rnc_pin.applications.scenario.files import parse_options
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.simulation import Observer, RunInfo


def run_scenario(
    scenario: str,
    out: Path | None,
    options: tuple[str, ...],
    show: bool,
    as_json: bool,
    force: bool,
    **watching: Unpack[Watching],
) -> int:
    """Run a scenario, write its folder and return the exit status.

    Args:
        scenario: a built-in name or a file.
        out: folder of the results; ``runs/SCENARIO`` if it is None.
        options: options in the form ``a.b=c``.
        show: True for a live view.
        as_json: True to print JSON.
        force: True to write into a folder that rnc-pin did not create.
        **watching: options of the live view.
    """
    prepared = Scenario.load(scenario, parse_options(options))
    plans = prepared.content.planner is not None  # which takes most of the time before the run
    activity = f"{prepared.name}: {'planning the motion' if plans else 'preparing the run'}"
    # A plan has no steps to show on a bar.
    if plans:
        announce(activity, as_json)
    # Models with meshes and plans take minutes, for which a log would be silent.
    with told_each_minute(lambda: activity, as_json):
        prepared = prepared.build()
    simulated = partial(_watched, prepared, watching, as_json) if show else partial(_executed, prepared, None, as_json)
    return run_and_report(prepared, out, "", force, as_json, simulated)


def _watched(prepared: Scenario, watching: Watching, quiet: bool) -> Result:
    """Execute the run with a live view."""
    from rnc_pin.applications.command_line.replay import live_view  # Meshcat takes a second to import

    drawn, view = prepared.experiment.drawn_model, prepared.content.view
    info = RunInfo(drawn.outputs, provenance=prepared.experiment.provenance)
    with live_view(drawn, view, info, prepared.title, **watching) as live:
        return _executed(prepared, live, quiet)


def _executed(prepared: Scenario, live: Observer | None, quiet: bool) -> Result:
    """Execute the run with a progress bar."""
    count = len(prepared.comparisons)
    others = f" and {count} comparison{'s'[: count != 1]}" if count else ""
    text = f"{prepared.name}: simulating {prepared.duration:g} s{others}"
    with progress_bar(prepared.total_duration, text, quiet) as advance:
        return execute(prepared, live, advance)
