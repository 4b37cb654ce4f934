"""Point stabilisation of a unicycle: position and heading, from any pose.

M. Aicardi, G. Casalino, A. Bicchi, A. Balestrino, "Closed loop steering of unicycle like vehicles via Lyapunov
techniques", IEEE Robotics & Automation Magazine 2(1) (1995) 27-35. e is the distance to the goal. alpha and theta are
the angles to the line of sight: alpha from the heading, theta from the goal's heading. The inputs

    v = k e cos(alpha),    w = c alpha + k cos(alpha) sinc(alpha) (alpha + h theta)

give ``Vdot = -k e^2 cos^2(alpha) - c alpha^2`` for ``V = (e^2 + alpha^2 + h theta^2) / 2``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin.control.controller import DescribedMixin, VelocityTarget
from rnc_pin.control.gain_design import DEFAULT_OUTER_GAINS
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.model.coordinates import wrapped
from rnc_pin.model.measurement import Measurement

_WAKE_FACTOR = 2.0  # distance or heading error, in multiples of ``tolerance``, at which a resting vehicle starts again
_REVERSAL_RATIO = 0.5  # largest ratio of the angle terms of V, after to before, for a change of driving direction
_SERIES_ANGLE = 1e-3  # alpha [rad] below which quotients by alpha use their series


class DrivingState(NamedTuple):
    """State of the stabiliser: waiting, resting or driving, and the driving direction."""

    mode: np.ndarray
    """Time of the last start [s], NaN while it waits; 1 while it rests; 1 while it drives backwards: (..., 3)."""

    @property
    def since(self) -> np.ndarray:
        """Time of the last start [s], NaN while it waits, (...)."""
        return np.asarray(self.mode[..., 0])

    @property
    def resting(self) -> np.ndarray:
        """True while it rests, (...)."""
        return np.asarray(self.mode[..., 1] == 1.0)

    @property
    def backwards(self) -> np.ndarray:
        """True while it drives backwards, (...)."""
        return np.asarray(self.mode[..., 2] == 1.0)


class _PolarPose(NamedTuple):
    """Poses (B,) in the coordinates of the control law, for forward or backward driving."""

    distance: np.ndarray
    alpha: np.ndarray
    """From the heading to the line of sight (-pi, pi]."""
    theta: np.ndarray
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

    accepts_batches = True
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
        self.tolerance, self.ramp_time, self.max_speed = (
            tolerance,
            ramp_time,
            (float(max_speed[0]), float(max_speed[1])),
        )
        # Near the line of sight the angles have the polynomial s^2 + c s + k^2 h: poles at -rate and -1.2 rate.
        self._c, self._h = 2.2 * rate, 1.2 * rate**2 / k**2

    def initial_state(self, measurement: Measurement) -> DrivingState:
        """Return the waiting state."""
        self._pose(measurement.x1, measurement.x2)
        return DrivingState(np.broadcast_to([np.nan, 0.0, 0.0], (*measurement.x2.shape[:-1], 3)))

    def step(self, t: float, measurement: Measurement, state: DrivingState) -> tuple[VelocityTarget, DrivingState]:
        alone = measurement.x2.ndim == 1  # one state is a stack of one, to the bit
        x1, x2, v2, mode = (
            np.atleast_2d(np.asarray(each, dtype=float))
            for each in (measurement.x1, measurement.x2, measurement.v2, state.mode)
        )
        pose = self._pose(x1, x2)
        mode = self._update_mode(t, pose, v2, mode)
        now = DrivingState(mode)
        since, sign = now.since, np.where(now.backwards, -1.0, 1.0)
        desired, rate = self._limited(*self._law(self._polar_pose(pose, sign), v2, sign))
        ramp, drives = self.ramp_time, np.isfinite(since) & ~now.resting
        starts = drives & (t - since < ramp)
        share = np.where(starts, (t - since) / (ramp or 1.0), 1.0)[:, None]
        growth = np.where(starts, 1.0 / (ramp or 1.0), 0.0)[:, None]
        goals = np.full(x1.shape, np.nan), np.tile([np.nan, self.goal[2]], (len(x2), 1))
        goals[0][:, self.position] = self.goal[:2]
        target = [
            np.where(drives[:, None], share * desired, 0.0),
            np.where(drives[:, None], share * rate + growth * desired, 0.0),
            *goals,
        ]
        v2, v2_dot, x1, x2 = (each[0] for each in target) if alone else target
        return VelocityTarget(v2=v2, v2_dot=v2_dot, x1=x1, x2=x2), DrivingState(mode[0] if alone else mode)

    def _pose(self, x1: np.ndarray, x2: np.ndarray) -> np.ndarray:
        """Positions in the goal's axes, and headings relative to the goal's in (-pi, pi], (3, ...)."""
        dx, dy = (x1[..., place] - goal for place, goal in zip(self.position, self.goal, strict=False))
        c, s = np.cos(self.goal[2]), np.sin(self.goal[2])
        pose = np.array([c * dx + s * dy, c * dy - s * dx, wrapped(x2[..., 1] - self.goal[2])])
        if not np.isfinite(pose).all():
            raise InputError("the vehicle's position and heading have to be given in x1 and x2")
        return pose

    def _update_mode(self, t: float, pose: np.ndarray, v2: np.ndarray, mode: np.ndarray) -> np.ndarray:
        """New modes (B, 3): waiting, resting or driving, and the driving direction."""
        if t < self.begin:
            return mode
        before = DrivingState(mode)
        since, resting, backwards = before.since, before.resting, before.backwards
        off = np.maximum(np.hypot(pose[0], pose[1]), np.abs(pose[2]))
        rests = (off < self.tolerance) & (np.abs(v2).max(axis=1) < self.tolerance)
        stays = ~rests & resting & (off < _WAKE_FACTOR * self.tolerance)
        starts = ~rests & ~stays & (np.isnan(since) | resting)
        forth, back = (self._angle_cost(self._polar_pose(pose, np.full(len(v2), sign))) for sign in (1.0, -1.0))
        now, other = np.where(backwards, back, forth), np.where(backwards, forth, back)
        turns = other < _REVERSAL_RATIO * now
        way = np.where(starts, back < forth, np.where(rests | stays, backwards, backwards != turns))
        return np.column_stack([np.where(rests | starts, t, since), np.where(rests | stays, 1.0, 0.0), way])

    def _polar_pose(self, pose: np.ndarray, sign: np.ndarray) -> _PolarPose:
        """Poses in the coordinates of the law; where the sign is -1, for backward driving, both headings turn by pi."""
        x, y, heading = pose
        about, e = np.where(sign < 0.0, np.pi, 0.0), np.hypot(x, y)
        there = e < self.tolerance / 2  # at the goal, except for the heading
        bearing = np.arctan2(-y, -x)
        alpha = np.where(there, wrapped(-heading), wrapped(bearing - heading - about))
        return _PolarPose(np.where(there, 0.0, e), alpha, np.where(there, 0.0, wrapped(bearing - about)))

    def _angle_cost(self, polar: _PolarPose) -> np.ndarray:
        """Angle terms of 2 V."""
        return np.asarray(polar.alpha**2 + self._h * polar.theta**2)

    def _law(self, polar: _PolarPose, v2: np.ndarray, sign: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inputs (v, w) of the law (B, 2), and their rates while the vehicles move at v2; the sign is the direction."""
        (e, alpha, theta), k, h = polar, self.k, self._h
        speed, turn = sign * v2[:, 0], v2[:, 1]
        c, s = np.cos(alpha), np.sin(alpha)
        # Closer than ``tolerance``, bound the rate of the line of sight: the vehicle is about to rest.
        theta_dot = speed * s * e / np.maximum(e, self.tolerance) ** 2
        alpha_dot = theta_dot - turn
        v_dot = k * (-speed * c * c - e * s * alpha_dot)
        series = np.abs(alpha) < _SERIES_ANGLE
        divisor = np.where(series, 1.0, alpha)
        share = np.where(series, 1.0 - 2.0 / 3.0 * alpha**2, c * s / divisor)  # cos(alpha) sinc(alpha)
        slope = np.where(series, -4.0 / 3.0 * alpha, (np.cos(2 * alpha) - c * s / divisor) / divisor)
        weighted, weighted_dot = alpha + h * theta, alpha_dot + h * theta_dot
        w = self._c * alpha + k * share * weighted
        w_dot = self._c * alpha_dot + k * (slope * alpha_dot * weighted + share * weighted_dot)
        return np.column_stack([sign * k * e * c, w]), np.column_stack([sign * v_dot, w_dot])

    def _limited(self, v2: np.ndarray, v2_dot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inputs (B, 2) slowed below the limits along the same path, and their rates."""
        limits = np.array(self.max_speed)
        scale = np.sqrt(1.0 + np.sum((v2 / limits) ** 2, axis=1))[:, None]
        scale_dot = np.sum(v2 * v2_dot / limits**2, axis=1)[:, None] / scale
        return v2 / scale, (v2_dot - v2 * scale_dot / scale) / scale
