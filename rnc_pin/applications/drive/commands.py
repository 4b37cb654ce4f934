"""Commands of a user to a driven run, and the log of them with the sample at which each takes effect.

Commands come from a web page, so each number and name is checked.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from rnc_pin.applications.drive.controls import FAR, DriveControls
from rnc_pin.errors import ConfigurationError, InputError, RncError, nearest, short_text
from rnc_pin.io import Json, Strict, dump_json, read_bytes, validated

if TYPE_CHECKING:
    Content = Mapping[str, Json]
else:
    Content = Mapping  # pydantic resolves no recursive alias
_Name = Annotated[str, Field(max_length=200)]
_Number = Annotated[float, Field(strict=True)]
_Coordinate = Annotated[float, Field(strict=True, ge=-FAR, le=FAR)]
_Share = Annotated[float, Field(strict=True, ge=-1.0, le=1.0)]
_Point: TypeAlias = tuple[_Coordinate, _Coordinate, _Coordinate]
_Quaternion: TypeAlias = tuple[_Share, _Share, _Share, _Share]


class DriveCommand(Strict):
    """Command of a user. Each kind is a class of its own."""

    kind: ClassVar[str]
    """Name of the kind in messages and files."""


class FrameGoal(DriveCommand):
    """Goal of a frame: position [m] and, if given, orientation as a quaternion (x, y, z, w), in the world."""

    kind = "frame_goal"
    frame: _Name
    position: _Point
    orientation: _Quaternion | None = None


class ReleaseFrame(DriveCommand):
    """End of the goal of a frame."""

    kind = "release_frame"
    frame: _Name


class JointGoal(DriveCommand):
    """Posture of a joint [rad or m]."""

    kind = "joint_goal"
    joint: _Name
    position: _Number


class BaseVelocity(DriveCommand):
    """Velocity of the base as shares of its speeds, -1 to 1. It ends after 0.5 s without another one."""

    kind = "base_velocity"
    forward: _Share
    turn: _Share
    left: _Share = 0.0


class BaseGoal(DriveCommand):
    """Point on the ground to which the base drives [m]."""

    kind = "base_goal"
    x: _Coordinate
    y: _Coordinate


class HoldBase(DriveCommand):
    """True if the base does not move for the goals of frames."""

    kind = "hold_base"
    on: Annotated[bool, Field(strict=True)]


class ObstacleGoal(DriveCommand):
    """Point to which an obstacle moves [m]."""

    kind = "obstacle_goal"
    obstacle: _Name
    position: _Point


class GainSetting(DriveCommand):
    """Value of a gain or a speed."""

    kind = "gain"
    gain: _Name
    value: _Number


class StopMotion(DriveCommand):
    """End of all goals: the robot holds the configuration that it has."""

    kind = "stop"


class EndRun(DriveCommand):
    """End of the run."""

    kind = "end"


KINDS = {each.kind: each for each in DriveCommand.__subclasses__()}
"""Class of each kind of command, by its name."""


def parse_command(message: object, controls: DriveControls) -> DriveCommand:
    """Return the command of a message, such as ``{"kind": "base_goal", "x": 1.0, "y": 0.0}``.

    Raises:
        RncError: unknown kind, name or key; or a number that is missing, not finite or out of its range.
    """
    kind = message.get("kind") if isinstance(message, Mapping) else None
    if not isinstance(message, Mapping) or not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"no command {short_text(kind)}{nearest(kind[:30] if isinstance(kind, str) else '', KINDS)}")
    command = validated(KINDS[kind], {key: each for key, each in message.items() if key != "kind"}, kind)
    _check_names(command, controls)
    return command


def command_entry(command: DriveCommand) -> dict[str, Json]:
    """Return a command as a mapping that ``parse_command`` reads."""
    return {"kind": command.kind, **command.model_dump(mode="json", exclude_none=True)}


def command_target(command: DriveCommand) -> tuple[str, str]:
    """Kind and name of what a command sets: a later command with the same target replaces it."""
    named = [value for _, value in command if isinstance(value, str)]
    return command.kind, named[0] if named else ""


def _check_names(command: DriveCommand, controls: DriveControls) -> None:
    """Check the names of a command, and the ranges of what they name.

    Raises:
        InputError: the robot has no such frame, joint, base, obstacle or gain; or a number is out of its range.
    """
    match command:
        case FrameGoal(frame=frame, orientation=orientation):
            _known("frame", frame, controls.frames)
            if orientation is not None and not 0.5 < float(np.linalg.norm(orientation)) < 2.0:
                raise InputError("orientation: expected a unit quaternion (x, y, z, w)")
        case ReleaseFrame(frame=frame):
            _known("frame", frame, controls.frames)
        case JointGoal(joint=joint, position=position):
            _known("joint", joint, controls.joints)
            controls.joints[joint].check(f"joint '{joint}'", position)
        case GainSetting(gain=gain, value=value):
            _known("gain", gain, controls.gains)
            controls.gains[gain].check(f"'{gain}'", value)
        case ObstacleGoal(obstacle=obstacle):
            _known("obstacle", obstacle, controls.obstacles)
        case BaseVelocity() | BaseGoal() | HoldBase():
            if controls.base is None:
                raise InputError("the robot has no base to drive")


def _known(what: str, name: str, valid: Mapping[str, object]) -> None:
    if name not in valid:
        raise InputError(f"no {what} '{name}' to drive{nearest(name, valid)}")


_MOST = 5_000_000  # samples or commands of a log


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


class RecordedDrive(Strict):
    """Content of ``commands.json``: everything that a driven run depends on."""

    format: Literal["rnc_pin commands 1"] = "rnc_pin commands 1"
    scenario: str
    """Name of the scenario."""
    folder: str | None
    """Base of relative paths; None for a scenario of the package."""
    frames: list[str]
    """Frames that could have a goal."""
    samples: Annotated[int, Field(strict=True, ge=2, le=_MOST)]
    """Number of samples."""
    versions: dict[str, str]
    """Versions of the software, and the kernel."""
    config: Content
    """Mapping of the scenario of the run."""
    commands: Annotated[list[Content], Field(max_length=_MOST)]
    """Entries of the commands, with their sample."""

    def log(self, controls: DriveControls) -> CommandLog:
        """Return the commands after a check of each.

        Raises:
            ConfigurationError: a command is invalid.
        """
        found: list[LoggedCommand] = []
        for number, entry in enumerate(self.commands):
            sample, last = entry.get("sample"), found[-1].sample if found else 0
            if isinstance(sample, bool) or not isinstance(sample, int) or sample < last:
                raise ConfigurationError(f"commands[{number}]: expected a sample of at least {last}")
            message = {key: value for key, value in entry.items() if key not in ("sample", "time")}
            try:
                found.append(LoggedCommand(sample, parse_command(message, controls)))
            except RncError as error:
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
    path.write_text(dump_json(record.model_dump()) + "\n", encoding="utf-8")


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
    return validated(RecordedDrive, content, str(path))


def ends(commands: Iterable[DriveCommand]) -> bool:
    """True if a command ends the run."""
    return any(isinstance(each, EndRun) for each in commands)
