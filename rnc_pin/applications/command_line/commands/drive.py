"""``rnc-pin drive``."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TypedDict, Unpack

import click

from rnc_pin.applications.command_line.messages import FAILED, announce, warn
from rnc_pin.applications.command_line.report import keep_run, report_run
from rnc_pin.applications.drive.commands import RecordedDrive, read_drive, write_drive
from rnc_pin.applications.drive.page import DrivePage
from rnc_pin.applications.drive.preparation import PreparedDrive, prepare_drive, read_source, rebuild_drive
from rnc_pin.applications.drive.run import CommandQueue, RealTimeClock, drive, record_of
from rnc_pin.applications.init import DraftOptions
from rnc_pin.applications.scenario.execution import Result, data_names
from rnc_pin.applications.scenario.files import find_scenario, parse_options
from rnc_pin.applications.scenario.output_folder import OutputFolder
from rnc_pin.applications.scenario.pictures import picture_names
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.interruption import interruptible, uninterrupted

_COMMANDS = "commands.json"
_WAIT = 15.0  # [s] for a browser before the run starts


class NewDrive(TypedDict):
    """Options of a new drive; a replayed one takes them from its file."""

    options: tuple[str, ...]
    frames: tuple[str, ...]
    arguments: tuple[str, ...]
    package_dirs: tuple[Path, ...]
    duration: float | None


def drive_robot(
    source: str | None,
    replayed: Path | None,
    out: Path | None,
    browser: bool,
    as_json: bool,
    force: bool,
    **new: Unpack[NewDrive],
) -> int:
    """Drive a robot in the browser, or replay the commands of a drive; write its folder and return the exit status."""
    if (source is None) == (replayed is None):
        raise ConfigurationError("expected a scenario or a robot, or --replay with a commands.json")
    record = None
    if replayed is not None:
        record = read_drive(replayed)
        _check_replay(new)
        prepared = _rebuilt(record, replayed)
    else:
        given = parse_options(new["options"])
        wishes = DraftOptions(xacro_arguments=parse_options(new["arguments"]), package_dirs=new["package_dirs"])
        prepared = prepare_drive(read_source(str(source), given, wishes), given, new["frames"])
    for warning in prepared.scenario.experiment.warnings:
        warn(warning)
    names = [*data_names(), _COMMANDS, *picture_names(prepared.scenario)]
    name = prepared.scenario.name.strip(".") or "scenario"
    path = out or Path("runs") / (f"{name}-drive" if record is None else f"{name}-drive-replay")

    def write_commands(folder: Path) -> str:
        write_drive(record_of(prepared, result), folder / _COMMANDS)
        return _COMMANDS

    with uninterrupted(), OutputFolder(path, force, names) as target:
        result = _replayed(prepared, record) if record is not None else _driven(prepared, new["duration"], browser)
        drawn = keep_run(prepared.scenario, result, target, as_json, more=write_commands)
    return FAILED if drawn is None else report_run(prepared.scenario, result, drawn, target.path, as_json)


def _driven(prepared: PreparedDrive, duration: float | None, browser: bool) -> Result:
    """Serve the page and run in real time."""
    settings, queue = prepared.scenario.experiment.simulation, CommandQueue(prepared.controls)
    samples = None if duration is None else max(2, round(duration / settings.dt) + 1)
    title = prepared.scenario.experiment.scenario.title or prepared.scenario.name
    with ExitStack() as stack:
        page = DrivePage(prepared, queue, title, browser)
        stack.callback(page.close)
        click.echo(f"drive on {page.url} (Ctrl-C or 'End run' ends it)", err=True)
        if browser:
            with interruptible():
                page.wait_for_browser(_WAIT)
        result = drive(prepared, queue, samples, RealTimeClock(), page)
        page.conclude(result.trajectory.verdict)
    if page.problem is not None:
        warn(f"the page stopped: {type(page.problem).__name__}: {page.problem}")
    return result


# ------------------------------------------------------------------ replay


def _check_replay(new: NewDrive) -> None:
    if any(value not in ((), None) for value in new.values()):
        raise ConfigurationError(
            "--replay: takes scenario, frames and duration from its file; remove the other options"
        )


def _rebuilt(record: RecordedDrive, path: Path) -> PreparedDrive:
    """Build the run of a record, with its commands."""
    folder = find_scenario(record.scenario).parent if record.folder is None else Path(record.folder)
    with RncError.at(path):
        prepared = rebuild_drive(record.scenario, record.config, folder, record.frames)
        prepared.log.commands[:] = record.log(prepared.controls).commands
    return prepared


def _replayed(prepared: PreparedDrive, record: RecordedDrive) -> Result:
    """Run the commands of a record without waiting; other versions may give other bits."""
    result = None
    announce(f"{record.scenario}: replaying {len(record.commands)} commands", quiet=True)
    result = drive(prepared, samples=record.samples)
    now = record_of(prepared, result).versions
    other = [name for name, version in record.versions.items() if now.get(name) != version]
    if other:
        warn(f"the drive ran with another version of {', '.join(other)}: its replay may differ in the last digits")
    return result
