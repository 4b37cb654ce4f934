"""Pose of a base on wheels from encoders, a gyroscope and pose fixes: an invariant Kalman filter on SE(2)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.control.controller import DescribedMixin, elapsed_time
from rnc_pin.control.wheeled_base import WheelOdometry, composed
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.model.coordinates import arc_chord, wrapped
from rnc_pin.model.input_validation import ArrayInput, vector
from rnc_pin.model.parameter_types import is_number

_SYMMETRIC = 1e-9  # accepted asymmetry of a covariance, relative to its size


class PoseEstimate(NamedTuple):
    """State of the filter."""

    time: float
    """Time of the last prediction [s]."""
    q: Float[Array, " nq"]
    """Configuration of the last prediction, with the positions of the joints."""
    pose: Float[Array, " 3"]
    """(x, y, heading) of the frame [m, m, rad]; the heading is not wrapped."""
    bias: float
    """Bias of the gyroscope [rad/s]."""
    covariance: Float[Array, "4 4"]
    """Covariance of the error: (forward, left, turn) in the axes of the estimated frame, and the bias."""

    def error(self, pose: ArrayInput) -> Float[Array, " 3"]:
        """Return (forward, left, turn): the motion that leads from the estimate to another pose.

        ``e @ inv(covariance[:3, :3]) @ e`` of the true pose is chi-square distributed, with three degrees of freedom.

        Args:
            pose: (x, y, heading) of the frame [m, m, rad].
        """
        return _between(self.pose, vector(pose, 3, "pose"))


class PoseFix(NamedTuple):
    """Result of a correction."""

    estimate: PoseEstimate
    """Estimate after the correction, or as before if the fix was refused."""
    innovation: Float[Array, " k"]
    """Measured minus predicted pose, in the axes of the frame."""
    distance: float
    """Squared innovation in standard deviations: chi-square distributed."""
    accepted: bool
    """True if the fix was used."""


class PoseFilter(DescribedMixin):
    """Kalman filter of a base's pose whose process model is the reduced kinematics.

    The rows ``A v = 0`` turn motions of the encoders into motions of the base. Slip of the rows and noise of the
    encoders disturb it. The error is a motion in the axes of the frame (left-invariant): its covariance does not
    depend on the estimated pose. A gyroscope with a slowly varying bias corrects the turn of each step.

    Noise is white. Its densities are standard deviations after one second, and grow with the square root of the time.
    Angles of steering joints are exact.

    Args:
        odometry: motion of the base from the encoders.
        slip: density of the slip of each row [m/sqrt(s)].
        encoder: density of the motion of each measured joint [rad/sqrt(s) or m/sqrt(s)].
        gyro: density of the gyroscope [rad/sqrt(s)]; None without one.
        bias: density of the change of its bias [rad/s/sqrt(s)].
        gate: probability of a true fix to be used; others are refused as outliers.

    Raises:
        ConfigurationError: a density is negative, all are zero, or the gate is not a probability.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> reduced = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"]).reduce()
        >>> filter = rnc.control.PoseFilter(rnc.control.WheelOdometry(reduced, "base"), slip=0.01)
        >>> estimate = filter.initial_state(0.0, robot.configuration(), [0.0, 0.0, 0.0])
        >>> moved = robot.configuration({"left_wheel_joint": 2.0, "right_wheel_joint": 2.0})
        >>> estimate = filter.predict(1.0, moved, estimate)
        >>> fix = filter.correct([0.23, 0.0], np.diag([1e-4, 1e-4]), estimate)
        >>> estimate.pose.round(3), fix.estimate.pose.round(3), fix.accepted
        (array([0.2, 0. , 0. ]), array([0.21, 0.  , 0.  ]), True)
    """

    described = ("frame", "slip", "encoder", "gyro", "bias", "gate")

    def __init__(
        self,
        odometry: WheelOdometry,
        slip: float,
        encoder: float = 0.0,
        gyro: float | None = None,
        bias: float = 0.0,
        gate: float = 0.999,
    ) -> None:
        for name, value in (("slip", slip), ("encoder", encoder), ("gyro", gyro or 0.0), ("bias", bias)):
            if not (np.isfinite(value) and value >= 0):
                raise ConfigurationError(f"{name}: expected a density of at least zero, found {value}")
        if not slip and not encoder:
            raise ConfigurationError("slip and encoder: expected one of them above zero, else the motion has no error")
        if gyro is not None and not gyro:
            raise ConfigurationError("gyro: expected a density above zero, or None without a gyroscope")
        if not 0 < gate < 1:
            raise ConfigurationError(f"gate: expected a probability between 0 and 1, found {gate}")
        self._odometry, self.frame, self.slip, self.encoder = odometry, odometry.frame, float(slip), float(encoder)
        self.gyro, self.bias, self.gate = gyro, float(bias), float(gate)

    def initial_state(
        self,
        t: float,
        q: Float[Array, " nq"],
        pose: ArrayInput,
        covariance: Float[Array, "4 4"] | None = None,
    ) -> PoseEstimate:
        """Return the first estimate.

        Args:
            t: time [s].
            q: configuration (nq,) with the positions of the joints.
            pose: (x, y, heading) of the frame [m, m, rad].
            covariance: of the error and of the bias, (4, 4); None for an exact first pose and no bias.

        Raises:
            InputError: an array has another shape, is not finite, or is no covariance.
        """
        first = np.zeros((4, 4)) if covariance is None else _covariance(covariance, 4)
        return PoseEstimate(float(t), np.array(q, dtype=float), vector(pose, 3, "pose"), 0.0, first)

    def predict(
        self, t: float, q: Float[Array, " nq"], state: PoseEstimate, turn_rate: float | None = None
    ) -> PoseEstimate:
        """Return the estimate after a step of the encoders.

        Args:
            t: time [s].
            q: configuration (nq,) with the positions of the joints; the place of the base does not matter.
            state: the last estimate.
            turn_rate: mean of the gyroscope over the step [rad/s]; None if there is none.

        Raises:
            InputError: time runs backwards, an array has another shape, or a number is not finite.
            ConfigurationError: a turn rate, and no density of a gyroscope.
        """
        elapsed = elapsed_time(t, state.time)
        if turn_rate is not None and self.gyro is None:
            raise ConfigurationError("a turn rate was measured: give the density 'gyro' of the gyroscope")
        if turn_rate is not None and not is_number(turn_rate):
            raise InputError(f"turn_rate: expected a finite number, found {turn_rate!r}")
        step = self._odometry.increment(state.q, q)
        noise = self.encoder**2 * step.by_joints @ step.by_joints.T + self.slip**2 * step.by_rows @ step.by_rows.T
        spread = np.zeros((7, 7))  # of the error, of the bias, and of the motion
        spread[:4, :4], spread[4:, 4:] = state.covariance, elapsed * noise
        mean = np.zeros(7)
        if turn_rate is not None and self.gyro is not None and elapsed > 0:
            # The gyroscope measures the true turn of the step: that of the encoders plus its error, and the bias.
            H = np.zeros((1, 7))
            H[0, 3], H[0, 6] = elapsed, 1.0
            left = elapsed * (turn_rate - state.bias) - step.motion[2]
            mean, spread = _updated(spread, H, np.array([left]), np.array([[self.gyro**2 * elapsed]]))
        motion = step.motion + mean[4:]
        pose = composed(composed(state.pose, mean[:3]), motion)
        to_error = np.zeros((4, 7))
        to_error[:3, :3], to_error[:3, 4:] = _step_derivatives(motion)
        to_error[3, 3] = 1.0
        covariance = to_error @ spread @ to_error.T
        covariance[3, 3] += self.bias**2 * elapsed
        return PoseEstimate(float(t), np.array(q, dtype=float), pose, state.bias + float(mean[3]), covariance)

    def correct(self, fix: ArrayInput, covariance: Float[Array, "k k"], state: PoseEstimate) -> PoseFix:
        """Return the estimate after a measured pose or position.

        Args:
            fix: (x, y, heading) of the frame, or (x, y) without a heading [m, m, rad].
            covariance: covariance of the fix in the axes of the world, (k, k).
            state: the last estimate.

        Raises:
            InputError: the fix has neither two nor three finite numbers, or its covariance is none.
        """
        measured = np.asarray(fix, dtype=float)
        if measured.shape not in ((2,), (3,)) or not np.isfinite(measured).all():
            raise InputError(f"fix: expected (x, y) or (x, y, heading), found {fix}")
        size = len(measured)
        turn = _rotation(state.pose[2])[:size, :size]
        noise = turn.T @ _covariance(covariance, size) @ turn
        innovation = turn.T @ (measured - state.pose[:size])
        H = np.eye(size, 4)
        if size == 3:
            innovation[2] = wrapped(innovation[2])
            motion = _between(state.pose, measured)
            # Noise of the position moves the pose in the axes of the frame, and the error by the inverse Jacobian.
            to_motion = np.linalg.inv(_step_derivatives(motion)[1]) @ _rotation(-motion[2])
            noise, left = to_motion @ noise @ to_motion.T, motion
        else:
            left = innovation
        total = H @ state.covariance @ H.T + noise
        distance = float(left @ np.linalg.solve(total, left))
        if distance > scipy.stats.chi2.ppf(self.gate, size):
            return PoseFix(state, innovation, distance, False)
        mean, spread = _updated(state.covariance, H, left, noise)
        pose = composed(state.pose, mean[:3])
        reset = np.eye(4)
        reset[:3, :3] = _step_derivatives(mean[:3])[1]
        estimate = state._replace(
            pose=pose, bias=state.bias + float(mean[3]), covariance=_symmetric(reset @ spread @ reset.T)
        )
        return PoseFix(estimate, innovation, distance, True)


def _updated(P: Array, H: Array, left: Array, noise: Array) -> tuple[Array, Array]:
    """Mean and covariance of an error after a measurement ``left = H error + noise`` (Joseph's form)."""
    gain = np.linalg.solve(H @ P @ H.T + noise, H @ P).T
    rest = np.eye(len(P)) - gain @ H
    return gain @ left, _symmetric(rest @ P @ rest.T + gain @ noise @ gain.T)


def _symmetric(matrix: Array) -> Array:
    return np.asarray((matrix + matrix.T) / 2)


def _covariance(given: Array, size: int) -> Array:
    matrix = np.asarray(given, dtype=float)
    if matrix.shape != (size, size) or not np.isfinite(matrix).all():
        raise InputError(f"covariance: expected finite numbers ({size}, {size}), found shape {matrix.shape}")
    limit = _SYMMETRIC * np.abs(matrix).max(initial=0.0)
    if np.abs(matrix - matrix.T).max() > limit or np.linalg.eigvalsh(matrix)[0] < -limit:
        raise InputError("covariance: expected a symmetric matrix without negative eigenvalues")
    return matrix


def _rotation(turn: float) -> Array:
    """Rotation (3, 3) of a planar motion."""
    c, s = np.cos(turn), np.sin(turn)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _between(first: Array, last: Array) -> Array:
    """Constant twist (3,) over unit time, in the axes of the first pose, that leads to the last one."""
    turn = float(wrapped(last[2] - first[2]))
    x, y = (_rotation(first[2]).T @ (last - first))[:2]
    along, across = arc_chord(turn)
    square = along**2 + across**2
    return np.array([(along * x + across * y) / square, (along * y - across * x) / square, turn])


def _bracket(motion: Array) -> Array:
    """Matrix (3, 3) of the Lie bracket with a planar motion."""
    x, y, turn = motion
    return np.array([[0.0, -turn, y], [turn, 0.0, -x], [0.0, 0.0, 0.0]])


def _step_derivatives(motion: Array) -> tuple[Array, Array]:
    """Derivatives (3, 3) of the pose behind a motion: ``Ad`` of its inverse, by an error in front of it, and the right
    Jacobian J, by the motion: ``Exp(m + d) = Exp(m) Exp(J d)`` for small d.
    """
    both = np.zeros((6, 6))
    both[:3, :3], both[:3, 3:] = -_bracket(motion), np.eye(3)
    found = scipy.linalg.expm(both)  # J is the integral of exp(-s ad) over s from 0 to 1
    return found[:3, :3], found[:3, 3:]
