"""Sample of a whole-body controller, base of its limits ``lower <= J v <= upper``, and the speed limit of a base."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float, Int
from rnc_pin.model.input_validation import Positive, check_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation


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
