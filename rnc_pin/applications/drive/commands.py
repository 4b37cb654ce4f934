"""Commands of a user to a driven run, their log, and the goals that they change: explicit state of the controller.

Commands come from a web page, so each number and name is checked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import takewhile
from typing import Annotated, ClassVar, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from rnc_pin.applications.drive.controls import FAR, GAINS, DriveControls
from rnc_pin.errors import InputError, nearest, place_of, short_text
from rnc_pin.io import Strict, validated

_Name = Annotated[str, Field(max_length=200)]
# Strict: JSON has texts and truth values beside numbers, which pydantic would convert.
_Number = Annotated[float, Field(strict=True)]
_Coordinate = Annotated[float, Field(strict=True, ge=-FAR, le=FAR)]
_Share = Annotated[float, Field(strict=True, ge=-1.0, le=1.0)]
_Point: TypeAlias = tuple[_Coordinate, _Coordinate, _Coordinate]
_Quaternion: TypeAlias = tuple[_Share, _Share, _Share, _Share]


class DriveCommand(Strict):
    """Command of a user. Each kind is a class of its own."""

    kind: ClassVar[str]
    """Name of the kind in messages."""


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
    # A page may send any JSON: the kind may be a list, or a text of megabytes.
    if not isinstance(message, Mapping) or not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"no command {short_text(kind)}{nearest(kind[:30] if isinstance(kind, str) else '', KINDS)}")
    command = validated(KINDS[kind], {key: each for key, each in message.items() if key != "kind"}, kind)
    _check_names(command, controls)
    return command


def command_target(command: DriveCommand) -> tuple[str, str]:
    """Kind and name of what a command sets: a later command with the same target replaces it."""
    # A command has at most one name: of a frame, a joint or a gain.
    named = [value for _, value in command if isinstance(value, str)]
    return command.kind, named[0] if named else ""


def _check_names(command: DriveCommand, controls: DriveControls) -> None:
    """Check the names of a command, and the ranges of what they name.

    Raises:
        InputError: the robot has no such frame, joint, base or gain; or a number is out of its range.
    """
    match command:
        case FrameGoal(frame=frame, orientation=orientation):
            place_of(frame, controls.frames, "no frame", InputError)
            # Wide: the controller normalizes it, and only a length near zero has no direction.
            if orientation is not None and not 0.5 < float(np.linalg.norm(orientation)) < 2.0:
                raise InputError("orientation: expected a unit quaternion (x, y, z, w)")
        case ReleaseFrame(frame=frame):
            place_of(frame, controls.frames, "no frame", InputError)
        case JointGoal(joint=joint, position=position):
            place_of(joint, controls.joints, "no joint", InputError)
            controls.joints[joint].check(f"joint '{joint}'", position)
        case GainSetting(gain=gain, value=value):
            place_of(gain, GAINS, "no gain", InputError)
            GAINS[gain].check(f"'{gain}'", value)
        case BaseVelocity() | BaseGoal() | HoldBase():
            if controls.base is None:
                raise InputError("the robot has no base to drive")


class LoggedCommand(NamedTuple):
    """Command with the sample at which it takes effect."""

    sample: int
    command: DriveCommand


def due_commands(log: Sequence[LoggedCommand], applied: int, sample: int) -> list[DriveCommand]:
    """Return the commands after the first ``applied`` ones whose sample has come.

    Args:
        log: commands in the order of their samples.
        applied: number of commands that took effect before.
        sample: the present sample.
    """
    return [each.command for each in takewhile(lambda each: each.sample <= sample, log[applied:])]


LASTING = 0.5
"""Time for which a velocity command of the base counts [s]: a page that is closed stops the robot."""


class DriveGoals(NamedTuple):
    """Goals at one sample, by the names of the controls."""

    frames: Mapping[str, FrameGoal]
    """Goals of the frames that have one: the last command for each."""
    posture: Mapping[str, float]
    """[rad or m]"""
    gains: Mapping[str, float]
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Shares of the base's speeds: forward, left, turn."""
    velocity_end: float = -1.0
    """Time at which the velocity command ends [s]."""
    base_goal: tuple[float, float] | None = None
    hold_base: bool = False

    def velocity_at(self, t: float) -> tuple[float, float, float] | None:
        """Velocity command of the base at a time [s]; None if it has ended."""
        return self.velocity if t < self.velocity_end else None


def initial_goals(controls: DriveControls) -> DriveGoals:
    """Goals before the first command: the initial posture."""
    posture = {name: each.start for name, each in controls.joints.items()}
    return DriveGoals({}, posture, {name: each.start for name, each in GAINS.items()})


def with_command(goals: DriveGoals, command: DriveCommand, t: float, posture: Mapping[str, float]) -> DriveGoals:
    """Return the goals after a command.

    Args:
        goals: goals before it.
        command: a checked command.
        t: time of its sample [s].
        posture: present positions of the joints of the posture.
    """
    match command:
        case FrameGoal(frame=frame):
            return goals._replace(frames={**goals.frames, frame: command})
        case ReleaseFrame(frame=frame):
            return goals._replace(frames={name: goal for name, goal in goals.frames.items() if name != frame})
        case JointGoal(joint=joint, position=position):
            return goals._replace(posture={**goals.posture, joint: position})
        case GainSetting(gain=gain, value=value):
            return goals._replace(gains={**goals.gains, gain: value})
        case BaseVelocity(forward=forward, turn=turn, left=left):
            # Shares of zero end it at once: the base need not wait for rest.
            end = t + LASTING if (forward, left, turn) != (0.0, 0.0, 0.0) else t
            # Keys and a goal of the base exclude each other: the later one counts.
            return goals._replace(velocity=(forward, left, turn), velocity_end=end, base_goal=None)
        case BaseGoal(x=x, y=y):
            return goals._replace(base_goal=(x, y), velocity_end=t)
        case HoldBase(on=on):
            return goals._replace(hold_base=on)
        case StopMotion():
            # The present posture: the joints would move on to an old one.
            return goals._replace(frames={}, posture=posture, velocity_end=t, base_goal=None)
    return goals
