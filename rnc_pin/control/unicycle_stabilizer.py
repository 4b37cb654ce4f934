"""Point stabilisation of a unicycle: position and heading, from any pose.

M. Aicardi, G. Casalino, A. Bicchi, A. Balestrino, "Closed loop steering of unicycle like vehicles via Lyapunov
techniques", IEEE Robotics & Automation Magazine 2(1) (1995) 27-35. e is the distance to the goal. alpha and theta are
the angles to the line of sight: alpha from the heading, theta from the goal's heading. The inputs

    v = k e cos(alpha),    w = c alpha + k cos(alpha) sinc(alpha) (alpha + h theta)

give ``Vdot = -k e^2 cos^2(alpha) - c alpha^2`` for ``V = (e^2 + alpha^2 + h theta^2) / 2``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from rnc_pin.control.controller import DescribedMixin, VelocityTarget
from rnc_pin.control.gain_design import DEFAULT_OUTER_GAINS
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.math.linear_algebra import Component
from rnc_pin.model.coordinates import wrapped
from rnc_pin.model.reduced_kinematics import Measurement

_WAKE_FACTOR = 2.0  # distance or heading error, in multiples of ``tolerance``, at which a resting vehicle starts again
_REVERSAL_RATIO = 0.5  # largest ratio of the angle terms of V, after to before, for a change of driving direction
_SERIES_ANGLE = 1e-3  # alpha [rad] below which quotients by alpha use their series


class DrivingState(NamedTuple):
    """State of the stabiliser: waiting, resting or driving, and the driving direction."""

    mode: np.ndarray
    """Time of the last start [s], NaN while it waits; 1 while it rests; 1 while it drives backwards: (..., 3)."""

    @property
    def since(self) -> Component:
        """Time of the last start [s], NaN while it waits, (...)."""
        return cast(Component, self.mode.T[0])

    @property
    def resting(self) -> np.ndarray:
        """True while it rests, (...)."""
        return cast(np.ndarray, self.mode.T[1] == 1.0)

    @property
    def backwards(self) -> np.ndarray:
        """True while it drives backwards, (...)."""
        return cast(np.ndarray, self.mode.T[2] == 1.0)


class _PolarPose(NamedTuple):
    """Pose in the coordinates of the control law, for forward or backward driving; arrays (B,) of many vehicles."""

    distance: Component
    alpha: Component
    """From the heading to the line of sight (-pi, pi]."""
    theta: Component
    """From the goal's heading to the line of sight (-pi, pi]."""


class UnicycleStabilizer(DescribedMixin):
    """Controller that drives a unicycle (forward speed, yaw) to a pose, from any other pose.

    The law is that of Aicardi and others, with V as above, forwards or backwards: the direction with less turning. The
    direction changes only if that decreases V, so V always decreases. A common factor on speed and yaw rate keeps both
    below their limits; it does not change the path, nor V along it. The vehicle rests until ``begin``, and when
    distance, heading error and motion are all small. After a disturbance it starts again. At the goal the line of sight
    has no direction (no continuous law exists, Brockett 1983): closer than half of ``tolerance`` the vehicle only
    turns.

    Reads from the measurement: ``x1`` (positions), ``x2`` (of speed and yaw), ``v2``.

    Args:
        goal: (x, y, heading) [m, m, rad].
        position: indices of the vehicle's x and y in x1.
        begin: time at which it starts [s].
        k: decay rate of the distance [1/s].
        rate: decay rate of the angles [1/s]; above k, so that the angles decay before the distance.
        tolerance: distance [m], heading error [rad] and their rates [per s] below which the vehicle rests.
        ramp_time: time over which the speed grows from zero [s].
        max_speed: largest desired forward speed [m/s] and yaw rate [rad/s].

    Raises:
        ConfigurationError: rates or limits are not valid.
        InputError: the vehicle's position or heading is not given at a sample.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")], [rnc.FramePosition("sleigh", "xy")])
        >>> goal, fast = np.array([2.0, 0.0, 0.0]), (1e6, 1e6)
        >>> controller = rnc.control.UnicycleStabilizer(goal, np.array([0, 1]), k=0.5, ramp_time=0.0, max_speed=fast)
        >>> measurement = reduced.at(robot.configuration(), np.zeros(2)).measure(np.zeros(2))
        >>> target, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> target.v2.round(6) + 0.0  # k times the distance, straight ahead
        array([1., 0.])
    """

    described = ("goal", "begin", "k", "rate", "tolerance", "ramp_time", "max_speed")

    def __init__(
        self,
        goal: np.ndarray,
        position: np.ndarray,
        begin: float = 0.0,
        k: float = DEFAULT_OUTER_GAINS.k,
        rate: float = DEFAULT_OUTER_GAINS.rate,
        tolerance: float = DEFAULT_OUTER_GAINS.tolerance,
        ramp_time: float = 1.0,
        max_speed: tuple[float, float] = DEFAULT_OUTER_GAINS.max_speed,
    ) -> None:
        if not 0 < k < rate:
            raise ConfigurationError(f"a unicycle's stabiliser needs 0 < k < rate, found {k:g} and {rate:g}")
        if not (tolerance > 0 and ramp_time >= 0 and min(max_speed) > 0):
            raise ConfigurationError(
                f"a unicycle's stabiliser needs tolerance > 0, ramp_time >= 0 and positive limits, found "
                f"{tolerance:g}, {ramp_time:g} and {tuple(max_speed)}"
            )
        self.goal, self.position = np.asarray(goal, dtype=float), np.asarray(position, dtype=int)
        self.begin, self.k, self.rate = begin, k, rate
        self.tolerance, self.ramp_time = tolerance, ramp_time
        self.max_speed = float(max_speed[0]), float(max_speed[1])
        # Near the line of sight the angles have the polynomial s^2 + c s + k^2 h: poles at -rate and -1.2 rate.
        self._c, self._h = 2.2 * rate, 1.2 * rate**2 / k**2

    def initial_state(self, measurement: Measurement) -> DrivingState:
        """Return the waiting state."""
        self._pose(measurement.x1, measurement.x2)
        return DrivingState(np.broadcast_to([np.nan, 0.0, 0.0], (*measurement.x2.shape[:-1], 3)))

    def step(self, t: float, measurement: Measurement, state: DrivingState) -> tuple[VelocityTarget, DrivingState]:
        pose, v2 = self._pose(measurement.x1, measurement.x2), np.asarray(measurement.v2, dtype=float)
        state = self._update_mode(t, pose, v2, state)
        x1, x2 = np.full(measurement.x1.shape, np.nan), np.full(v2.shape, np.nan)
        x1[..., self.position], x2[..., 1] = self.goal[:2], self.goal[2]
        drives = np.isfinite(state.since) & ~state.resting
        if not drives.any():
            still = np.zeros(v2.shape)
            return VelocityTarget(v2=still, v2_dot=still, x1=x1, x2=x2), state
        sign = _choose(state.backwards, -1.0, 1.0)
        (v, w), (v_dot, w_dot) = self._limited(*self._law(self._polar_pose(pose, sign), v2, sign))
        ramp, since = self.ramp_time or 1.0, t - state.since
        starts = np.less(since, self.ramp_time)
        share, growth = _choose(starts, since / ramp, 1.0), _choose(starts, 1.0 / ramp, 0.0)
        desired = _vectors(_choose(drives, share * v, 0.0), _choose(drives, share * w, 0.0))
        rates = _vectors(
            _choose(drives, share * v_dot + growth * v, 0.0), _choose(drives, share * w_dot + growth * w, 0.0)
        )
        return VelocityTarget(v2=desired, v2_dot=rates, x1=x1, x2=x2), state

    def _pose(self, x1: np.ndarray, x2: np.ndarray) -> Sequence[Component]:
        """Position in the goal's axes, and the heading relative to the goal's in (-pi, pi]."""
        dx, dy = (x1.T[place] - goal for place, goal in zip(self.position, self.goal, strict=False))
        c, s = np.cos(self.goal[2]), np.sin(self.goal[2])
        pose = c * dx + s * dy, c * dy - s * dx, wrapped(x2.T[1] - self.goal[2])
        if not np.isfinite(pose[0] + pose[1] + pose[2]).all():
            raise InputError("the vehicle's position and heading have to be given in x1 and x2")
        return pose

    def _update_mode(self, t: float, pose: Sequence[Component], v2: np.ndarray, state: DrivingState) -> DrivingState:
        """New state: waiting, resting or driving, and the driving direction."""
        if t < self.begin:
            return state
        since, resting, backwards = state.since, state.resting, state.backwards
        off = np.maximum(np.hypot(pose[0], pose[1]), np.abs(pose[2]))
        rests = (off < self.tolerance) & (np.abs(v2).max(axis=-1) < self.tolerance)
        stays = ~rests & resting & (off < _WAKE_FACTOR * self.tolerance)
        starts = ~rests & ~stays & (np.isnan(since) | resting)
        forth, back = (self._angle_cost(self._polar_pose(pose, sign)) for sign in (1.0, -1.0))
        now, other = _choose(backwards, back, forth), _choose(backwards, forth, back)
        turns = other < _REVERSAL_RATIO * now
        way = _choose(starts, back < forth, _choose(rests | stays, backwards, backwards != turns))
        return DrivingState(_vectors(_choose(rests | starts, t, since), _choose(rests | stays, 1.0, 0.0), way))

    def _polar_pose(self, pose: Sequence[Component], sign: Component) -> _PolarPose:
        """Pose in the coordinates of the law; where the sign is -1, for backward driving, both headings turn by pi."""
        x, y, heading = pose
        about, e = _choose(np.less(sign, 0.0), np.pi, 0.0), np.hypot(x, y)
        there = e < self.tolerance / 2  # at the goal, except for the heading
        bearing = np.arctan2(-y, -x)
        alpha = cast(np.ndarray, _choose(there, -heading, bearing - heading - about))
        return _PolarPose(_choose(there, 0.0, e), wrapped(alpha), _choose(there, 0.0, wrapped(bearing - about)))

    def _angle_cost(self, polar: _PolarPose) -> Component:
        """Angle terms of 2 V."""
        return polar.alpha * polar.alpha + self._h * (polar.theta * polar.theta)

    def _law(
        self, polar: _PolarPose, v2: np.ndarray, sign: Component
    ) -> tuple[tuple[Component, Component], tuple[Component, Component]]:
        """Inputs (v, w) of the law, and their rates while the vehicle moves at v2; the sign is the direction."""
        (e, alpha, theta), k, h = polar, self.k, self._h
        speed, turn = sign * v2.T[0], v2.T[1]
        c, s = np.cos(alpha), np.sin(alpha)
        # Closer than ``tolerance``, bound the rate of the line of sight: the vehicle is about to rest.
        far = np.maximum(e, self.tolerance)
        theta_dot = speed * s * e / (far * far)
        alpha_dot = theta_dot - turn
        v_dot = k * (-speed * c * c - e * s * alpha_dot)
        series = np.abs(alpha) < _SERIES_ANGLE
        divisor = _choose(series, 1.0, alpha)
        share = _choose(series, 1.0 - 2.0 / 3.0 * (alpha * alpha), c * s / divisor)  # cos(alpha) sinc(alpha)
        slope = _choose(series, -4.0 / 3.0 * alpha, (np.cos(2 * alpha) - c * s / divisor) / divisor)
        weighted, weighted_dot = alpha + h * theta, alpha_dot + h * theta_dot
        w = self._c * alpha + k * share * weighted
        w_dot = self._c * alpha_dot + k * (slope * alpha_dot * weighted + share * weighted_dot)
        return (sign * k * e * c, w), (sign * v_dot, w_dot)

    def _limited(
        self, v2: tuple[Component, Component], v2_dot: tuple[Component, Component]
    ) -> tuple[tuple[Component, Component], tuple[Component, Component]]:
        """Inputs slowed below the limits along the same path, and their rates."""
        (v, w), (v_dot, w_dot), (fast, turning) = v2, v2_dot, self.max_speed
        scale = np.sqrt(1.0 + ((v / fast) * (v / fast) + (w / turning) * (w / turning)))
        slows = (v * v_dot / fast**2 + w * w_dot / turning**2) / scale / scale
        return (v / scale, w / scale), ((v_dot - v * slows) / scale, (w_dot - w * slows) / scale)


def _choose(condition: np.ndarray, one: Component, other: Component) -> Component:
    """One value where a condition holds, else the other one; of one vehicle without the cost of arrays."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, one, other)
    return one if condition else other


def _vectors(*entries: Component) -> np.ndarray:
    """Vector (k,) of numbers, or vectors (B, k) of arrays (B,)."""
    return (
        np.ascontiguousarray(np.array(np.broadcast_arrays(*entries), dtype=float).T)
        if any(isinstance(entry, np.ndarray) for entry in entries)
        else np.array(entries, dtype=float)
    )
