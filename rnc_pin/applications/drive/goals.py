"""Goals of a driven run: explicit state of its controller, changed by commands only.

A goal of the base with a heading has plans from rest with feedback, as velocities that the program follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.applications.drive import commands as dc
from rnc_pin.applications.drive.controls import DriveControls, DrivenBase, base_rows
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.control import VelocityTarget
from rnc_pin.model import Measurement, ReducedModel, heading_of, wrapped
from rnc_pin.optimal import (
    BoundKind,
    DistanceBound,
    InputBound,
    SetPoint,
    SetPointController,
    SetPointState,
    VelocityBound,
)
from rnc_pin.outputs import FramePosition, FrameYaw, JointPosition
from rnc_pin.planning import OutputTarget

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
    heading: float | None = None
    """Heading of the base at its goal [rad]; None for any heading."""
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
        case dc.BaseGoal(x=x, y=y, heading=heading):
            return goals._replace(base_goal=(x, y), heading=heading, velocity_end=t)
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


_TOLERANCE = 4e-3  # error at rest above which it plans again [m or rad]
_SPARE = 2.0  # time of a plan beyond that of its distances [s]
_STARTING = 1.0  # time from rest to the largest velocities [s]
_CHECK = 0.5  # time between two predictions of the end [s]
_CLEAR = 0.03  # clearance of plans beyond that of the program [m]
_MOVES = 1e-9
_AT_REST = 1e-3  # largest velocity of other joints in a plan: they follow their own goals


class Parking(NamedTuple):
    """Motion of the base to its goal with a heading."""

    goal: tuple[float, float, float]
    """Position [m] and heading [rad]."""
    controller: SetPointController
    state: SetPointState
    places: tuple[Point, ...]
    """Positions of the obstacles that its plans keep clear of."""

    def arrived(self, measurement: Measurement) -> bool:
        """True if the base stands at its goal."""
        return self.state.mode == "stand" and not self.controller.missed_goals(measurement.q, measurement.v2)

    @property
    def problem(self) -> str:
        """Reason why the base waits; empty if it follows a plan, or no search was in vain."""
        if self.state.mode == "follow" or not self.state.failures:
            return ""
        count = self.state.failures
        return f"no motion to the goal found in {count} search{'es' * (count > 1)}; the next one follows"


@dataclass(frozen=True)
class ParkingPlanner:
    """Motions of a base to goals with a heading.

    Joints on whose positions the motion of the base depends, such as steering angles and hitches, end at their
    positions at the start of the run. Other joints follow their own goals meanwhile.

    Attributes:
        reduced: the model.
        controls: what a user may set.
        base: the base.
        q0: initial configuration (nq,).
        obstacles: obstacles that the program keeps clear of.
        clearance: distance from them that the program keeps [m].
    """

    reduced: ReducedModel
    controls: DriveControls
    base: DrivenBase
    q0: np.ndarray
    obstacles: Sequence[Obstacle]
    clearance: float

    def begin(self, t: float, measurement: Measurement, goals: DriveGoals) -> Parking:
        """Return the motion to the goal of the base.

        Args:
            t: time [s].
            measurement: the present state.
            goals: goals with a goal of the base and its heading.

        Raises:
            RncError: the base cannot have such a goal.
        """
        assert goals.base_goal is not None
        assert goals.heading is not None
        goal = (*goals.base_goal, goals.heading)
        places = _places(goals, t)
        controller = self._controller(measurement.q, goal, places, goals)
        return Parking(goal, controller, controller.initial_state(self._own(measurement)), places)

    def step(
        self, t: float, measurement: Measurement, goals: DriveGoals, parking: Parking
    ) -> tuple[np.ndarray, Parking]:
        """Return the reduced velocity (r,), and the motion after a sample.

        Args:
            t: time [s].
            measurement: the present state.
            goals: present goals.
            parking: the motion before the sample.
        """
        places = _places(goals, t)
        if places != parking.places and places == _places(goals, t + _CHECK):  # moved, and at rest again
            controller = self._controller(measurement.q, parking.goal, places, goals)
            parking = parking._replace(controller=controller, places=places)
        target, state = parking.controller.step(t, self._own(measurement), parking.state)
        return np.array(cast(VelocityTarget, target).v2), parking._replace(state=state)

    def _controller(
        self, q: np.ndarray, goal: tuple[float, float, float], places: Sequence[Point], goals: DriveGoals
    ) -> SetPointController:
        reduced, frame, robot = self.reduced, self.base.frame, self.reduced.robot
        targets: dict[OutputTarget, ArrayLike] = {FramePosition(frame, "xy"): list(goal[:2]), FrameYaw(frame): goal[2]}
        for name in self.base.shape:
            targets[JointPosition(name)] = robot.joint_values(self.q0)[name]
        point = SetPoint(reduced, targets)
        speed, turn = goals.gains["base speed"], goals.gains["turn rate"]
        largest = self._largest(point.q, speed, turn)
        bounds: list[BoundKind] = [
            VelocityBound(-largest, largest),
            InputBound(-largest / _STARTING, largest / _STARTING),
        ]
        if self.obstacles:
            bodies = [_placed(each, place) for each, place in zip(self.obstacles, places, strict=True)]
            distances = CollisionDistances(robot, bodies, PairSelection(links=False))
            bounds.append(DistanceBound(distances, self.clearance + _CLEAR))
        placed = reduced.at(q).position.placement(robot.frame_id(frame))
        away = float(np.linalg.norm(placed.translation[:2] - goal[:2]))
        weight = max(point.coordinates.weights)
        turned = abs(float(wrapped(goal[2] - heading_of(placed.rotation)))) if weight == 1 else np.pi
        duration = _SPARE + max(1, weight - 1) * (away / speed + turned / turn)
        return SetPointController(
            reduced,
            point,
            duration,
            form="acceleration",
            bounds=bounds,
            tolerance=_TOLERANCE,
            check=_CHECK,
            velocities=True,
        )

    def _largest(self, q: np.ndarray, speed: float, turn: float) -> np.ndarray:
        """Largest reduced velocities (r,): those of motions of the base at its speed and its turn rate."""
        at, robot = self.reduced.at(q), self.reduced.robot
        rows = self.base.rates(base_rows(robot, self.base.frame, at), robot)
        found = (np.abs(np.linalg.pinv(rows @ at.R)) * [speed, turn, speed]).max(axis=1)
        return np.where(found > _MOVES, found, _AT_REST)

    def _own(self, measurement: Measurement) -> Measurement:
        """Measurement without the velocities of other joints: the base stands while an arm moves."""
        return measurement._replace(v2=np.where(self.moved, measurement.v2, 0.0))

    @cached_property
    def moved(self) -> np.ndarray:
        """Mask (r,) of the reduced velocities that move the base, or a joint on which its motion depends."""
        robot = self.reduced.robot
        own = [robot.velocity_indices("root_joint"), *(robot.velocity_indices(name) for name in self.base.shape)]
        R = self.reduced.at(self.q0).R
        return np.array(np.abs(np.vstack([R[each] for each in own])).max(axis=0) > _MOVES)


def _placed(obstacle: Obstacle, place: Point) -> Obstacle:
    """Obstacle that rests at a place with the yaw that it has at the start."""
    yaw = obstacle.yaw if obstacle.motion is None else float(obstacle.motion.at(0.0).position[3])
    return replace(obstacle, position=place, yaw=yaw, motion=None)


def _places(goals: DriveGoals, t: float) -> tuple[Point, ...]:
    """Positions of the obstacles at a time [s]."""
    found = (legs[-1].at(t)[0].tolist() for legs in goals.obstacles.values())
    return tuple((x, y, z) for x, y, z in found)
