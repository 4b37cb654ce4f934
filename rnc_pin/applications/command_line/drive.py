"""``rnc-pin drive``."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TypedDict, Unpack

import click

from rnc_pin.applications.command_line.messages import warn
from rnc_pin.applications.command_line.report import run_and_report
from rnc_pin.applications.drive.page import DrivePage
from rnc_pin.applications.drive.preparation import PreparedDrive, prepare_drive, read_source
from rnc_pin.applications.drive.run import CommandQueue, RealTimeClock, drive
from rnc_pin.applications.init import DraftOptions
from rnc_pin.applications.scenario.execution import Result
from rnc_pin.applications.scenario.files import parse_options
from rnc_pin.interruption import interruptible


class NewDrive(TypedDict):
    """Options of a drive."""

    options: tuple[str, ...]
    frames: tuple[str, ...]
    arguments: tuple[str, ...]
    package_dirs: tuple[Path, ...]
    duration: float | None


def drive_robot(
    source: str, out: Path | None, browser: bool, as_json: bool, force: bool, **new: Unpack[NewDrive]
) -> int:
    """Drive a robot in the browser, write its folder, and return the exit status.

    Args:
        source: a scenario or a robot.
        out: folder of the results; ``runs/SCENARIO-drive`` if it is None.
        browser: True to open the browser.
        as_json: True to print JSON.
        force: True to write into a folder that rnc-pin did not create.
        **new: options of the drive.
    """
    given = parse_options(new["options"])
    wishes = DraftOptions(xacro_arguments=parse_options(new["arguments"]), package_dirs=new["package_dirs"])
    prepared = prepare_drive(read_source(source, given, wishes), given, new["frames"])
    simulated = partial(_driven, prepared, new["duration"], browser)
    return run_and_report(prepared.scenario, out, "-drive", force, as_json, simulated)


def _driven(prepared: PreparedDrive, duration: float | None, browser: bool) -> Result:
    """Serve the page and run in real time."""
    settings, queue = prepared.scenario.experiment.simulation, CommandQueue(prepared.controls)
    # Two at least: fewer samples cannot be replayed.
    samples = None if duration is None else max(2, round(duration / settings.dt) + 1)
    wait = 15.0  # [s] for a browser before the run starts
    with ExitStack() as stack:
        page = DrivePage(prepared, queue, prepared.scenario.title, browser)
        stack.callback(page.close)
        click.echo(f"drive on {page.url} (Ctrl-C or 'End run' ends it)", err=True)
        if browser:
            with interruptible():
                page.wait_for_browser(wait)
        # The clock starts with the first sample, so that waiting for the browser is not made up for.
        result = drive(prepared, queue, samples, RealTimeClock(), page.show)
        page.conclude(result.trajectory.verdict)
    # The run does not need its page: the record is whole.
    if page.problem is not None:
        warn(f"the page stopped: {type(page.problem).__name__}: {page.problem}")
    return result
