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

_KEPT = 1e-8  # [rad, m, and per second] excess over a limit that is rounding
_SHARE = 0.5  # of the program's inputs beside those of a braking motion
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

    first: BrakedSample
    """Its first sample; without inputs if the model is singular there."""
    problem: str | None
    """Reason why it does not keep all limits until rest; None if it does."""


class BrakingCount(NamedTuple):
    """Samples of a run in which braking motions took effect, or in which none was verified."""

    braked: int = 0
    """Samples that executed a braking motion in place of the program."""
    first: float | None = None
    """Time of the first one [s]."""
    reason: str = ""
    """Reason why the program gave way at that time."""
    unverified: int = 0
    """Samples without a verified braking motion: the program went on."""
    unverified_first: float | None = None
    """Time of the first one [s]."""
    problem: str = ""
    """Reason why no braking motion was verified at that time."""

    def with_braked(self, t: float, reason: str) -> BrakingCount:
        """Count one more sample that brakes."""
        first = (t, reason) if self.first is None else (self.first, self.reason)
        return self._replace(braked=self.braked + 1, first=first[0], reason=first[1])

    def with_unverified(self, t: float, problem: str) -> BrakingCount:
        """Count one more sample without a verified braking motion."""
        first = (t, problem) if self.unverified_first is None else (self.unverified_first, self.problem)
        return self._replace(unverified=self.unverified + 1, unverified_first=first[0], problem=first[1])


class Braking:
    """Braking motions of one program.

    Args:
        braked: sample of the braking motion from time, configuration and reduced velocity.
        names: names of the limits (k,).
        dt: duration of a sample [s].
        longest: longest braking motion [s].
    """

    def __init__(
        self, braked: Callable[[float, Array, Array], BrakedSample], names: Sequence[str], dt: float, longest: float
    ) -> None:
        self._braked, self._names, self._dt, self._longest = braked, names, dt, longest

    def decide(
        self,
        state: tuple[float, Array, Array],
        before: Array,
        planned: BrakedSample,
        under: Callable[[Array], BrakedSample],
        count: BrakingCount,
    ) -> tuple[BrakedSample, BrakingCount]:
        """Return the sample to execute, and the count with it.

        It is the planned one if a braking motion follows it; otherwise the braking motion of this state, or half of
        the way between both. Without a verified motion, it is the planned one.

        Args:
            state: time [s], configuration (nq,) and reduced velocity (r,) at its start.
            before: amount by which the state exceeds each limit (k,).
            planned: sample of the program.
            under: sample under given inputs (p,).
            count: samples so far.
        """
        t = state[0]
        problem = self._problem_after(t, planned, before)
        if problem is None:
            return planned, count
        first, unkept = self.motion(*state, before)
        if unkept is not None:
            return planned, count.with_unverified(t, unkept)
        mixed = under(first.T + _SHARE * (planned.T - first.T))  # otherwise the robot stops and goes
        chosen = first if self._problem_after(t, mixed, before) else mixed
        return chosen, count.with_braked(t, problem)

    def motion(self, t: float, q: Array, v2: Array, before: Array) -> BrakingMotion:
        """Roll out the braking motion from a state until rest.

        Args:
            t: time [s].
            q: configuration (nq,).
            v2: reduced velocity (r,).
            before: amount by which the state exceeds each limit (k,). A motion that does not increase it is verified
                too: a joint beyond its limit may rest or return.
        """
        first, rests = BrakedSample(np.zeros(0), q, v2, np.inf, before), False
        for number in range(max(1, round(self._longest / self._dt)) + 1):
            try:
                sample = self._braked(t, q, v2)
            except (SingularityError, DivergenceError) as error:
                return BrakingMotion(first, str(error))
            first = first if number else sample
            broken = self._broken(sample, before)
            if broken is not None:
                return BrakingMotion(first, broken)
            rested, rests = rests, sample.speed <= _REST
            if rested and rests:  # efforts hold the robot: it was at rest before this sample too
                return BrakingMotion(first, None)
            t, q, v2 = t + self._dt, sample.q, sample.v2
        return BrakingMotion(first, f"the robot does not come to rest within {self._longest:g} s")

    def _problem_after(self, t: float, reached: BrakedSample, before: Array) -> str | None:
        """First limit that a sample exceeds itself, or that no braking motion after it keeps; None if all hold."""
        broken = self._broken(reached, before)
        return broken or self.motion(t + self._dt, reached.q, reached.v2, before).problem

    def _broken(self, sample: BrakedSample, before: Array) -> str | None:
        """First limit that a sample exceeds more than the state before."""
        beyond = sample.exceeded > np.maximum(before, _KEPT)
        if not beyond.any():
            return None
        worst = int(np.argmax(beyond))
        return f"{self._names[worst]} gives way by {sample.exceeded[worst]:.2g}"
