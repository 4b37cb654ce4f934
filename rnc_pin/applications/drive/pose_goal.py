"""Goal of the base with a heading: plans from rest with feedback, as velocities that the program follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.applications.drive.base import DrivenBase, base_rows
from rnc_pin.applications.drive.controls import DriveControls
from rnc_pin.applications.drive.goals import DriveGoals, Point
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
        gains = dict(zip(self.controls.gains, goals.gains, strict=True))
        speed, turn = gains["base speed"], gains["turn rate"]
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
            targets,
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
    found = (legs[-1].at(t)[0].tolist() for legs in goals.obstacles)
    return tuple((x, y, z) for x, y, z in found)
