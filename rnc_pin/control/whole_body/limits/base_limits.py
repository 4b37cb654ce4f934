"""Limits of a base: norms of its velocity and acceleration, and speeds of its wheels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy import ndarray as Array

from rnc_pin.constraints.ground_plane import RollingRows
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.model.parameter_types import Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation

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
        return _BoundNorm(self.frame, self.limit, reduced, of_change=False)


@dataclass(frozen=True)
class BaseAccelerationLimit(ControlLimit):
    """Limit of the acceleration of a frame over the ground: the norm of its horizontal part. A soft limit.

    The acceleration is the change of the velocity in world axes between two samples, so it includes that of a turn.
    The program keeps a polygon of 16 sides inside the circle.

    Args:
        frame: name of the frame, such as that of a base.
        limit: largest acceleration of its origin [m/s^2].
        priority: order in which soft limits give way; the largest number first.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> limit = rnc.control.limits.BaseAccelerationLimit("base", 2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> limit.bind(reduced).rows(sample).upper[:2].round(4)  # the limit times dt
        array([0.0196, 0.0196])
    """

    frame: str
    limit: Positive
    priority: int = field(default=2, kw_only=True)

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundNorm(self.frame, self.limit, reduced, of_change=True)


class _BoundNorm(BoundLimit):
    """Norm of the horizontal velocity of a frame, or of its change in a sample over the duration."""

    def __init__(self, frame: str, limit: float, reduced: ReducedModel, of_change: bool) -> None:
        what = "acceleration" if of_change else "speed"
        self._frame, self._limit, self._of_change = reduced.robot.frame_id(frame), limit, of_change
        self.names = tuple(f"{frame} {what} at {360 * k / _SIDES:g} deg" for k in range(_SIDES))

    def rows(self, sample: ControlSample) -> LimitRows:
        jacobian = _NORMALS @ sample.end.position.jacobian(self._frame)[:2]
        upper = np.full(_SIDES, _INSIDE * self._limit)
        if self._of_change:
            at_start = sample.start.position.jacobian(self._frame)[:2] @ sample.start.v
            upper = sample.dt * upper + _NORMALS @ at_start
        return LimitRows(jacobian, np.full(_SIDES, -np.inf), upper)

    def exceeded_by(self, state: StateEvaluation, time: float, mean: Array | None = None) -> Array | None:
        if self._of_change:
            return None
        speed = float(np.linalg.norm(state.position.jacobian(self._frame)[:2] @ state.v))
        return np.full(_SIDES, speed - self._limit)


@dataclass(frozen=True)
class WheelSpeedLimit(ControlLimit):
    """Limit of the speed of rolling wheels: radius times rate about the axle, whichever joint turns it.

    Args:
        limit: largest speed of the rim about the axle [m/s]; the speed over the ground of a wheel without rollers.
        wheels: frames of the wheels, as in their ``RollingWheel`` constraints; by default all of them.
        priority: order in which soft limits give way; the largest number first.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.2), rnc.RollingWheel("right_wheel", 0.2)]
        >>> reduced = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"]).reduce()
        >>> limit = rnc.control.limits.WheelSpeedLimit(1.0)
        >>> bound = limit.bind(reduced)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = bound.rows(sample)
        >>> rows.jacobian[:, -2:].round(6), rows.upper  # radius times rate of each wheel, at most 1 m/s
        (array([[0.2, 0. ],
               [0. , 0.2]]), array([1., 1.]))
    """

    limit: Positive
    wheels: Sequence[str] | None = None
    priority: int = field(default=0, kw_only=True)

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundWheels(self, reduced)


class _BoundWheels(BoundLimit):
    def __init__(self, limit: WheelSpeedLimit, reduced: ReducedModel) -> None:
        blocks = [place.block for place in reduced.all_constraints.places]
        rolling = {block.wheel: block for block in blocks if isinstance(block, RollingRows)}
        for name in limit.wheels or ():
            if name not in rolling:
                raise ConfigurationError(f"no RollingWheel constraint on frame '{name}'{nearest(name, rolling)}")
        if not rolling:
            raise ConfigurationError("a wheel speed limit needs RollingWheel constraints; the system has none")
        self._wheels = [rolling[name] for name in (rolling if limit.wheels is None else limit.wheels)]
        self.names = tuple(f"{each.wheel} speed" for each in self._wheels)
        self._upper = np.full(len(self._wheels), float(limit.limit))

    def rows(self, sample: ControlSample) -> LimitRows:
        at = sample.end.position
        jacobian = np.array(
            [each.radius * (at.rotation(each.frame) @ each.axle) @ at.jacobian(each.frame)[3:] for each in self._wheels]
        )
        return LimitRows(jacobian, -self._upper, self._upper)
