"""Which measurements can be true."""

from __future__ import annotations

from math import isfinite
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.loop.loop_state import LoopState
from rnc_pin.loop.velocity import VelocityEstimate, VelocityEstimator
from rnc_pin.robots.robot import Robot

_UNIT = 0.1  # by which a (cos, sin) pair or quaternion may miss unit length before it counts as no measurement


class ImpossibleError(Exception):
    """A measurement that cannot be true; says why."""


class Taken(NamedTuple):
    """What is taken of a measurement."""

    q: Float[Array, " nq"]
    """With pairs and quaternions of unit length."""
    v: Float[Array, " nv"]
    """As it was measured, or estimated."""
    motion: VelocityEstimate | None
    """The state of the estimate."""


class Guard:
    """Looks at measurements once, at a cost that does not depend on what they are.

    Args:
        robot: whose configurations they are.
        fastest: speed beyond which a velocity, or the way between two configurations, cannot be true [rad/s, m/s].
        estimator: makes velocities of configurations; None where they are measured.
    """

    def __init__(self, robot: Robot, fastest: float, estimator: VelocityEstimator | None) -> None:
        self._robot, self._fastest, self._estimator = robot, fastest, estimator

    def take(self, before: LoopState, t: float, q: Any, v: Any) -> Taken:
        """What a measurement says.

        Args:
            before: what the loop remembers.
            t: when [s].
            q, v: as they came; v is not read where it is estimated.

        Raises:
            ImpossibleError: it cannot be true.
        """
        if not is_time(t):
            raise ImpossibleError(f"time is {t!r}")
        elapsed = None if before.time is None else t - before.time
        if elapsed is not None and elapsed <= 0:
            raise ImpossibleError(f"time stands still or runs backwards: {t:g} s after {before.time:g} s")
        q = self._unit(_numbers("q", q, self._robot.nq))
        if elapsed is not None and before.q is not None:
            speed = np.abs(pin.difference(self._robot.model, before.q, q)).max(initial=0.0) / elapsed
            if not speed < self._fastest:
                raise ImpossibleError(
                    f"q jumped: {speed:.3g} rad/s or m/s from the last one, expected less than {self._fastest:g}"
                )
        if self._estimator is None:
            return Taken(q, self._velocity(v), None)
        if before.motion is None or elapsed is None:
            motion = self._estimator.start(q)
        else:
            motion = self._estimator.step(before.motion, q, elapsed)
        return Taken(q, motion.v, motion)

    def _unit(self, q: Array) -> Array:
        unit: Array = pin.normalize(self._robot.model, q)
        if not np.abs(unit - q).max(initial=0.0) < _UNIT:
            raise ImpossibleError("q holds a (cos, sin) pair or a quaternion that is not of unit length")
        return unit

    def _velocity(self, v: Any) -> Array:
        if v is None:
            raise ImpossibleError("v is missing: velocity='filtered' or 'observer' takes it from q")
        v = _numbers("v", v, self._robot.nv)
        fastest = np.abs(v).max(initial=0.0)
        if not fastest < self._fastest:
            raise ImpossibleError(f"v reaches {fastest:.3g} rad/s or m/s, expected less than {self._fastest:g}")
        return v


def is_time(t: Any) -> bool:
    """Whether something is a finite number."""
    try:
        return isfinite(t)
    except (TypeError, ValueError, OverflowError):
        return False


def _numbers(name: str, value: Any, size: int) -> Array:
    try:
        numbers = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ImpossibleError(f"{name} is not made of numbers") from None
    if numbers.shape != (size,):
        raise ImpossibleError(f"{name} has shape {numbers.shape}, expected ({size},)")
    if not isfinite(sum(numbers.tolist())):
        raise ImpossibleError(f"{name}[{int(np.flatnonzero(~np.isfinite(numbers))[0])}] is not finite")
    return numbers
