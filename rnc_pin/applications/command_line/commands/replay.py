"""``rnc-pin replay`` and ``rnc-pin export``, and the live view of the option ``--show``."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TypedDict, Unpack

import click

from rnc_pin.applications.command_line.messages import DONE, warn
from rnc_pin.applications.command_line.report import print_summary, report_findings
from rnc_pin.applications.scenario.output_folder import check_new_file, one_line_errors
from rnc_pin.applications.scenario.saved_run import Run, animation_of, load_run
from rnc_pin.interruption import interruptible
from rnc_pin.simulation import Grounds, Provenance, RunInfo, Trajectory, add_verdict, export_run, summarize
from rnc_pin.visualization import DrawnModel, LiveView, Recording, View, recorded_states, write_video
from rnc_pin.visualization.browser import is_loopback


@contextmanager
def live_view(
    model: DrawnModel, view: View, info: RunInfo | Provenance, title: str, speed: float, browser: bool, host: str
) -> Iterator[LiveView]:
    """Serve a live view, print its address, and wait for the browser; warn if it stopped before the run."""
    if not is_loopback(host):
        warn(f"--host {host}: everyone who can reach this address can watch")
    live = LiveView(model, view, info, speed, browser, host, title)
    click.echo(f"showing on {live.url}", err=True)
    try:
        with interruptible():
            live.wait_for_browser(10.0)
        yield live
    finally:
        live.close()
        if live.problem is not None:
            warn(f"the live view stopped: {type(live.problem).__name__}: {live.problem}")


class ReplayFiles(TypedDict):
    """Files that a replay writes."""

    html: Path | None
    video: Path | None
    rate: float
    force: bool


def replay_runs(
    sources: tuple[Path, ...], show: bool, speed: float, browser: bool, host: str, **files: Unpack[ReplayFiles]
) -> int:
    """Write the requested files of runs, show them, or print their summaries and verdicts. Return the exit status."""
    runs = [load_run(source) for source in sources]
    for option, path in (("--html", files["html"]), ("--video", files["video"])):
        if path is not None:
            check_new_file(option, path, files["force"])
    if files["html"] or files["video"]:
        _write(animation_of(runs), files)
    if show:
        _show(runs[0], speed, browser, host)
    if show or files["html"] or files["video"]:
        return DONE
    return max([_judged(run) for run in runs])


def _write(recording: Recording, files: ReplayFiles) -> None:
    html, video, force = files["html"], files["video"], files["force"]
    with one_line_errors():
        if html is not None:
            recording.save(html, force)
            click.echo(f"wrote {html} ({html.stat().st_size / 1e6:.1f} MB)")
        if video is not None:
            write_video(recording, video, files["rate"], replace=force)
            click.echo(f"wrote {video} ({video.stat().st_size / 1e6:.1f} MB)")


def _judged(run: Run) -> int:
    """Print the summary and the verdict of a run, and return the exit status."""
    # A run that has no verdict is judged without the goals and obstacles of its scenario.
    verdict = replace(run.trajectory, grounds=Grounds(run.reduced)).verdict
    summary = summarize(run.trajectory)
    add_verdict(summary, verdict)
    print_summary(summary, run.trajectory.info.outputs)
    return report_findings(verdict, f"the run is in {run.source}")


def _show(run: Run, speed: float, browser: bool, host: str) -> None:
    shown = run.drawn_model, run.scenario.view, run.trajectory.info, run.title
    with live_view(*shown, speed, browser, host) as live, suppress(KeyboardInterrupt):
        for state in recorded_states(run.reduced.robot, run.trajectory, rate=60.0):
            live(state)


def export_file(source: Path, file: Path, arrays: tuple[str, ...], force: bool) -> None:
    """Write the arrays of a run for other programs."""
    check_new_file("FILE", file, force)
    run = Trajectory.load(source / "trajectory.npz" if os.path.isdir(source) else source)
    with one_line_errors():
        written = export_run(run, file, arrays or None, force)
    click.echo(f"wrote {written}")
