"""Goals of a driven run: explicit state of its controller, changed by commands only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rnc_pin.applications.drive import commands as dc
from rnc_pin.applications.drive.controls import DriveControls
from rnc_pin.collision import Obstacle

LASTING = 0.5
"""Time for which a velocity command of the base counts [s]: a page that is closed stops the robot."""

Point = tuple[float, float, float]


class PlacedGoal(NamedTuple):
    """Goal of a frame in the world: position [m], and orientation as a quaternion (x, y, z, w) or None."""

    position: Point
    orientation: tuple[float, float, float, float] | None


class ObstacleLeg(NamedTuple):
    """Straight motion of an obstacle at constant speed until it reaches its goal."""

    begin: float
    start: Point
    goal: Point
    speed: float

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity (3,) at a time [s] after the begin."""
        start, way = np.array(self.start), np.subtract(self.goal, self.start)
        length = float(np.linalg.norm(way))
        travelled = self.speed * max(t - self.begin, 0.0)
        if travelled >= length:
            return np.array(self.goal), np.zeros(3)
        unit = way / length
        return start + travelled * unit, self.speed * unit


class DriveGoals(NamedTuple):
    """Goals at one sample, by the names of the controls."""

    frames: Mapping[str, PlacedGoal]
    """Goals of the frames that have one."""
    posture: Mapping[str, float]
    """[rad or m]"""
    gains: Mapping[str, float]
    obstacles: Mapping[str, tuple[ObstacleLeg, ...]]
    """Legs of each obstacle since the start of the run."""
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
    """Goals before the first command: the initial posture, and obstacles at rest."""
    return DriveGoals(
        {},
        {name: each.start for name, each in controls.joints.items()},
        {name: each.start for name, each in controls.gains.items()},
        {name: (ObstacleLeg(0.0, place, place, 1.0),) for name, place in controls.obstacles.items()},
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
        case dc.ObstacleGoal(obstacle=obstacle, position=position):
            legs = goals.obstacles[obstacle]
            x, y, z = legs[-1].at(t)[0].tolist()
            leg = ObstacleLeg(t, (x, y, z), position, goals.gains["obstacle speed"])
            return goals._replace(obstacles={**goals.obstacles, obstacle: (*legs, leg)})
        case dc.StopMotion():
            return goals._replace(frames={}, posture=posture, velocity_end=t, base_goal=None)
    return goals


class _PlaceAndRate(NamedTuple):
    position: np.ndarray
    velocity: np.ndarray


class MovedMotion:
    """Motion of an obstacle along legs; its yaw is constant.

    Args:
        yaw: rotation about the world's z [rad].
        leg: first leg.

    Attributes:
        legs: legs so far; the controller replaces this tuple, and the thread of the page reads it.
    """

    size = 4

    def __init__(self, yaw: float, leg: ObstacleLeg) -> None:
        self._yaw = yaw
        self.legs: tuple[ObstacleLeg, ...] = (leg,)

    def at(self, t: float) -> _PlaceAndRate:
        """Position and velocity (4,) of x, y, z and yaw at a time [s]."""
        leg = next((each for each in reversed(self.legs) if each.begin <= t), self.legs[0])
        place, rate = leg.at(t)
        return _PlaceAndRate(np.append(place, self._yaw), np.append(rate, 0.0))


def movable(obstacles: Sequence[Obstacle]) -> tuple[tuple[Obstacle, ...], tuple[MovedMotion, ...]]:
    """Return obstacles that move by commands, and their motions; a motion of the scenario ends at its first pose."""
    motions = []
    for each in obstacles:
        x, y, z = (float(value) for value in each.placement(0.0).translation)
        yaw = each.yaw if each.motion is None else float(each.motion.at(0.0).position[3])
        motions.append(MovedMotion(yaw, ObstacleLeg(0.0, (x, y, z), (x, y, z), 1.0)))
    return tuple(replace(each, motion=motion) for each, motion in zip(obstacles, motions, strict=True)), tuple(motions)
