"""Kinematic controller of a driven run: commands of a log change goals, which a velocity program follows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rnc_pin.applications.drive.base import ARRIVED
from rnc_pin.applications.drive.controls import DriveControls
from rnc_pin.applications.drive.goals import DriveGoals, initial_goals, with_command
from rnc_pin.applications.drive.log import CommandLog
from rnc_pin.applications.drive.moved_obstacles import MovedMotion
from rnc_pin.applications.drive.tasks import DrivenBaseTask, DrivenFrameTask, DrivenPostureTask, GoalBoard
from rnc_pin.control import Description, TrackerState, VelocityTarget
from rnc_pin.control.whole_body import LimitReport, ProgramState, VelocityQP
from rnc_pin.control.whole_body.limits import ControlLimit
from rnc_pin.control.whole_body.tasks import ControlTask, DampingTask
from rnc_pin.model import Measurement, ReducedModel

_DAMPING = 0.02  # weight of the reduced velocities at the lowest level


class DriveState(NamedTuple):
    """State of the controller."""

    applied: int
    """Number of commands of the log that were applied."""
    goals: DriveGoals
    program: ProgramState


class DriveController:
    """Controller that follows the commands of a log. The same log gives the same motion, bit for bit.

    Args:
        reduced: the model; its vertical outputs are the positions of the frames of the controls.
        controls: what a user may set.
        log: commands with their samples; it may grow between two samples.
        limits: limits of the motion.
        motions: motions of the obstacles, in the order of the controls.
        dt: sampling period [s].
    """

    def __init__(
        self,
        reduced: ReducedModel,
        controls: DriveControls,
        log: CommandLog,
        limits: Sequence[ControlLimit],
        motions: Sequence[MovedMotion],
        dt: float,
    ) -> None:
        self.controls, self.log = controls, log
        self._reduced, self._motions, self._dt = reduced, tuple(motions), dt
        self._board = GoalBoard(controls, initial_goals(controls))
        self.program = VelocityQP(reduced, self._tasks(), limits, dt=dt)
        robot = reduced.robot
        self._places = [robot.single_joint(name) for name in controls.joints]
        base = controls.base
        self._base_frame = None if base is None else robot.frame_id(base.frame)

    def _tasks(self) -> list[ControlTask]:
        board, controls = self._board, self.controls
        tasks: list[ControlTask] = [
            DrivenFrameTask(board=board, index=k, priority=1) for k in range(len(controls.frames))
        ]
        if controls.base is not None:
            tasks.append(DrivenBaseTask(board=board, base=controls.base))
            tasks.append(DrivenBaseTask(board=board, base=controls.base, resting=True, priority=2))
        if controls.joints:
            tasks.append(DrivenPostureTask(board=board, priority=2))
        return [*tasks, DampingTask(weight=_DAMPING, priority=2)]

    def describe(self) -> Description:
        """Return the limits, and the names of the controls."""
        program = self.program.describe()
        return {
            "type": type(self).__name__,
            "frames": list(self.controls.frames),
            "joints": list(self.controls.joints),
            "base": None if self.controls.base is None else self.controls.base.frame,
            "limits": program["limits"],
            "solver": program["solver"],
        }

    def initial_state(self, measurement: Measurement) -> DriveState:
        """Return the state before the first command."""
        return DriveState(0, initial_goals(self.controls), self.program.initial_state(measurement))

    def step(self, t: float, measurement: Measurement, state: DriveState) -> tuple[VelocityTarget, DriveState]:
        """Apply the commands that are due, and solve the program."""
        posture = self._posture(measurement.q)
        goals, sample = state.goals, round(t / self._dt)
        due = self.log.due(state.applied, sample)
        for command in due:
            goals = with_command(goals, command, t, self.controls, posture)
        goals = self._settled(goals, t, measurement.q, posture)
        self._board.goals = goals
        for motion, legs in zip(self._motions, goals.obstacles, strict=True):
            motion.legs = legs
        target, program = self.program.step(t, measurement, state.program)
        return target._replace(x1=self._desired(goals, measurement.x1)), DriveState(
            state.applied + len(due), goals, program
        )

    def report(self, state: DriveState) -> LimitReport:
        """Return the limits that are active, and those that gave way."""
        return self.program.report(state.program)

    def _posture(self, q: np.ndarray) -> list[float]:
        """Positions of the joints of the posture."""
        return [float(joint.position(q)) for joint in self._places]

    def _settled(self, goals: DriveGoals, t: float, q: np.ndarray, posture: list[float]) -> DriveGoals:
        """Goals after the base has arrived; a joint that steers keeps the angle to which the user turned it."""
        base = self.controls.base
        if base is None or self._base_frame is None:
            return goals
        if base.steering is not None and (goals.velocity_at(t) is not None or goals.base_goal is not None):
            place = list(self.controls.joints).index(base.steering)
            goals = goals._replace(posture=(*goals.posture[:place], posture[place], *goals.posture[place + 1 :]))
        if goals.base_goal is not None:
            at = self._reduced.at(q).position.placement(self._base_frame).translation[:2]
            if np.linalg.norm(at - np.array(goals.base_goal)) < ARRIVED:
                goals = goals._replace(base_goal=None)
        return goals

    def _desired(self, goals: DriveGoals, x1: np.ndarray) -> np.ndarray:
        """Desired vertical outputs: the goals of frames; frames without one are where they should be."""
        desired = np.array(x1, dtype=float)
        for k, (goal, axes) in enumerate(zip(goals.frames, self.controls.frames.values(), strict=True)):
            if goal is not None:
                own = desired[3 * k : 3 * k + 3]
                own[list(axes)] = np.array(goal.position)[list(axes)]
        return desired


def drive_state_of(state: object) -> DriveState:
    """Return the state of a ``DriveController`` from that of the tracker above it."""
    inner = state.target if isinstance(state, TrackerState) else state
    assert isinstance(inner, DriveState)
    return inner
