"""``rnc-pin replay`` and ``rnc-pin export`` of finished runs, and the live view of the option ``--show``."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

import click

from rnc_pin.applications.command_line.messages import DONE, warn
from rnc_pin.applications.command_line.report import Watching, print_summary, report_findings
from rnc_pin.applications.scenario.files import built_in_names, find_scenario
from rnc_pin.applications.scenario.output_folder import check_new_file, one_line_errors
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import ConfigurationError
from rnc_pin.interruption import interruptible
from rnc_pin.simulation import Grounds, Provenance, RunInfo, Trajectory, add_verdict, export_run, summarize
from rnc_pin.visualization import DrawnModel, LiveView, Recording, View, recorded_states, write_video
from rnc_pin.visualization.browser import is_loopback


@dataclass(frozen=True)
class Run:
    """Finished run with its scenario."""

    source: Path
    trajectory: Trajectory
    scenario: Scenario


def load_run(source: Path) -> Run:
    """Load a folder of ``rnc-pin run``, or its ``trajectory.npz``.

    Args:
        source: path of the folder or file.

    Raises:
        RncError: the source is not a run, or has fewer than two samples.
    """
    trajectory = Trajectory.load(source / "trajectory.npz" if os.path.isdir(source) else source)
    origin = trajectory.info.provenance
    if origin.config is None:
        raise ConfigurationError(f"{source}: contains no scenario, so the robot is unknown")
    scenario = Scenario(str(origin.scenario), dict(origin.config), _folder(origin), source=str(source))
    # The file of the robot may have changed since the run.
    if trajectory.q.shape[1] != scenario.robot.nq:
        raise ConfigurationError(
            f"{source}: configurations have {trajectory.q.shape[1]} entries, but its robot has nq = {scenario.robot.nq}"
        )
    if len(trajectory.time) < 2:
        raise ConfigurationError(f"{source}: contains {len(trajectory.time)} samples, at least 2 are required")
    return Run(source, trajectory, scenario)


def _folder(origin: Provenance) -> Path:
    """Base folder of relative paths in a run's scenario. Runs of built-in scenarios do not record a folder."""
    if origin.folder is not None:
        return Path(origin.folder)
    return find_scenario(origin.scenario).parent if origin.scenario in built_in_names() else Path()


def _compared(runs: Sequence[Run]) -> dict[str, Trajectory]:
    """Return the runs after the first, by unique names from those of their files.

    Raises:
        ConfigurationError: the runs have different robots.
    """
    first, paths = runs[0], [each.source for each in runs]
    names = [each.stem.removeprefix("trajectory_") if each.is_file() else each.name for each in paths]
    found: dict[str, Trajectory] = {}
    for name, other in zip(names[1:], runs[1:], strict=True):
        one, robot = first.scenario.robot, other.scenario.robot
        if (robot.nq, robot.name) != (one.nq, one.name):
            raise ConfigurationError(
                f"{other.source}: is of robot '{robot.name}', {first.source} of '{one.name}': one scene shows one robot"
            )
        # Folders of one name are told apart by their paths.
        shown = name if names.count(name) == 1 else str(other.source)
        found[shown.replace("_", " ")] = other.trajectory
    return found


@contextmanager
def live_view(
    model: DrawnModel, view: View, info: RunInfo, title: str, speed: float, browser: bool, host: str
) -> Iterator[LiveView]:
    """Serve a live view, print its address, and wait for the browser; warn if it stopped before the run.

    Args:
        model: robot, model and obstacles to draw.
        view: options of the view.
        info: names and provenance of the run.
        title: title of the page.
        speed: simulated time over real time; 0 does not wait.
        browser: True to open the browser.
        host: address to serve on.
    """
    # A page shows the robot and its goals to everyone who finds the port.
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


def replay_runs(
    sources: tuple[Path, ...],
    show: bool,
    html: Path | None,
    video: Path | None,
    rate: float,
    force: bool,
    **watching: Unpack[Watching],
) -> int:
    """Write the requested files of runs, show them, or print their summaries and verdicts. Return the exit status.

    Args:
        sources: folders or files of runs; the others are compared with the first.
        show: True to show the first run in the browser.
        html: page to write.
        video: video to write.
        rate: frames per second of the video.
        force: True to replace existing files.
        **watching: options of the live view.
    """
    runs = [load_run(source) for source in sources]
    # Before anything is written: a refusal of the second file leaves none behind.
    for option, path in (("--html", html), ("--video", video)):
        if path is not None:
            check_new_file(option, path, force)
    if not (show or html or video):
        # The worst status: 1 if any of the runs failed.
        return max([_judged(each) for each in runs])
    run, made = runs[0].trajectory, runs[0].scenario
    drawn = DrawnModel(made.robot, made.reduced, made.obstacles, made.content.contact_constraints)
    if html or video:
        # Other runs are pale robots in the scene of the first.
        recording = Recording(drawn, run, made.content.view, made.title, _compared(runs))
        with one_line_errors():
            if html is not None:
                recording.save(html, force)
                click.echo(f"wrote {html} ({html.stat().st_size / 1e6:.1f} MB)")
            if video is not None:
                write_video(recording, video, rate, replace=force)
                click.echo(f"wrote {video} ({video.stat().st_size / 1e6:.1f} MB)")
    if show:
        shown = drawn, made.content.view, run.info, made.title
        # Ctrl-C ends the show, and is no failure of the run.
        with live_view(*shown, **watching) as live, suppress(KeyboardInterrupt):
            # As often as a screen draws.
            for state in recorded_states(made.robot, run, rate=60.0):
                live(state)
    return DONE


def _judged(run: Run) -> int:
    """Print the summary and the verdict of a run, and return the exit status."""
    # A run that has no verdict is judged without the goals and obstacles of its scenario.
    judged = replace(run.trajectory, grounds=Grounds(run.scenario.reduced))
    verdict, summary = judged.verdict, summarize(judged)
    add_verdict(summary, verdict)
    print_summary(summary)
    return report_findings(verdict, f"the run is in {run.source}")


def export_file(source: Path, file: Path, arrays: tuple[str, ...], force: bool) -> None:
    """Write the arrays of a run for other programs.

    Args:
        source: folder or file of a run.
        file: table to write.
        arrays: names of arrays; all by default.
        force: True to replace an existing file.
    """
    check_new_file("FILE", file, force)
    run = Trajectory.load(source / "trajectory.npz" if os.path.isdir(source) else source)
    with one_line_errors():
        written = export_run(run, file, arrays or None, force)
    click.echo(f"wrote {written}")
