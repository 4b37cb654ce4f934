"""Braking motions of a program in inputs: rolled out on the model, before a sample is executed.

A state is *safe* if its braking motion keeps all limits until rest, and if efforts can hold the robot there. A program
that only enters safe states never meets limits that it cannot keep: at each sample, the braking motion that was
verified one sample before is left. This is a predictive safety filter with a backup law (K. P. Wabersich and
M. N. Zeilinger, Automatica 129 (2021) 109597). The backup law removes as much kinetic energy in each sample as limits
allow, so its stopping distance follows from load and effort along the whole motion, without a bound on either.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import DivergenceError, SingularityError

_KEPT = 1e-7  # [rad, m, and per second] excess over a limit that is rounding
_REST = 1e-6  # [rad/s, m/s] speed that counts as rest


class BrakedSample(NamedTuple):
    """Sample of a braking motion on the model."""

    T: Float[Array, " p"]
    q: Float[Array, " nq"]
    """Configuration at its end."""
    v2: Float[Array, " r"]
    """Reduced velocity at its end."""
    speed: float
    """Largest entry of the full velocity at its end [rad/s, m/s]."""
    exceeded: Float[Array, " k"]
    """Amount by which its end exceeds each limit."""


class BrakingMotion(NamedTuple):
    """Braking motion from a state."""

    T: Float[Array, " p"]
    """Inputs of its first sample; empty if the model is singular there."""
    v2: Float[Array, " r"]
    """Reduced velocity at the end of its first sample."""
    exceeded: Float[Array, " k"]
    """Amount by which the end of its first sample exceeds each limit."""
    problem: str | None
    """What it does not keep; None if all limits hold until rest."""


class BrakingCount(NamedTuple):
    """Samples of a run in which braking motions took effect, or in which none was verified."""

    braked: int = 0
    """Samples that executed a braking motion in place of the program."""
    first: float | None = None
    """Time of the first one [s]."""
    reason: str = ""
    """What the program would not have kept at that time."""
    unverified: int = 0
    """Samples without a verified braking motion: the program went on."""
    unverified_first: float | None = None
    """Time of the first one [s]."""
    problem: str = ""
    """What the braking motion did not keep at that time."""

    def with_braked(self, t: float, reason: str) -> BrakingCount:
        """Count one more sample that brakes."""
        first = (t, reason) if self.first is None else (self.first, self.reason)
        return self._replace(braked=self.braked + 1, first=first[0], reason=first[1])

    def with_unverified(self, t: float, problem: str) -> BrakingCount:
        """Count one more sample without a verified braking motion."""
        first = (t, problem) if self.unverified_first is None else (self.unverified_first, self.problem)
        return self._replace(unverified=self.unverified + 1, unverified_first=first[0], problem=first[1])


def kept(exceeded: Array, before: Array) -> Array:
    """Mask (k,) of the limits that hold, or that a state exceeds no more than the one before."""
    return np.asarray(exceeded <= np.maximum(before, _KEPT))


def braking_motion(
    braked: Callable[[float, Array, Array], BrakedSample],
    names: Sequence[str],
    state: tuple[float, Array, Array],
    before: Array,
    dt: float,
    longest: float,
) -> BrakingMotion:
    """Roll out the braking motion from a state until rest.

    Args:
        braked: sample from time, configuration and reduced velocity.
        names: names of the limits (k,).
        state: time [s], configuration (nq,) and reduced velocity (r,) at its start.
        before: amount by which the state exceeds each limit (k,). A motion that does not increase it is verified too:
            a joint beyond its limit may rest or return.
        dt: duration of a sample [s].
        longest: longest braking motion [s].
    """
    t, q, v2 = state
    first, rests = BrakedSample(np.zeros(0), q, v2, np.inf, before), False
    for number in range(max(1, round(longest / dt)) + 1):
        try:
            sample = braked(t, q, v2)
        except (SingularityError, DivergenceError) as error:
            return BrakingMotion(first.T, first.v2, first.exceeded, str(error))
        first = first if number else sample
        holds = kept(sample.exceeded, before)
        if not holds.all():
            worst = int(np.argmin(holds))
            problem = f"{names[worst]} gives way by {sample.exceeded[worst]:.2g}"
            return BrakingMotion(first.T, first.v2, first.exceeded, problem)
        rested, rests = rests, sample.speed <= _REST
        if rested and rests:  # efforts hold the robot: it was at rest before this sample too
            return BrakingMotion(first.T, first.v2, first.exceeded, None)
        t, q, v2 = t + dt, sample.q, sample.v2
    problem = f"the robot does not come to rest within {longest:g} s"
    return BrakingMotion(first.T, first.v2, first.exceeded, problem)
