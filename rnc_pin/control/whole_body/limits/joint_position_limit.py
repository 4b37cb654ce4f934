"""Limit: positions of joints, with the distance that a joint needs to stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Lt
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.array_shapes import Float
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.control.whole_body.limits.limited_joints import limited_positions, selection_rows
from rnc_pin.control.whole_body.limits.planned_braking import PlannedBraking
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.parameter_types import Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.robots.joint_values import NO_LIMIT

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

    def __post_init__(self) -> None:
        if not 0 <= self.margin < 0.5 or not (self.deceleration is None or 0 < self.deceleration < np.inf):
            raise ConfigurationError(
                "a joint position limit needs a positive deceleration and a margin of 0 to 0.5, found "
                f"{self.deceleration} and {self.margin}"
            )

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundPositions(self, reduced)


class _BoundPositions(BoundLimit):
    def __init__(self, limit: JointPositionLimit, reduced: ReducedModel) -> None:
        found = limited_positions(reduced.robot, limit.joints)
        self._q, self._v = found.q, found.v
        room = limit.margin * (found.upper - found.lower)
        self._lower, self._upper = found.lower + room, found.upper - room
        self._ends = found.lower, found.upper
        names = reduced.robot.velocity_names
        self.names = tuple(f"{names[index]} position" for index in found.v)
        self._jacobian = selection_rows(found.v, reduced.n)
        fastest = np.abs(reduced.robot.model.upperVelocityLimit[found.v])
        limited = (fastest > 0) & (fastest < NO_LIMIT)
        by_range = (found.upper - found.lower) / _CROSSING_TIME**2
        own = np.where(limited, np.where(limited, fastest, 0.0) / _STOPPING_TIME, by_range)
        self._deceleration = own if limit.deceleration is None else np.full(len(own), limit.deceleration)
        self._places = np.array(found.q, dtype=int), np.array(found.v, dtype=int)
        self._limits = np.array([self._lower, self._upper, self._deceleration])
        self._braking = PlannedBraking(reduced) if limit.deceleration is None else None
        self._sides = np.vstack([-self._jacobian, self._jacobian])

    def rows(self, sample: ControlSample) -> LimitRows:
        start = sample.start
        limits, bounds = self._limits, np.empty((2, len(self._v)))
        if self._braking is not None:
            planned = self._braking.decelerations(self._sides, start).reshape(2, -1).min(axis=0)
            limits = np.array([self._lower, self._upper, np.minimum(self._deceleration, planned)])
        if _kernel.library.stopping_velocities(start.q, start.v, *self._places, limits, sample.dt, bounds):
            return LimitRows(self._jacobian, bounds[0], bounds[1])
        q, ahead = start.q[self._q], 0.5 * sample.dt * start.v[self._v]
        room = np.array([self._upper - q - ahead, q + ahead - self._lower])
        upper, lower = velocity_to_stop(room, limits[2], sample.dt)
        return LimitRows(self._jacobian, -lower, upper)

    def exceeded_by(
        self, state: StateEvaluation, time: float, mean: Float[Array, " nv"] | None = None
    ) -> Float[Array, " k"]:
        q, (lower, upper) = state.q[self._q], self._ends
        return np.maximum(q - upper, lower - q)


def velocity_to_stop(
    room: Float[Array, "*sides k"], deceleration: Float[Array, " k"], dt: float
) -> Float[Array, "*sides k"]:
    """Return the largest velocity at the end of a sample from which a joint stops in time.

    Over this sample a joint of velocity u moves by ``dt (u + v) / 2``. From v it then stops in whole samples, at most
    ``a dt`` slower after each. This distance D(v) is the chord of ``v^2 / (2 a)`` between multiples of ``a dt``. The
    result solves ``dt v / 2 + D(v) = room``; it is zero if there is no room.

    Args:
        room: distance to the limit, without the part ``dt u / 2`` of this sample.
        deceleration: a.
        dt: sampling interval [s].
    """
    room = np.maximum(room, 0.0)
    unit = 0.5 * deceleration * dt**2
    whole = np.floor(0.5 * (np.sqrt(1.0 + 4.0 * room / unit) - 1.0))
    return whole * deceleration * dt + (room - unit * whole * (whole + 1.0)) / (dt * (whole + 1.0))
