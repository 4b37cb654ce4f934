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
from rnc_pin.model.evaluation_results import Measurement


class DrivingState(NamedTuple):
    """State of the stabiliser: waiting, resting or driving, and the driving direction."""

    since: float
    """Time of the last start [s]; NaN while it waits."""
    resting: bool = False
    backwards: bool = False


class UnicycleStabilizer(DescribedMixin):
    """Controller that drives a unicycle (forward speed, yaw) to a pose, from any other pose.

    Aicardi and others have this law, with V as above, forwards or backwards: the direction with less turning. The
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
        # The angles have to decay before the distance: at the goal the line of sight has no direction.
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
        """Return the waiting state.

        Args:
            measurement: first measurement.
        """
        self._pose(measurement)
        return DrivingState(np.nan)

    def step(self, t: float, measurement: Measurement, state: DrivingState) -> tuple[VelocityTarget, DrivingState]:
        pose, v2 = self._pose(measurement), np.asarray(measurement.v2, dtype=float)
        state = self._updated(t, pose, v2, state)
        x1, x2 = np.full(measurement.x1.shape, np.nan), np.full(2, np.nan)
        x1[self.position], x2[1] = self.goal[:2], self.goal[2]
        if np.isnan(state.since) or state.resting:
            return VelocityTarget(np.zeros(2), np.zeros(2), x1, x2), state
        desired, rates = self._limited(*self._law(self._polar_pose(pose, state.backwards), v2, state.backwards))
        since = t - state.since
        if since < self.ramp_time:
            share, growth = since / self.ramp_time, 1.0 / self.ramp_time
            # The rate of a product: without the second term, the inner loop would lag behind the ramp.
            desired, rates = share * desired, share * rates + growth * desired
        return VelocityTarget(desired, rates, x1, x2), state

    def _pose(self, measurement: Measurement) -> tuple[float, float, float]:
        """Position in the goal's axes, and the heading relative to the goal's in (-pi, pi]."""
        dx, dy = measurement.x1[self.position] - self.goal[:2]
        c, s = np.cos(self.goal[2]), np.sin(self.goal[2])
        pose = float(c * dx + s * dy), float(c * dy - s * dx), float(wrapped(measurement.x2[1] - self.goal[2]))
        if not np.isfinite(pose).all():
            raise InputError("the vehicle's position and heading have to be given in x1 and x2")
        return pose

    def _updated(self, t: float, pose: tuple[float, float, float], v2: np.ndarray, state: DrivingState) -> DrivingState:
        """New state: waiting, resting or driving, and the driving direction."""
        if t < self.begin:
            return state
        off = max(np.hypot(pose[0], pose[1]), abs(pose[2]))
        if off < self.tolerance and np.abs(v2).max() < self.tolerance:
            return DrivingState(t, True, state.backwards)
        wake_factor = 2.0  # times the tolerance: hysteresis, so that noise at the tolerance starts no motion
        if state.resting and off < wake_factor * self.tolerance:
            return state
        ways = [self._polar_pose(pose, way) for way in (False, True)]
        forth, back = (alpha**2 + self._h * theta**2 for _, alpha, theta in ways)  # angle terms of 2 V
        if np.isnan(state.since) or state.resting:
            return DrivingState(t, False, back < forth)
        now, other = (back, forth) if state.backwards else (forth, back)
        reversal_ratio = 0.5  # of the angle terms of V, after to before: hysteresis of the driving direction
        return state._replace(backwards=state.backwards != (other < reversal_ratio * now))

    def _polar_pose(self, pose: tuple[float, float, float], backwards: bool) -> tuple[float, float, float]:
        """Coordinates (e, alpha, theta) of the law; for backward driving, both headings turn by pi."""
        x, y, heading = pose
        e = float(np.hypot(x, y))
        if e < self.tolerance / 2:  # at the goal, except for the heading
            return 0.0, -heading, 0.0
        bearing, about = np.arctan2(-y, -x), np.pi if backwards else 0.0
        return e, float(wrapped(bearing - heading - about)), float(wrapped(bearing - about))

    def _law(self, polar: tuple[float, float, float], v2: np.ndarray, backwards: bool) -> tuple[np.ndarray, np.ndarray]:
        """Inputs (v, w) of the law, and their rates while the vehicle moves at v2."""
        (e, alpha, theta), k, h, sign = polar, self.k, self._h, -1.0 if backwards else 1.0
        speed, turn = sign * v2[0], v2[1]
        c, s = np.cos(alpha), np.sin(alpha)
        # Closer than ``tolerance``, bound the rate of the line of sight: the vehicle is about to rest.
        theta_dot = speed * s * e / max(e, self.tolerance) ** 2
        alpha_dot = theta_dot - turn
        v_dot = k * (-speed * c * c - e * s * alpha_dot)
        series_angle = 1e-3  # alpha [rad] below which quotients by alpha use their series
        if abs(alpha) < series_angle:
            share, slope = 1.0 - 2.0 / 3.0 * alpha**2, -4.0 / 3.0 * alpha
        else:
            share = c * s / alpha  # cos(alpha) sinc(alpha)
            slope = (np.cos(2 * alpha) - share) / alpha
        weighted, weighted_dot = alpha + h * theta, alpha_dot + h * theta_dot
        w = self._c * alpha + k * share * weighted
        w_dot = self._c * alpha_dot + k * (slope * alpha_dot * weighted + share * weighted_dot)
        return np.array([sign * k * e * c, w]), np.array([sign * v_dot, w_dot])

    def _limited(self, v2: np.ndarray, v2_dot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inputs slowed below the limits along the same path, and their rates."""
        used = v2 / self.max_speed
        # A smooth bound: a hard limit would make the desired rate jump.
        scale = np.sqrt(1.0 + used @ used)
        slows = used @ (v2_dot / self.max_speed) / scale**2
        return v2 / scale, (v2_dot - v2 * slows) / scale
