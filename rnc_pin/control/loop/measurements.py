"""Measurements of a control loop: velocity estimates from configurations, and validity checks."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Float
from rnc_pin.control.loop.loop_state import LoopState, VelocityEstimate
from rnc_pin.errors import InputError
from rnc_pin.model.input_validation import is_number, numbers_of
from rnc_pin.model.reduced_model import ReducedModel

_UNIT_TOLERANCE = 0.1  # largest deviation of a (cos, sin) pair or quaternion from unit length


class VelocityObserver:
    """Observer of position, velocity and acceleration from configurations, without lag at constant acceleration.

    The fading-memory filter of second order (Morrison, "Introduction to Sequential Smoothing and Prediction", 1969): a
    parabola fitted to the past by least squares, with weights that decay by ``theta = exp(-cutoff dt)`` per sample.
    The observer does not use the inertia. Controllers get the measured position, not the estimated one.

    Args:
        model: Pinocchio model of the configurations.
        cutoff: cutoff frequency [rad/s].
        gap: time between measurements after which the last acceleration says nothing, and the mean velocity counts [s].
    """

    def __init__(self, model: pin.Model, cutoff: float, gap: float = np.inf) -> None:
        self._model, self.cutoff, self._gap = model, cutoff, gap

    def start(self, q: Float[Array, " nq"]) -> VelocityEstimate:
        """Return the initial estimate at q: zero velocity."""
        nothing = np.zeros(self._model.nv)
        return VelocityEstimate(q, nothing, nothing)

    def step(self, motion: VelocityEstimate, q: Float[Array, " nq"], elapsed: float) -> VelocityEstimate:
        """Return the estimate after a new measurement q.

        Args:
            motion: last estimate.
            q: measured configuration (nq,).
            elapsed: time since the last measurement [s].
        """
        if elapsed > self._gap:
            return VelocityEstimate(q, pin.difference(self._model, motion.q, q) / elapsed, np.zeros(self._model.nv))
        theta = np.exp(-self.cutoff * elapsed)
        ahead = motion.v * elapsed + motion.acceleration * (0.5 * elapsed**2)
        expected = pin.integrate(self._model, motion.q, ahead)
        miss = pin.difference(self._model, expected, q)
        v = motion.v + motion.acceleration * elapsed + 1.5 * (1.0 - theta) ** 2 * (1.0 + theta) / elapsed * miss
        acceleration = motion.acceleration + (1.0 - theta) ** 3 / elapsed**2 * miss
        return VelocityEstimate(pin.integrate(self._model, expected, (1.0 - theta**3) * miss), v, acceleration)


# ------------------------------------------------------------------ validity


class InvalidMeasurementError(Exception):
    """Invalid measurement; the message has the reason."""


class ValidMeasurement(NamedTuple):
    """Valid measurement, with the velocity estimate."""

    q: Float[Array, " nq"]
    """Configuration, with (cos, sin) pairs and quaternions normalized."""
    v: Float[Array, " nv"]
    """Measured or estimated velocity."""
    motion: VelocityEstimate | None
    """State of the velocity estimate; None if velocity is measured."""


class Guard:
    """Validity check of measurements. Its cost does not depend on their values.

    Args:
        reduced: model of the robot that is measured.
        max_speed: largest valid speed, of v and of the difference of two configurations over time [rad/s, m/s].
        estimator: velocity estimator; None if velocity is measured.
    """

    def __init__(self, reduced: ReducedModel, max_speed: float, estimator: VelocityObserver | None) -> None:
        self._robot, self._max_speed, self._estimator = reduced.robot, max_speed, estimator

    def check(self, before: LoopState, t: float, q: ArrayLike, v: ArrayLike | None) -> ValidMeasurement:
        """Check a measurement and return it normalized.

        Args:
            before: state of the loop after the last step.
            t: time [s].
            q, v: raw measurement; v is ignored if the loop estimates velocity.

        Raises:
            InvalidMeasurementError: the measurement is invalid.
        """
        if not is_time(t):
            raise InvalidMeasurementError(f"time is {t!r}, expected a finite number")
        elapsed = None if before.time is None else t - before.time
        if elapsed is not None and elapsed <= 0:
            raise InvalidMeasurementError(f"time stands still or runs backwards: {t:g} s after {before.time:g} s")
        q = self._unit(_numbers("q", q, self._robot.nq))
        if elapsed is not None and before.q is not None:
            speed = np.abs(pin.difference(self._robot.model, before.q, q)).max(initial=0.0) / elapsed
            if not speed < self._max_speed:
                raise InvalidMeasurementError(
                    f"q jumped: {speed:.3g} rad/s or m/s from the last one, expected less than {self._max_speed:g}"
                )
        if self._estimator is None:
            return ValidMeasurement(q, self._velocity(v), None)
        if before.motion is None or elapsed is None:
            motion = self._estimator.start(q)
        else:
            motion = self._estimator.step(before.motion, q, elapsed)
        return ValidMeasurement(q, motion.v, motion)

    def _unit(self, q: Array) -> Array:
        unit: Array = pin.normalize(self._robot.model, q)
        if not np.abs(unit - q).max(initial=0.0) < _UNIT_TOLERANCE:
            raise InvalidMeasurementError("q holds a (cos, sin) pair or a quaternion that is not of unit length")
        return unit

    def _velocity(self, v: ArrayLike | None) -> Array:
        if v is None:
            raise InvalidMeasurementError("v is missing: measure it, or use velocity='observer'")
        v = _numbers("v", v, self._robot.nv)
        speed = np.abs(v).max(initial=0.0)
        if not speed < self._max_speed:
            raise InvalidMeasurementError(f"v reaches {speed:.3g} rad/s or m/s, expected less than {self._max_speed:g}")
        return v


def is_time(t: float) -> bool:
    """True if t is a finite number."""
    return is_number(t)


def _numbers(name: str, value: ArrayLike, size: int) -> Array:
    try:
        numbers = numbers_of(value, name)
    except InputError:
        raise InvalidMeasurementError(f"{name} is not made of numbers") from None
    if numbers.shape != (size,):
        raise InvalidMeasurementError(f"{name} has shape {numbers.shape}, expected ({size},)")
    if not isfinite(sum(numbers.tolist())):  # the sum of finite numbers may be too large
        wrong = np.flatnonzero(~np.isfinite(numbers))
        if len(wrong):
            raise InvalidMeasurementError(f"{name}[{int(wrong[0])}] is not finite")
    return numbers
