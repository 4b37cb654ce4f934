"""Goals of a driven run: explicit state of its controller, changed by commands only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from rnc_pin.applications.drive import commands as dc
from rnc_pin.applications.drive.controls import DriveControls

LASTING = 0.5
"""Time for which a velocity command of the base counts [s]: a page that is closed stops the robot."""

Point = tuple[float, float, float]


class PlacedGoal(NamedTuple):
    """Goal of a frame in the world: position [m], and orientation as a quaternion (x, y, z, w) or None."""

    position: Point
    orientation: tuple[float, float, float, float] | None


class DriveGoals(NamedTuple):
    """Goals at one sample, by the names of the controls."""

    frames: Mapping[str, PlacedGoal]
    """Goals of the frames that have one."""
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
    return DriveGoals(
        {},
        {name: each.start for name, each in controls.joints.items()},
        {name: each.start for name, each in controls.gains.items()},
    )


def with_command(goals: DriveGoals, command: dc.DriveCommand, t: float, posture: Mapping[str, float]) -> DriveGoals:
    """Return the goals after a command.

    Args:
        goals: goals before it.
        command: a checked command.
        t: time of its sample [s].
        posture: present positions of the joints of the posture.
    """
    match command:
        case dc.FrameGoal(frame=frame, position=position, orientation=orientation):
            return goals._replace(frames={**goals.frames, frame: PlacedGoal(position, orientation)})
        case dc.ReleaseFrame(frame=frame):
            return goals._replace(frames={name: goal for name, goal in goals.frames.items() if name != frame})
        case dc.JointGoal(joint=joint, position=position):
            return goals._replace(posture={**goals.posture, joint: position})
        case dc.GainSetting(gain=gain, value=value):
            return goals._replace(gains={**goals.gains, gain: value})
        case dc.BaseVelocity(forward=forward, turn=turn, left=left):
            end = t + LASTING if (forward, left, turn) != (0.0, 0.0, 0.0) else t
            return goals._replace(velocity=(forward, left, turn), velocity_end=end, base_goal=None)
        case dc.BaseGoal(x=x, y=y):
            return goals._replace(base_goal=(x, y), velocity_end=t)
        case dc.HoldBase(on=on):
            return goals._replace(hold_base=on)
        case dc.StopMotion():
            return goals._replace(frames={}, posture=posture, velocity_end=t, base_goal=None)
    return goals
