"""Kinematic controller of a driven run: commands of a log change goals, which a velocity program follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.applications.drive.commands import DriveGoals, LoggedCommand, due_commands, initial_goals, with_command
from rnc_pin.applications.drive.controls import ARRIVED, DriveControls, DrivenBase, base_rows, curvature
from rnc_pin.control import Description, TrackerState, TwistController, VelocityTarget
from rnc_pin.errors import few
from rnc_pin.model import Measurement, ReducedModel, heading_of, wrapped
from rnc_pin.motion.whole_body import ControlSample, ProgramState, VelocityQP
from rnc_pin.motion.whole_body.limits import AccelerationLimit, ControlLimit
from rnc_pin.motion.whole_body.tasks import BoundTask, ControlTask, DampingTask, TaskRows
from rnc_pin.verdict import Finding, FindingKind, Severity

_ATTITUDE = 0.3  # [m/rad]; error of the orientation beside that of the position
_STILL = 0.1  # weight of joints whose posture gain is zero
_ACCELERATION = 2.0  # of a base with pivots [m/s^2, rad/s^2]
_SLOWING = 1.5  # speed of the base over its distance from the goal [1/s]
_TURNING = 2.5  # turn rate over the bearing of the goal [1/s]
_WAITING = 0.8  # share of its speed that a base gives up while it has to steer first
_BENT = 0.03  # angle of the curvature's error from which it waits most
_FADING = 5.0  # steering rate and waiting, over the effect of steering that is left and that is lost; both up to 1
_SMALLEST_REACH = 1e-6  # [m^2]


@dataclass
class GoalBoard:
    """Goals of the present sample. The controller writes them before each program, from its own state.

    Attributes:
        controls: what a user may set.
        accelerations: limits of the accelerations of the reduced velocities (r,).
        goals: the goals.
    """

    controls: DriveControls
    accelerations: np.ndarray
    goals: DriveGoals

    def approach(self, error: float, gain: float, speed: float, row: np.ndarray) -> float:
        """Speed towards a goal: a gain and a largest speed, and so slow that the robot can brake.

        Args:
            error: distance that is left.
            gain: speed over distance [1/s].
            speed: largest speed.
            row: rate of the distance over the reduced velocities (r,).
        """
        # Reduced accelerations of the least motion that decelerates the row by one.
        needed = np.abs(row) / max(float(row @ row), 1e-300)
        braking = float((self.accelerations / np.maximum(needed, 1e-12)).min(initial=np.inf))
        # The square root is the speed from which the limits can still stop at the goal.
        return min(gain * abs(error), speed, float(np.sqrt(braking * abs(error))))


@dataclass(frozen=True, kw_only=True)
class DrivenTask(ControlTask):
    """Task of a driven run, whose rows follow the goals on the board.

    Args:
        rows: the task of the model.
    """

    rows: BoundTask

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return self.rows


class _Base(BoundTask):
    """Velocity of the base by command or towards its goal; without them, idle or at rest.

    Args:
        reduced: the model.
        board: goals.
        base: the base.
        dt: sampling period [s].
        resting: True for the task at the lowest level that keeps the base at rest; False for the commands.
    """

    constant = True  # speeds of the base

    def __init__(
        self, reduced: ReducedModel, board: GoalBoard, base: DrivenBase, dt: float, resting: bool = False
    ) -> None:
        self._robot, self._board, self._base, self._resting = reduced.robot, board, base, resting
        self._frame = reduced.robot.frame_id(base.frame)
        self._places = [reduced.robot.velocity_indices(name).start for name in board.controls.joints]
        self._pivots = [reduced.robot.velocity_indices(name).start for name in base.pivots]
        most = (_ACCELERATION,) * 3
        self._aiming = TwistController(reduced, base.frame, dt, max_acceleration=most) if base.pivots else None
        self.names = (*(f"{base.frame} {name}" for name in ("forward", "left", "turn")), *base.pivots)

    def rows(self, sample: ControlSample) -> TaskRows:
        base, resting, aiming = self._base, self._resting, self._aiming
        moving = base_rows(self._robot, base.frame, sample.end)
        # Motions that the base does not have get no row: the constraints keep them at zero.
        rows = np.vstack([moving if aiming else base.rates(moving, self._robot), np.eye(self._robot.nv)[self._pivots]])
        wanted = None if resting else self._rates(sample, moving)
        # No command at the level of commands: the base is free to help the goals of frames.
        if wanted is None and not resting and not self._board.goals.hold_base:
            return TaskRows(np.zeros_like(rows), np.zeros(len(rows)))
        rates = np.zeros(3) if wanted is None else wanted
        if aiming is not None:
            forward, left, turn = rates.tolist()
            twist, limits = (forward, left if base.slides else None, turn), (sample.end.J2, self._board.accelerations)
            aimed = aiming.aimed(sample.end.q, twist, sample.start.v, sample.dt or aiming.dt, limits)
            return TaskRows(rows, np.concatenate(aimed))
        if wanted is None and not base.turns:
            rows[2] = 0.0 if resting or base.folding == 0 else moving[2]  # the posture has the steering joint
        return TaskRows(rows, rates)

    def _rates(self, sample: ControlSample, moving: np.ndarray) -> np.ndarray | None:
        """Rates (3,) by command, else towards the goal: forward, to the left, and turn; None without both.

        The third rate of a base that is steered is that of its steering joint.
        """
        board, base = self._board, self._base
        gains, goal = board.goals.gains, board.goals.base_goal
        # At the start of the sample, whose time is its end.
        shares = board.goals.velocity_at(sample.time - sample.dt)
        if shares is None:
            return None if goal is None else self._towards(goal, sample, moving)
        rates = np.array(shares) * [gains["base speed"], gains["base speed"], gains["turn rate"]]
        if not base.turns and base.steering is not None:
            rate, reach = float(rates[2]) * base.steering_sign, board.controls.joints[base.steering]
            angle = float(self._robot.single_joint(base.steering).position(sample.end.q))
            row = sample.end.R[self._robot.velocity_indices(base.steering).start]
            # A key that is held turns the joint into its limit: it slows down before.
            room = (reach.upper if rate > 0 else reach.lower) - angle
            rates[2] = np.sign(rate) * board.approach(room, _TURNING, abs(rate), row)
        return rates

    def _towards(self, goal: tuple[float, float], sample: ControlSample, moving: np.ndarray) -> np.ndarray:
        """Rates (3,) that bring the base to a point.

        A base that slides moves straight. One that turns on the spot turns to the point while it drives. A steered one
        follows the circle that leads its frame through the point, with the present heading of its axle.
        """
        board, base, gains = self._board, self._base, self._board.goals.gains
        placed, rows = sample.end.position.placement(self._frame), moving @ sample.end.R
        dx, dy = (np.array(goal) - placed.translation[:2]).tolist()
        distance = float(np.hypot(dx, dy))
        if distance < ARRIVED:
            return np.zeros(3)
        bearing = float(wrapped(np.arctan2(dy, dx) - heading_of(placed.rotation)))
        speed = board.approach(distance, _SLOWING, gains["base speed"], rows[0])
        if base.slides:
            return np.array([speed * np.cos(bearing), speed * np.sin(bearing), 0.0])
        if base.turns:
            # A point behind the base: it turns on the spot first.
            turn = np.sign(bearing) * board.approach(bearing, _TURNING, gains["turn rate"], rows[2])
            return np.array([speed * max(np.cos(bearing), 0.0), 0.0, turn])
        # A steering joint that also turns the base moves its frame aside. So the base waits for the joint, and the
        # joint rests where it would lead the base away from the goal.
        x, y = distance * np.cos(bearing), distance * np.sin(bearing)
        # The circle through the goal that begins along the axle's heading has the curvature 2 y / reach.
        reach = x * x + y * y + 2.0 * base.ahead * x
        # A goal beside the axle has no such circle.
        reach = float(np.copysign(max(abs(reach), _SMALLEST_REACH), reach))
        # Share of its effect that steering loses because it moves the frame as well.
        lost = float(np.clip(-2.0 * base.folding * (base.ahead + x) / reach, 0.0, 1.0))
        share = min(_FADING * (1.0 - lost), 1.0)
        error = float(np.arctan(2.0 * y / reach) - np.arctan(curvature(sample.end, moving, self._places)))
        waiting = _WAITING * share * min(_FADING * lost, 1.0) * min(abs(error) / _BENT, 1.0)
        fastest = gains["turn rate"]
        rate = float(np.clip(share * _TURNING * base.steering_sign * error, -fastest, fastest))
        # A goal behind is reached backwards.
        return np.array([speed * (1.0 - waiting) * (1.0 if x >= 0 else -1.0), 0.0, rate])


class _Frame(BoundTask):
    """Goal of a frame, approached at most at the speed of the board; idle without a goal.

    Args:
        reduced: the model.
        board: goals.
        name: name of the frame.
    """

    def __init__(self, reduced: ReducedModel, board: GoalBoard, name: str) -> None:
        self._board, self._name = board, name
        self._frame = reduced.robot.frame_id(name)
        self.names = tuple(f"{name} {axis}" for axis in ("x", "y", "z", "about x", "about y", "about z"))
        self._idle = TaskRows(np.zeros((6, reduced.n)), np.zeros(6))

    def rows(self, sample: ControlSample) -> TaskRows:
        board = self._board
        # Goals come and go, and the program keeps its size: rows without a goal are zero.
        goal = board.goals.frames.get(self._name)
        if goal is None:
            return self._idle
        at = sample.end.position
        placed, jacobian = at.placement(self._frame), at.jacobian(self._frame).copy()
        gain, speed = board.goals.gains["frame gain"], board.goals.gains["frame speed"]
        rate = np.zeros(6)
        error = np.array(goal.position) - placed.translation
        distance = float(np.linalg.norm(error))
        # Rate of the distance: the rows along the way that is left.
        row = error / max(distance, 1e-300) @ jacobian[:3] @ sample.end.R
        rate[:3] = limited(gain * error, board.approach(distance, gain, speed, row))
        if goal.orientation is None:
            # The frame may turn as the way needs it.
            jacobian[3:] = 0.0
        else:
            # Commands of half and of twice the unit length pass their check.
            wanted = pin.Quaternion(np.array(goal.orientation)).normalized().toRotationMatrix()
            rate[3:] = limited(gain * pin.log3(wanted @ np.array(placed.rotation).T), speed / _ATTITUDE)
            # Radians count as so many metres, so that one task has both.
            jacobian[3:] *= _ATTITUDE
            rate[3:] *= _ATTITUDE
        return TaskRows(jacobian, rate)


class _Posture(BoundTask):
    """Joints that move to their positions on the board, at most at its joint speed.

    Args:
        reduced: the model.
        board: goals.
    """

    def __init__(self, reduced: ReducedModel, board: GoalBoard) -> None:
        self._board, self._robot = board, reduced.robot
        joints = list(board.controls.joints)
        self._places = [reduced.robot.velocity_indices(name).start for name in joints]
        self.names = tuple(f"{name} posture" for name in joints)
        self._jacobian = np.eye(reduced.n)[self._places]

    def rows(self, sample: ControlSample) -> TaskRows:
        board = self._board
        goal = self._robot.configuration(board.goals.posture)
        # By the model: a continuous joint takes the short way round.
        error = pin.difference(self._robot.model, sample.end.q, goal)[self._places]
        speed, gain = board.goals.gains["joint speed"], board.goals.gains["posture gain"]
        rows = sample.end.R[self._places]
        fastest = [board.approach(each, gain, speed, row) for each, row in zip(error.tolist(), rows, strict=True)]
        rate = np.sign(error) * fastest
        # At gain zero the rate is zero too: a small weight damps the joint and does not hold it.
        root = 1.0 if gain > 0 else _STILL
        return TaskRows(root * self._jacobian, root * rate)


def limited(rate: np.ndarray, largest: float) -> np.ndarray:
    """Return a vector, shortened to a largest length."""
    length = float(np.linalg.norm(rate))
    return rate if length <= largest else rate * (largest / length)


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
        dt: sampling period [s].
    """

    def __init__(
        self,
        reduced: ReducedModel,
        controls: DriveControls,
        log: Sequence[LoggedCommand],
        limits: Sequence[ControlLimit],
        dt: float,
    ) -> None:
        self.controls, self.log = controls, log
        self._reduced, self._dt = reduced, dt
        accelerations = np.full(reduced.r, np.inf)
        for limit in limits:
            # Only limits of all velocities: those of single joints do not tell how a frame brakes.
            for each in limit.entries(reduced) if isinstance(limit, AccelerationLimit) else ():
                if each.quantity == "v2":
                    accelerations[each.column] = each.upper
        self._board = GoalBoard(controls, accelerations, initial_goals(controls))
        self.program = VelocityQP(reduced, self._tasks(), limits, dt=dt)
        self._joints = {name: reduced.robot.single_joint(name) for name in controls.joints}

    def _tasks(self) -> list[ControlTask]:
        reduced, board, controls = self._reduced, self._board, self.controls
        tasks = list[ControlTask](DrivenTask(rows=_Frame(reduced, board, name), priority=1) for name in controls.frames)
        if controls.base is not None:
            tasks.append(DrivenTask(rows=_Base(reduced, board, controls.base, self._dt)))
            tasks.append(DrivenTask(rows=_Base(reduced, board, controls.base, self._dt, resting=True), priority=2))
        if controls.joints:
            tasks.append(DrivenTask(rows=_Posture(reduced, board), priority=2))
        return [*tasks, DampingTask(weight=_DAMPING, priority=2)]

    def describe(self) -> Description:
        """Return the limits, and the names of the controls."""
        return {
            "type": type(self).__name__,
            "frames": list(self.controls.frames),
            "joints": list(self.controls.joints),
            "base": None if self.controls.base is None else self.controls.base.frame,
            "limits": self.program.describe()["limits"],
        }

    def initial_state(self, measurement: Measurement) -> DriveState:
        """Return the state before the first command."""
        return DriveState(0, initial_goals(self.controls), self.program.initial_state(measurement))

    def step(self, t: float, measurement: Measurement, state: DriveState) -> tuple[VelocityTarget, DriveState]:
        """Apply the commands that are due, and solve the program."""
        posture = {name: float(joint.position(measurement.q)) for name, joint in self._joints.items()}
        # By number: times are sums of dt, which round.
        goals, sample = state.goals, round(t / self._dt)
        due = due_commands(self.log, state.applied, sample)
        for command in due:
            goals = with_command(goals, command, t, posture)
        goals = self._settled(goals, t, measurement.q, posture)
        # Tasks have no state of their own: they read what the controller wrote for this sample.
        self._board.goals = goals
        target, program = self.program.step(t, measurement, state.program)
        target = target._replace(x1=self._desired(goals, measurement.x1))
        return target, DriveState(state.applied + len(due), goals, program)

    def findings(self, state: object, samples: int) -> tuple[Finding, ...]:
        """Return findings of the program, and the distances that hold the robot back at the end."""
        program = drive_state_of(state).program
        # Without accelerations, which are soft limits: a sudden stop may exceed them.
        found = [each for each in self.program.findings(program, samples) if not each.where.endswith(" acceleration")]
        held = [name for name in self.program.report(program).active if name.endswith(" distance")]
        if held:
            message = f"at the end, collision avoidance holds the robot back: {few(held)}"
            found.append(Finding(FindingKind.CLEARANCE, "collision avoidance", None, "m", None, Severity.NOTE, message))
        return tuple(found)

    def _settled(self, goals: DriveGoals, t: float, q: np.ndarray, posture: Mapping[str, float]) -> DriveGoals:
        """Goals after the base has arrived; a joint that steers keeps the angle to which the user turned it."""
        base = self.controls.base
        if base is None:
            return goals
        # The base turns this joint while it drives: its posture would pull it back afterwards.
        if base.steering is not None and (goals.velocity_at(t) is not None or goals.base_goal is not None):
            goals = goals._replace(posture={**goals.posture, base.steering: posture[base.steering]})
        if goals.base_goal is not None:
            frame = self._reduced.robot.frame_id(base.frame)
            at = self._reduced.at(q).position.placement(frame).translation[:2]
            if np.linalg.norm(at - np.array(goals.base_goal)) < ARRIVED:
                goals = goals._replace(base_goal=None)
        return goals

    def _desired(self, goals: DriveGoals, x1: np.ndarray) -> np.ndarray:
        """Desired vertical outputs: the goals of frames; frames without one are where they should be."""
        desired = np.array(x1, dtype=float)
        for k, (name, axes) in enumerate(self.controls.frames.items()):
            if name in goals.frames:
                # Along other axes a goal cannot be reached: the record would show a lasting error.
                own = desired[3 * k : 3 * k + 3]
                own[list(axes)] = np.array(goals.frames[name].position)[list(axes)]
        return desired


def drive_state_of(state: object) -> DriveState:
    """Return the state of a ``DriveController`` from that of the tracker above it."""
    inner = state.target if isinstance(state, TrackerState) else state
    assert isinstance(inner, DriveState)
    return inner
