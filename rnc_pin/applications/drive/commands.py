"""Commands of a user to a driven run, and the log of them with the sample at which each takes effect.

Commands come from a web page, so each number and name is checked.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from types import NoneType
from typing import Any, ClassVar, NamedTuple, TypeAlias, get_args, get_type_hints

import numpy as np

from rnc_pin.applications.drive.controls import FAR, DriveControls
from rnc_pin.errors import ConfigurationError, InputError, nearest, short_text
from rnc_pin.io import Json, dump_json, read_bytes
from rnc_pin.model import is_number

_Point: TypeAlias = tuple[float, float, float]
_Quaternion: TypeAlias = tuple[float, float, float, float]


@dataclass(frozen=True)
class DriveCommand:
    """Command of a user. Each kind is a class of its own."""

    kind: ClassVar[str]
    """Name of the kind in messages and files."""


@dataclass(frozen=True)
class FrameGoal(DriveCommand):
    """Goal of a frame: position [m] and, if given, orientation as a quaternion (x, y, z, w), in the world."""

    kind: ClassVar[str] = "frame_goal"
    frame: str
    position: _Point
    orientation: _Quaternion | None = None


@dataclass(frozen=True)
class ReleaseFrame(DriveCommand):
    """End of the goal of a frame."""

    kind: ClassVar[str] = "release_frame"
    frame: str


@dataclass(frozen=True)
class JointGoal(DriveCommand):
    """Posture of a joint [rad or m]."""

    kind: ClassVar[str] = "joint_goal"
    joint: str
    position: float


@dataclass(frozen=True)
class BaseVelocity(DriveCommand):
    """Velocity of the base as shares of its speeds, -1 to 1. It ends after 0.5 s without another one."""

    kind: ClassVar[str] = "base_velocity"
    forward: float
    turn: float
    left: float = 0.0


@dataclass(frozen=True)
class BaseGoal(DriveCommand):
    """Point on the ground to which the base drives [m], and its heading there [rad]; None for any heading."""

    kind: ClassVar[str] = "base_goal"
    x: float
    y: float
    heading: float | None = None


@dataclass(frozen=True)
class HoldBase(DriveCommand):
    """True if the base does not move for the goals of frames."""

    kind: ClassVar[str] = "hold_base"
    on: bool


@dataclass(frozen=True)
class ObstacleGoal(DriveCommand):
    """Point to which an obstacle moves [m]."""

    kind: ClassVar[str] = "obstacle_goal"
    obstacle: str
    position: _Point


@dataclass(frozen=True)
class GainSetting(DriveCommand):
    """Value of a gain or a speed."""

    kind: ClassVar[str] = "gain"
    gain: str
    value: float


@dataclass(frozen=True)
class StopMotion(DriveCommand):
    """End of all goals: the robot holds the configuration that it has."""

    kind: ClassVar[str] = "stop"


@dataclass(frozen=True)
class EndRun(DriveCommand):
    """End of the run."""

    kind: ClassVar[str] = "end"


KINDS = {each.kind: each for each in DriveCommand.__subclasses__()}
"""Class of each kind of command, by its name."""
_LONGEST_NAME = 200  # characters
_MOST_TURN = 2.0 * np.pi  # [rad]


def parse_command(message: object, controls: DriveControls) -> DriveCommand:
    """Return the command of a message, such as ``{"kind": "base_goal", "x": 1.0, "y": 0.0}``.

    Raises:
        InputError: unknown kind, name or key; or a number that is missing, not finite or out of its range.
    """
    if not isinstance(message, Mapping):
        raise InputError(f"a command has to be a mapping, found {type(message).__name__}")
    kind = message.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"no command {str(kind)[:_LONGEST_NAME]!r}{nearest(str(kind)[:_LONGEST_NAME], KINDS)}")
    cls, types = KINDS[kind], get_type_hints(KINDS[kind])
    unknown = [key for key in message if key != "kind" and key not in types]
    if unknown:
        raise InputError(f"{kind}: no entry {str(unknown[0])[:_LONGEST_NAME]!r}{nearest(str(unknown[0]), types)}")
    given: dict[str, Any] = {}
    for each in fields(cls):
        if each.name in message:
            given[each.name] = _value(f"{kind}.{each.name}", types[each.name], message[each.name])
        elif each.default is MISSING:
            raise InputError(f"{kind}: '{each.name}' is missing")
    command = cls(**given)
    check_command(command, controls)
    return command


def command_entry(command: DriveCommand) -> dict[str, Json]:
    """Return a command as a mapping that ``parse_command`` reads."""
    values = {name: list(each) if isinstance(each, tuple) else each for name, each in vars(command).items()}
    return {"kind": command.kind, **{name: each for name, each in values.items() if each is not None}}


def command_target(command: DriveCommand) -> tuple[str, str]:
    """Kind and name of what a command sets: a later command with the same target replaces it."""
    named = [value for value in vars(command).values() if isinstance(value, str)]
    return command.kind, named[0] if named else ""


def _value(where: str, kind: object, value: object) -> object:
    """Return a value of a message in the type of its field; an optional type has None behind it."""
    kind, *others = get_args(kind) if NoneType in get_args(kind) else (kind,)
    if value is None and others:
        return None
    if kind is float:
        return _number(where, value)
    for simple, expected in ((str, "a name"), (bool, "true or false")):
        if kind is simple and not isinstance(value, simple):
            raise InputError(f"{where}: expected {expected}, found {type(value).__name__}")
    if isinstance(value, str) and kind is str:
        return value[: _LONGEST_NAME + 1]
    if kind is bool:
        return value
    size = len(get_args(kind))
    if not isinstance(value, list | tuple) or len(value) != size:
        raise InputError(f"{where}: expected {size} numbers")
    return tuple(_number(where, each) for each in value)


def _number(where: str, value: object) -> float:
    if not is_number(value):
        raise InputError(f"{where}: expected a finite number, found {short_text(value)}")
    return float(value)


def check_command(command: DriveCommand, controls: DriveControls) -> None:
    """Check names and ranges of a command.

    Raises:
        InputError: the robot has no such frame, joint, base, obstacle or gain; or a number is out of its range.
    """
    match command:
        case FrameGoal(frame, position, orientation):
            _known("frame", frame, controls.frames)
            _within_reach("position", position)
            if orientation is not None and not 0.5 < float(np.linalg.norm(orientation)) < 2.0:
                raise InputError("orientation: expected a unit quaternion (x, y, z, w)")
        case ReleaseFrame(frame):
            _known("frame", frame, controls.frames)
        case JointGoal(joint, position):
            _known("joint", joint, controls.joints)
            controls.joints[joint].check(f"joint '{joint}'", position)
        case GainSetting(gain, value):
            _known("gain", gain, controls.gains)
            controls.gains[gain].check(f"'{gain}'", value)
        case ObstacleGoal(obstacle, position):
            _known("obstacle", obstacle, controls.obstacles)
            _within_reach("position", position)
        case BaseVelocity(forward, turn, left):
            _needs_base(controls)
            for name, share in (("forward", forward), ("turn", turn), ("left", left)):
                if not -1.0 <= share <= 1.0:
                    raise InputError(f"{name}: expected a share of -1 to 1, found {share:g}")
        case BaseGoal(x, y, heading):
            _needs_base(controls)
            _within_reach("goal", (x, y))
            if heading is not None and abs(heading) > _MOST_TURN:
                raise InputError(f"heading: expected an angle of -2 pi to 2 pi rad, found {heading:g}")
        case HoldBase():
            _needs_base(controls)


def _known(what: str, name: str, valid: Mapping[str, object]) -> None:
    if name not in valid:
        raise InputError(f"no {what} '{name}' to drive{nearest(name, valid)}")


def _needs_base(controls: DriveControls) -> None:
    if controls.base is None:
        raise InputError("the robot has no base to drive")


def _within_reach(what: str, values: tuple[float, ...]) -> None:
    if max(map(abs, values)) > FAR:
        raise InputError(f"{what}: expected numbers within {FAR:g} m of the origin")


FORMAT = "rnc_pin commands 1"
_MOST = 5_000_000  # commands of a log


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
