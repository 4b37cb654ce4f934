"""Log of a user's commands, with the sample at which each takes effect; and the queue through which they come."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from rnc_pin.applications.drive.commands import DriveCommand, EndRun, command_entry, command_target, parse_command
from rnc_pin.applications.drive.controls import DriveControls
from rnc_pin.errors import ConfigurationError, InputError, printable
from rnc_pin.io import Json, dump_json, read_bytes

FORMAT = "rnc_pin commands 1"
_MOST = 5_000_000  # commands of a log
_WAITING = 200  # targets that one sample can set


class LoggedCommand(NamedTuple):
    """Command with the sample at which it takes effect."""

    sample: int
    command: DriveCommand


class CommandLog:
    """Commands in the order of their samples."""

    def __init__(self, commands: Iterable[LoggedCommand] = ()) -> None:
        self.commands: list[LoggedCommand] = list(commands)

    def add(self, sample: int, commands: Iterable[DriveCommand]) -> None:
        """Add the commands of a sample."""
        self.commands += [LoggedCommand(sample, command) for command in commands]

    def due(self, applied: int, sample: int) -> list[DriveCommand]:
        """Return the commands after the first ``applied`` ones whose sample has come."""
        found = []
        while applied < len(self.commands) and self.commands[applied].sample <= sample:
            found.append(self.commands[applied].command)
            applied += 1
        return found


class CommandQueue:
    """Queue from the threads of a page to the loop. A later command replaces an earlier one with the same target.

    So neither a fast nor a hostile page can fill the memory or delay a sample.

    Args:
        controls: what a user may set.

    Attributes:
        refused: last message that was refused, with the reason; empty if there is none.
    """

    def __init__(self, controls: DriveControls) -> None:
        self._controls, self._lock = controls, threading.Lock()
        self._waiting: dict[tuple[str, str], DriveCommand] = {}
        self.refused = ""

    def put(self, message: object) -> bool:
        """Check a message and put its command into the queue. Return False if it is refused."""
        try:
            command = parse_command(message, self._controls)
        except InputError as error:
            self.refused = printable(str(error))
            return False
        target = command_target(command)
        with self._lock:
            if target not in self._waiting and len(self._waiting) >= _WAITING:
                self.refused = "too many commands in one sample"
                return False
            self._waiting.pop(target, None)
            self._waiting[target] = command
        self.refused = ""
        return True

    def take(self) -> list[DriveCommand]:
        """Return the commands that wait, in order, and empty the queue."""
        with self._lock:
            found = list(self._waiting.values())
            self._waiting.clear()
        return found


@dataclass(frozen=True)
class RecordedDrive:
    """Content of ``commands.json``: everything that a driven run depends on.

    Attributes:
        scenario: name of the scenario.
        folder: base of relative paths; None for a scenario of the package.
        frames: frames that could have a goal.
        samples: number of samples.
        versions: versions of the software, and the kernel.
        config: mapping of the scenario of the run.
        commands: entries of the commands, with their sample.
    """

    scenario: str
    folder: str | None
    frames: list[str]
    samples: int
    versions: dict[str, str]
    config: dict[str, Json]
    commands: list[Mapping[str, Json]]

    def log(self, controls: DriveControls) -> CommandLog:
        """Return the commands after a check of each.

        Raises:
            ConfigurationError: a command is invalid.
        """
        found: list[LoggedCommand] = []
        for number, entry in enumerate(self.commands):
            sample = entry.get("sample") if isinstance(entry, Mapping) else None
            last = found[-1].sample if found else 0
            if isinstance(sample, bool) or not isinstance(sample, int) or sample < last:
                raise ConfigurationError(f"commands[{number}]: expected a sample of at least {last}")
            message = {key: value for key, value in entry.items() if key not in ("sample", "time")}
            try:
                found.append(LoggedCommand(sample, parse_command(message, controls)))
            except InputError as error:
                raise ConfigurationError(f"commands[{number}]: {error}") from None
        return CommandLog(found)


def log_entries(log: CommandLog, dt: float) -> list[Mapping[str, Json]]:
    """Return the entries of a log for ``commands.json``; ``time`` is for readers only."""
    return [
        {"sample": each.sample, "time": round(each.sample * dt, 9), **command_entry(each.command)}
        for each in log.commands
    ]


def write_drive(record: RecordedDrive, path: Path) -> None:
    """Write ``commands.json``. Numbers keep all digits, so that a replay gives the same bits."""
    path.write_text(dump_json({"format": FORMAT, **vars(record)}) + "\n", encoding="utf-8")


def read_drive(path: Path) -> RecordedDrive:
    """Read ``commands.json``. The commands are checked later, when the robot is known.

    Raises:
        ConfigurationError: the file cannot be read, or is not such a record.
    """
    try:
        content = json.loads(read_bytes(path).decode())
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError):
        raise ConfigurationError(f"{path}: not JSON, expected the commands.json of 'rnc-pin drive'") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ConfigurationError(f"{path}: expected the commands.json of 'rnc-pin drive', with format '{FORMAT}'")
    kinds: dict[str, type | tuple[type, ...]] = {
        "scenario": str, "config": dict, "folder": (str, type(None)), "frames": list, "samples": int,
        "versions": dict, "commands": list,
    }  # fmt: skip
    for key, kind in kinds.items():
        if key not in content or not isinstance(content[key], kind) or isinstance(content[key], bool):
            raise ConfigurationError(f"{path}: '{key}' is missing or has the wrong type")
    if not all(isinstance(each, str) for each in content["frames"]):
        raise ConfigurationError(f"{path}: 'frames' has to be a list of names")
    if not 2 <= content["samples"] <= _MOST or len(content["commands"]) > _MOST:
        raise ConfigurationError(f"{path}: expected 2 to {_MOST:,} samples")
    return RecordedDrive(**{key: content[key] for key in kinds})


def ends(commands: Iterable[DriveCommand]) -> bool:
    """True if a command ends the run."""
    return any(isinstance(each, EndRun) for each in commands)
