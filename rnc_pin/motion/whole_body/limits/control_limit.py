"""Sample of a whole-body controller, base of its limits ``lower <= J v <= upper``, limits of joints and of a base.

A joint has a limit of its position, with the distance that it needs to stop, of its velocity and its acceleration.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
import pinocchio as pin
from annotated_types import Ge, Lt

from rnc_pin import _kernel
from rnc_pin.array_shapes import Array, Float, Int
from rnc_pin.control.controller import LimitedAcceleration
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.input_validation import Numbers, Positive, check_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.robots.joint_values import known_velocity_limits, limited_positions
from rnc_pin.robots.robot import Robot


def known_state(reduced: ReducedModel, q: Array, v2: Array, t: float | None = None) -> StateEvaluation:
    """Evaluation at a state that the model has computed: it need not be validated.

    Args:
        reduced: the model.
        q, v2: configurations (..., nq) and reduced velocities (..., r), which nobody changes afterwards.
        t: time [s].
    """
    return reduced.at(q, v2, t=t) if reduced.rheonomic else StateEvaluation.at(reduced.evaluator, q, v2)


class ControlSample:
    """Sample of a whole-body controller, as tasks and limits see it.

    The program decides the velocity at the end of the sample. Over the sample the commanded velocity changes linearly.
    So the end is predicted from the velocity that is commanded at the start.

    Args:
        reduced: the model.
        time: time of the start [s].
        q: measured configuration at the start, (nq,).
        v2: reduced velocity commanded at the start, (r,).
        dt: duration of the sample [s]; zero for the start itself.
        start: evaluation at the start, if it is known.

    Attributes:
        time: time of the end [s].
        dt: duration [s].
        start: model at the start: measured configuration, commanded velocity.
        end: model at the predicted configuration of the end. ``end.position`` has placements and Jacobians of frames;
            ``end.R`` and ``end.b`` map reduced velocities at the end, ``v = R v2 + b``. Its own velocity is the one
            commanded at the start.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.eye(reduced.r)[0], dt=0.01)
        >>> sample.time, float(sample.end.q[0].round(6))  # the base moves forward at 1 m/s
        (0.01, 0.01)
    """

    __slots__ = ("_end", "_reduced", "dt", "start", "time")

    def __init__(
        self, reduced: ReducedModel, time: float, q: Array, v2: Array, dt: float, start: StateEvaluation | None = None
    ) -> None:
        self._reduced, self.time, self.dt = reduced, time + dt, dt
        # Both ends in one call of the kernel: a program reads little else of the model.
        known = reduced.evaluator.sample(q, v2, dt) if start is None and dt else None
        self.start, end = known or (start or reduced.at(q, v2, t=time), None)
        self._end: StateEvaluation | None = end if dt else self.start

    @property
    def end(self) -> StateEvaluation:
        if self._end is None:
            ahead = pin.integrate(self._reduced.robot.model, self.start.q, self.dt * self.start.v)
            self._end = known_state(self._reduced, ahead, self.start.v2, self.time)
        return self._end

    def along_reducing_outputs(self) -> StateEvaluation:
        """Return the end, evaluated with each column of R as velocity; one leading axis (r,).

        Rates of this evaluation are derivatives along single reducing outputs.
        """
        columns = self.end.R.T
        q = np.broadcast_to(self.end.q, (len(columns), len(self.end.q)))
        return self._reduced.at(q, v=columns, t=self.time)


class LimitRows(NamedTuple):
    """Rows of a limit at one sample: ``lower <= J v <= upper`` for the velocity at the end of the sample."""

    jacobian: Float[Array, "k nv"]
    """Jacobian J on the full velocity; the program multiplies it by R."""
    lower: Float[Array, " k"]
    """Lower bounds; -inf for rows without one."""
    upper: Float[Array, " k"]
    """Upper bounds; inf for rows without one."""
    places: Int[Array, " k"] | None = None
    """Indices of these rows among the names of the limit, if the other rows are idle; None if no row is left out."""


class HeldMotion(NamedTuple):
    """Motion under constant inputs, at the ends of K equal steps."""

    q: Float[Array, "K+1 nq"]
    v: Float[Array, "K+1 nv"]
    v2: Float[Array, "K+1 r"]
    mean: Float[Array, "K nv"]
    """Mean velocities over the steps."""
    h: float
    """Duration of a step [s]."""

    def fastest(self, entries: Sequence[int]) -> Float[Array, "K e"]:
        """Largest magnitudes of velocities within each step, of the parabolas with these ends and this mean.

        Args:
            entries: entries of v.
        """
        before, after = self.v[:-1, entries], self.v[1:, entries]
        turning = turning_velocities(before, after, self.mean[:, entries])
        return np.maximum(np.maximum(np.abs(before), np.abs(after)), np.abs(turning))


def turning_velocities(before: Array, after: Array, mean: Array) -> Float[np.ndarray, "*batch k"]:
    """Return the velocities at which the parabola of each entry turns; the end of one that rises or falls throughout.

    Args:
        before, after, mean: velocities at the ends of a motion, and their mean over it (..., k).
    """
    bend = 3.0 * (before + after) - 6.0 * mean
    turns, slope = np.abs(after - before) < np.abs(bend), after - before - bend
    turning = before - np.divide(slope**2, 4.0 * bend, out=np.zeros_like(bend), where=turns)
    return np.where(turns, turning, after)


class BoundLimit(ABC):
    """Limit of one model.

    Attributes:
        names: name of each row, (k,), e.g. "elbow position".
        throughout: True if the bounds hold for all velocities within the sample.
        spacing: longest motion of a velocity between two checks of a braking motion [m, rad].
        jacobian: Jacobian of all rows (k, nv), if it is constant and no row is left out; None otherwise.
    """

    names: tuple[str, ...]
    throughout: ClassVar[bool] = False
    spacing: float = 5e-2
    jacobian: Float[Array, "k nv"] | None = None

    @abstractmethod
    def rows(self, sample: ControlSample) -> LimitRows:
        """Return the rows at the end of a sample. An idle row has infinite bounds, or is not among ``places``."""

    def braking_rows(self, sample: ControlSample) -> LimitRows | None:
        """Return rows that a braking motion plans with, which take little time; None if it is checked only.

        Args:
            sample: part of the motion with constant inputs, of several samples of the controller.
        """
        return self.rows(sample)

    def along(self, motion: HeldMotion) -> Float[Array, "K k"] | None:
        """Return the largest amount by which each step of a braking motion exceeds each limit.

        By default, None: the motion is checked at states that are ``spacing`` apart.
        """
        return None

    def exceeded_by(
        self, state: StateEvaluation, time: float, turning: Float[Array, " nv"] | None = None
    ) -> Float[Array, " k"] | None:
        """Return the amount by which a state exceeds each limit, negative or zero for the others.

        Rows can be stricter than a limit: they plan to stop in time. By default, None: a state exceeds the limit if
        its velocity violates the rows of the sample that led to it.

        Args:
            state: the state.
            time: its time [s].
            turning: velocities at which the joints turned within the sample that led to it; None for a start.
        """
        return None


@dataclass(frozen=True, kw_only=True)
class ControlLimit(ABC):
    """Limit of whole-body control: a description without a model.

    To add a limit, derive a frozen dataclass with its settings and a ``bind`` method.

    Args:
        priority: order in which limits give way if they exclude each other: the largest number first. Hard limits never
            give way to others.

    Attributes:
        hard: True for limits that are never softened in favour of others. They have to allow zero velocity.
    """

    hard: ClassVar[bool] = False

    priority: int = 0

    def __post_init__(self) -> None:
        check_settings(self)

    @abstractmethod
    def bind(self, reduced: ReducedModel) -> BoundLimit:
        """Return the limit of a model, with all names resolved.

        Raises:
            ModelError: a joint or frame does not exist.
            ConfigurationError: the settings do not fit the model.
        """


# ------------------------------------------------------------------ decelerations

_BRAKING = 0.5  # share of the efforts that may be planned for stopping
_LEAST = 0.1  # of that deceleration remains where gravity takes more
_NO_EFFECT = 1e-9  # [m/s^2 or rad/s^2 per N m] below which an actuator does not change a row


class PlannedBraking:
    """Half of the efforts of a model, less the load at a state: gravity, velocity products and passive forces.

    The other half is left for other rows that brake at the same time, and for a load that grows while the robot stops.

    Attributes:
        efforts: half of the efforts (p,); infinite without a limit.
    """

    def __init__(self, reduced: ReducedModel) -> None:
        self.efforts = _BRAKING * reduced.actuation.limits
        self._unlimited = np.flatnonzero(~np.isfinite(self.efforts))
        self._efforts = np.where(np.isfinite(self.efforts), self.efforts, 0.0)
        self._any = bool(self._efforts.any())

    def decelerations(self, jacobian: Array, state: StateEvaluation, both: bool = False) -> Float[Array, " k"]:
        """Accelerations (k,) of rows [m/s^2 or rad/s^2] in their positive direction; infinite without limits.

        Args:
            jacobian: rows (k, nv) on the full velocity.
            state: the state.
            both: True for the smaller one of both directions.
        """
        if not (self._any and len(jacobian)):
            return np.full(len(jacobian), np.inf)
        rows = jacobian.dot(state.R)
        effects, adverse = (rows.dot(each) for each in state.input_accelerations)
        planned = np.abs(effects).dot(self._efforts)
        # Where the load takes all that is planned, a joint would never be allowed to move: a part remains.
        found = np.maximum(planned - (np.abs(adverse) if both else np.maximum(-adverse, 0.0)), _LEAST * planned)
        # No actuator stops these rows, so none can be too weak for them.
        found[planned <= _NO_EFFECT] = np.inf
        if len(self._unlimited):
            found[(np.abs(effects[:, self._unlimited]) > _NO_EFFECT).any(axis=1)] = np.inf
        return found


_SIDES = 16  # of the polygon inside a circle: between its corners, the norm is up to 1.9 % smaller
_MARGIN = 1e-3  # share of the limit that covers the change of the Jacobian within a sample
_ANGLES = 2 * np.pi * np.arange(_SIDES) / _SIDES
_NORMALS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
_INSIDE = (1.0 - _MARGIN) * float(np.cos(np.pi / _SIDES))


@dataclass(frozen=True)
class BaseSpeedLimit(ControlLimit):
    """Limit of the speed of a frame over the ground: the norm of its horizontal velocity. A soft limit.

    The program keeps a polygon of 16 sides inside the circle: the speed is never above the limit.

    Args:
        frame: name of the frame, such as that of a base.
        limit: largest speed of its origin [m/s].
        priority: order in which soft limits give way; the largest number first.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> limit = rnc.control.limits.BaseSpeedLimit("base", 0.5)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> limit.bind(reduced).rows(sample).upper[:2].round(4)
        array([0.4899, 0.4899])
    """

    frame: str
    limit: Positive
    priority: int = field(default=0, kw_only=True)

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundSpeed(self, reduced)


class _BoundSpeed(BoundLimit):
    def __init__(self, limit: BaseSpeedLimit, reduced: ReducedModel) -> None:
        self._frame, self._limit = reduced.robot.frame_id(limit.frame), limit.limit
        self.names = tuple(f"{limit.frame} speed at {360 * k / _SIDES:g} deg" for k in range(_SIDES))

    def rows(self, sample: ControlSample) -> LimitRows:
        jacobian = _NORMALS @ sample.end.position.jacobian(self._frame)[:2]
        return LimitRows(jacobian, np.full(_SIDES, -np.inf), np.full(_SIDES, _INSIDE * self._limit))

    def exceeded_by(self, state: StateEvaluation, time: float, turning: Array | None = None) -> Array:
        # The circle itself: its polygon is stricter, and a state inside the circle exceeds nothing.
        speed = float(np.linalg.norm(state.position.jacobian(self._frame)[:2] @ state.v))
        return np.full(_SIDES, speed - self._limit)


def limited_velocities(robot: Robot, joints: Sequence[str] | None, limit: float | None) -> tuple[list[int], np.ndarray]:
    """Return the entries of v with velocity limits, and the limits [rad/s or m/s].

    Args:
        robot: the robot.
        joints: names; by default every joint with a limit, or every joint of one degree of freedom if one is given.
        limit: limit of all of them; the limits of the robot's file by default.

    Raises:
        ModelError: unknown joint.
        ConfigurationError: a named joint has no velocity limit in the file, and none is given.
    """
    model, indices = robot.model, list[int]()
    own = known_velocity_limits(model)
    for name in robot.joint_names if joints is None else joints:
        joint = model.joints[robot.joint_id(name)]
        limited = [i for i in range(joint.idx_v, joint.idx_v + joint.nv) if limit is not None or np.isfinite(own[i])]
        if joints is not None and not limited:
            raise ConfigurationError(f"joint '{name}' has no velocity limit in the robot's file: give one")
        if joints is not None or limit is None or joint.nv == 1:
            indices += limited
    return indices, own[indices] if limit is None else np.full(len(indices), float(limit))


@dataclass(frozen=True)
class JointVelocityLimit(ControlLimit):
    """Velocity limits of joints, from the robot's file by default. A hard limit.

    ``InverseDynamicsQP`` keeps it within each sample, not only at its end.

    Args:
        joints: names; by default every joint with a velocity limit in the file, or every joint of one degree of freedom
            if ``limit`` is given.
        limit: limit of all these joints [rad/s or m/s]; the limits of the file by default.
        margin: share of the limit that stays unused. It covers the change of R within a sample.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> limit = rnc.control.limits.JointVelocityLimit(joints=["joint_1"], limit=0.5, margin=0.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = limit.bind(reduced).rows(sample)
        >>> rows.lower.round(6), rows.upper.round(6)
        (array([-0.5]), array([0.5]))
    """

    hard: ClassVar[bool] = True

    joints: Sequence[str] | None = None
    limit: Positive | None = None
    margin: Annotated[float, Ge(0), Lt(1)] = 1e-3

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundVelocities(self, reduced)


class _BoundVelocities(BoundLimit):
    throughout = True
    jacobian: Array

    def __init__(self, limit: JointVelocityLimit, reduced: ReducedModel) -> None:
        indices, largest = limited_velocities(reduced.robot, limit.joints, limit.limit)
        # R changes within a sample: the margin covers the difference.
        used = (1.0 - limit.margin) * largest
        self.names = tuple(f"{reduced.robot.velocity_names[index]} velocity" for index in indices)
        self.jacobian = np.eye(reduced.n)[indices]
        self._rows = LimitRows(self.jacobian, -used, used)
        self._indices, self._largest = indices, largest

    def rows(self, sample: ControlSample) -> LimitRows:
        return self._rows

    def exceeded_by(self, state: StateEvaluation, time: float, turning: Array | None = None) -> Array:
        fastest = np.abs(state.v[self._indices])
        if turning is not None:
            fastest = np.maximum(fastest, np.abs(turning[self._indices]))
        return fastest - self._largest

    def along(self, motion: HeldMotion) -> Array:
        return motion.fastest(self._indices) - self._largest


_STOPPING_TIME = 0.25  # [s] from the velocity limit, if no deceleration is given
_CROSSING_TIME = 1.0  # [s] for the range of a joint without a velocity limit


@dataclass(frozen=True)
class JointPositionLimit(ControlLimit):
    """Position limits of joints, from the robot's file. A hard limit.

    A joint moves at most as fast as it can still stop before its limit, in whole samples at a constant deceleration.
    So an acceleration limit of the same size can always be respected, if joints move independently. A joint that is
    beyond its limit may rest or return.

    Args:
        joints: names; by default every joint with position limits.
        deceleration: deceleration of these joints [rad/s^2 or m/s^2]. By default each joint stops from its velocity
            limit in 0.25 s; without a velocity limit, it is the range of the joint per s^2. Where efforts are limited,
            it is at most what half of them gives at the state, less the load.
        margin: share of the range that stays unused at each end.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> limit = rnc.control.limits.JointPositionLimit(joints=["joint_1"], deceleration=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = limit.bind(reduced).rows(sample)
        >>> rows.upper.round(1)  # about sqrt(2 a d), with d = 62.8 rad to the end
        array([15.8])
    """

    hard: ClassVar[bool] = True

    joints: Sequence[str] | None = None
    deceleration: Positive | None = None
    margin: Annotated[float, Ge(0), Lt(0.5)] = 1e-3

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundPositions(self, reduced)


class _BoundPositions(BoundLimit):
    jacobian: Array

    def __init__(self, limit: JointPositionLimit, reduced: ReducedModel) -> None:
        found = limited_positions(reduced.robot, limit.joints)
        self._q, self._v = self._places = np.array([found.q, found.v], dtype=int)
        room = limit.margin * (found.upper - found.lower)
        self._ends = found.lower, found.upper
        self.names = tuple(f"{reduced.robot.velocity_names[index]} position" for index in found.v)
        self.jacobian = np.eye(reduced.n)[self._v]
        fastest = known_velocity_limits(reduced.robot.model)[found.v]
        # A joint without a velocity limit has no speed to stop from: its range is the scale.
        by_range = (found.upper - found.lower) / _CROSSING_TIME**2
        own = np.where(np.isfinite(fastest), fastest / _STOPPING_TIME, by_range)
        deceleration = own if limit.deceleration is None else np.full(len(own), limit.deceleration)
        # Towards the upper limits, then towards the lower ones.
        self._inside, self._deceleration = np.append(found.upper - room, -found.lower - room), np.tile(deceleration, 2)
        self._twice, self._sides = np.tile(np.arange(len(found.v)), 2), np.repeat([1.0, -1.0], len(found.v))
        self._braking = PlannedBraking(reduced) if limit.deceleration is None else None

    def rows(self, sample: ControlSample) -> LimitRows:
        start, deceleration = sample.start, self._deceleration
        if self._braking is not None:
            bounds, table = np.empty((2, len(self.names))), (self._places, self._inside, deceleration)
            # The whole bound in one call: of seven joints, each product costs more than its arithmetic.
            forces = start.E_inverse, *start.input_accelerations, self._braking.efforts
            if _kernel.library.stopping(*forces, start.q, start.v, *table, sample.dt, bounds):
                return LimitRows(self.jacobian, bounds[0], bounds[1])
            planned = self._braking.decelerations(self.jacobian, start, both=True)
            deceleration = np.minimum(deceleration, planned[self._twice])
        # The half of this sample that v at its start covers, whatever the program decides.
        ahead = (start.q[self._q] + 0.5 * sample.dt * start.v[self._v])[self._twice]
        return self._up_to(velocity_to_stop(self._inside - self._sides * ahead, deceleration, sample.dt))

    def _up_to(self, fastest: Array) -> LimitRows:
        """Rows for the largest velocities towards both sides."""
        k = len(self.names)
        return LimitRows(self.jacobian, -fastest[k:], fastest[:k])

    def braking_rows(self, sample: ControlSample) -> LimitRows:
        q, v = sample.start.q[self._q][self._twice], sample.start.v[self._v][self._twice]
        # Held inputs change v linearly: the mean of both ends covers the room that is left.
        room = np.maximum(self._inside - self._sides * q, 0.0)
        return self._up_to(np.maximum(2.0 * room / sample.dt - self._sides * v, 0.0))

    def exceeded_by(self, state: StateEvaluation, time: float, turning: Array | None = None) -> Array:
        q, (lower, upper) = state.q[self._q], self._ends
        return np.maximum(q - upper, lower - q)

    def along(self, motion: HeldMotion) -> Array:
        q, v, (lower, upper) = motion.q[:, self._q], motion.v[:, self._v], self._ends
        before, after, speeds = v[:-1], v[1:], np.abs(v)
        # A joint that turns back within a step is farthest where its velocity vanishes.
        part = np.divide(speeds[:-1], speeds[:-1] + speeds[1:], out=np.zeros_like(before), where=before * after < 0.0)
        farthest = q[:-1] + 0.5 * motion.h * before * part
        ends = q[1:]
        return np.maximum(np.maximum(ends, farthest) - upper, lower - np.minimum(ends, farthest))


def velocity_to_stop(room: Float[Array, " k"], deceleration: Float[Array, " k"], dt: float) -> Float[Array, " k"]:
    """Return the largest velocity at the end of a sample from which a joint stops in time.

    Over this sample a joint of velocity u moves by ``dt (u + v) / 2``. From v it then stops in whole samples, at most
    ``a dt`` slower after each. This distance D(v) is the chord of ``v^2 / (2 a)`` between multiples of ``a dt``. The
    result solves ``dt v / 2 + D(v) = room``; it is zero if there is no room.

    Args:
        room: distance to the limit, without the part ``dt u / 2`` of this sample.
        deceleration: a.
        dt: sampling interval [s].
    """
    next_sample, unit = np.maximum(room, 0.0) / dt, 0.5 * dt * deceleration  # velocity if it stops in the next sample
    whole = np.floor(np.sqrt(next_sample / unit + 0.25) - 0.5)
    return whole * unit + next_sample / (whole + 1.0)


@dataclass(frozen=True)
class AccelerationLimit(ControlLimit):
    """Limit of the acceleration between two samples: of every reduced velocity, or of joints.

    A soft limit: it gives way before hard ones. A run that exceeds it fails, whatever the reason.

    Args:
        limit: largest acceleration [rad/s^2 or m/s^2]; one number, or one for each reduced velocity or joint entry, or
            one by the name of each joint, e.g. ``{"joint_1": 2.0}``.
        joints: names of joints; by default the limit is on the reduced velocities v2.
        priority: order in which soft limits give way; the largest number first.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> limit = rnc.control.limits.AccelerationLimit(2.0, joints=["joint_1", "joint_2"])
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = limit.bind(reduced).rows(sample)
        >>> rows.lower.round(6), rows.upper.round(6)  # the limit times dt, about the velocity of the start
        (array([-0.02, -0.02]), array([0.02, 0.02]))
    """

    limit: float | Numbers | Mapping[str, Positive]
    joints: Sequence[str] | None = None
    priority: int = field(default=2, kw_only=True)

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundAccelerations(self, reduced)

    def entries(self, reduced: ReducedModel) -> tuple[LimitedAcceleration, ...]:
        """Limited entries of the accelerations of a model.

        Raises:
            ModelError: a joint does not exist.
            ConfigurationError: the limits are not positive, or do not fit the entries.
        """
        joints, given = self.joints, self.limit
        if isinstance(given, Mapping):
            if joints is not None or not given:
                raise ConfigurationError("an acceleration limit has joints by name: give one or more, and no 'joints'")
            joints, entries = list(given), range(reduced.n)
            given = [limit for name, limit in given.items() for _ in entries[reduced.robot.velocity_indices(name)]]
        largest = np.asarray(given, dtype=float)
        if joints is None:
            quantity: Literal["v", "v2"] = "v2"
            columns, names = list(range(reduced.r)), list(reduced.reducing.names)
        else:
            quantity = "v"
            columns = [k for name in joints for k in range(reduced.n)[reduced.robot.velocity_indices(name)]]
            names = [reduced.robot.velocity_names[index] for index in columns]
        if largest.shape not in ((), (len(names),)) or not ((largest > 0) & (largest < np.inf)).all():
            raise ConfigurationError(
                f"an acceleration limit has to be a positive number or {len(names)}, found {self.limit}"
            )
        limits = np.broadcast_to(largest, len(names)).tolist()
        found = zip(names, columns, limits, strict=True)
        return tuple(LimitedAcceleration(name, quantity, column, -limit, limit) for name, column, limit in found)


class _BoundAccelerations(BoundLimit):
    def __init__(self, limit: AccelerationLimit, reduced: ReducedModel) -> None:
        entries = limit.entries(reduced)
        self.names = tuple(f"{each.name} acceleration" for each in entries)
        self._largest = np.array([each.upper for each in entries])
        of_joints = limit.joints is not None or isinstance(limit.limit, Mapping)
        self._indices = [each.column for each in entries] if of_joints else None
        if self._indices is not None:
            self.jacobian = np.eye(reduced.n)[self._indices]

    def rows(self, sample: ControlSample) -> LimitRows:
        change = self._largest * sample.dt
        # The reducing outputs have rows of their own at each configuration.
        if self.jacobian is None:
            return LimitRows(sample.end.J2, sample.start.v2 - change, sample.start.v2 + change)
        v = sample.start.v[self._indices]
        return LimitRows(self.jacobian, v - change, v + change)

    def along(self, motion: HeldMotion) -> Array:
        v = motion.v2 if self._indices is None else motion.v[:, self._indices]
        return np.abs(np.diff(v, axis=0)) - self._largest * motion.h
