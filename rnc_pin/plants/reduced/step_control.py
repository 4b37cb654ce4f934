"""Control of the integration error of a plant: the number of substeps of each sample, and the error that remains.

An estimate by comparison with twice as many substeps is reliable, but it costs two more integrations. So only some
samples are compared. In between, the stages of the Runge-Kutta steps show by their roughness how the error changes.
All decisions depend on the motion of one run only, so that a run gives the same bits alone and in a batch.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
from numpy import ndarray as Array

from rnc_pin.errors import InputError
from rnc_pin.model.parameter_types import is_count, is_number

MOST_SUBSTEPS = 1024
"""Largest number of substeps that a plant chooses."""
MOST_EVENT_SUBSTEPS = 16
"""The same with friction, where the error at an event falls slowly with the step."""

_PERIOD = 128  # samples after which a comparison is due
_PAUSE = 32  # samples after a comparison without another one, unless the tolerance needs it
_GROWTH = 4.0  # error of a sample over the last compared one, from which a comparison is due
_ORDER_4 = 16.0 / 15.0  # error over its difference from that with half the step
_ORDER_1 = 2.0
_MARGIN = 64.0  # by which the error is below the limit where half the substeps are enough: 16 and a reserve
_ROUNDING = 1e-14  # relative difference that is rounding
_LONGER = 1.5  # duration of a sample over that of the compared one, from which a comparison is due
_LEAST = 1e-60  # roughness of a motion at rest


class Substeps(NamedTuple):
    """Choice of the number of substeps.

    Attributes:
        number: fixed number; None for as many as the tolerance asks for.
        tolerance: largest error that the integration adds in a second [m, rad, m/s or rad/s].
    """

    number: int | None
    tolerance: float

    @classmethod
    def checked(cls, number: object, tolerance: object, plant: str) -> Substeps:
        """Return a valid choice.

        Raises:
            InputError: the number is not a positive integer, or the tolerance not a positive number.
        """
        if number is not None and not is_count(number, 1):
            raise InputError(f"substeps of a {plant} have to be a positive integer, found {number!r}")
        if not (is_number(tolerance) and tolerance > 0):
            raise InputError(f"tolerance of a {plant} has to be a positive number, found {tolerance!r}")
        return cls(None if number is None else int(number), float(tolerance))

    @property
    def followed(self) -> float:
        """Error per second above which a sample is compared; a fixed number does not follow the tolerance."""
        return self.tolerance if self.number is None else np.inf


class IntegrationErrors(NamedTuple):
    """Estimated errors of one run, and the choice of substeps. Those of B runs are arrays with a leading axis.

    Errors are ``[e_q, e_v]`` (2 nv,): e_q in the tangent space of the configuration [m or rad], e_v of the velocity
    [m/s or rad/s], both of free, planar and spherical joints along the axes before the joint. ``past`` and ``largest``
    are of absolute values.

    Attributes:
        steps, used: substeps of the next and of the last sample.
        age: samples since the last comparison.
        weight, moment: sums of the shares since then, and of the shares times their time.
        peak: largest share since then; a share is the error of a sample over that of the compared one.
        time: time of the run [s].
        roughness: roughness of the compared sample.
        pattern: errors (2 nv,) of the compared sample.
        size: largest absolute value of these, at least rounding.
        span: duration of the compared sample [s].
        since: time of the last comparison [s].
        past: errors (2 nv,) accumulated until the last comparison.
        largest: largest errors (2 nv,) of a sample until then.
        rate: largest error per second of a compared sample, on any entry.
        most: largest number of substeps so far.
        enough: number of substeps that the tolerance asks for.
    """

    steps: int
    used: int
    age: int
    weight: float
    moment: float
    peak: float
    time: float
    roughness: float
    pattern: Array
    size: float
    span: float
    since: float
    past: Array
    largest: Array
    rate: float
    most: int
    enough: int

    @classmethod
    def initial(cls, nv: int, substeps: Substeps) -> IntegrationErrors:
        """Return the errors at the start of a run."""
        none, steps = np.zeros(2 * nv), substeps.number or 1
        return IntegrationErrors(
            steps, steps, _PERIOD, 0.0, 0.0, 0.0, 0.0, 0.0, none, 0.0, 0.0, 0.0, none, none, 0.0, steps, 1
        )  # fmt: skip

    def after(self, roughness: float, dt: float, limit: float) -> tuple[bool, IntegrationErrors]:
        """Judge a sample by its roughness.

        Args:
            roughness: roughness of its steps.
            dt: duration of the sample [s].
            limit: largest error that needs no comparison.

        Returns:
            True where the sample needs no comparison, and the errors after it.
        """
        steps, _, age, weight, moment, peak, time, reference = self[:8]
        size, span, rate = self.size, self.span, self.rate
        share = roughness / (reference + _LEAST)  # of drawn motions a better estimate than a power of the ratio
        error, time = share * size, time + dt
        settled = (age < _PAUSE) | (share < _GROWTH) | (error < rate * dt)
        # The error falls faster with the duration than the roughness, and that of a short sample may be below rounding.
        accepted = (error <= limit) & (age < _PERIOD) & settled & (dt <= _LONGER * span)
        larger = max(peak, share) if isinstance(share, float) else cast(float, np.maximum(peak, share))
        return accepted, IntegrationErrors(
            steps, steps, age + 1, weight + share, moment + share * time, larger, time, *self[7:]
        )

    def folded(self) -> IntegrationErrors:
        """Return the errors with ``past`` and ``largest`` at the present time."""
        pattern, nv = np.abs(self.pattern), len(self.pattern) // 2
        position, velocity = pattern[:nv], pattern[nv:]
        before = self.past[nv:]
        past = np.concatenate(
            [
                # An error of the velocity goes on as one of the position.
                self.past[:nv]
                + before * (self.time - self.since)
                + position * self.weight
                + velocity * (self.weight * self.time - self.moment),
                before + velocity * self.weight,
            ]
        )
        largest = np.maximum(self.largest, pattern * self.peak)
        return self._replace(past=past, largest=largest, weight=0.0, moment=0.0, peak=0.0, since=self.time)

    def interrupted(self) -> IntegrationErrors:
        """Return the errors at a jump of the velocity, after which a comparison is due."""
        return self.folded()._replace(age=_PERIOD)

    def compared(
        self, steps: int, roughness: float, errors: tuple[Array, Array], dt: float, substeps: Substeps, enough: int
    ) -> IntegrationErrors:
        """Return the errors after a compared sample with a number of substeps; ``enough`` keep the tolerance.

        ``errors`` are those of the sample (2 nv,) and the rotation (nv, nv) to the axes of a pattern.
        """
        found, axes = errors
        size, limit = float(np.abs(found).max(initial=0.0)), substeps.tolerance * dt
        pattern = (found.reshape(2, -1) @ axes.T).ravel()
        following, again = steps, not roughness < np.inf
        if substeps.number is None and steps > 1 and size * _MARGIN < limit:
            following, again = steps // 2, True
        folded = self.folded()
        time = folded.time + dt
        return folded._replace(
            steps=following, used=steps, age=_PERIOD if again else 0, roughness=roughness, pattern=pattern,
            size=max(size, _ROUNDING), span=dt, rate=max(self.rate, size / dt), most=max(self.most, steps),
            enough=max(self.enough, enough), weight=1.0, moment=time, peak=1.0, time=time,
        )  # fmt: skip

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All quantities of B runs."""
        return cast("tuple[Array, ...]", tuple(self))

    def of_run(self, run: int) -> IntegrationErrors:
        """Errors of one of B runs."""
        return IntegrationErrors._make(each[run].copy() if each.ndim > 1 else each[run].item() for each in self.arrays)

    def write(self, run: int, errors: IntegrationErrors) -> None:
        """Set the errors of one of B runs."""
        for all_runs, one in zip(self.arrays, errors, strict=True):
            all_runs[run] = one

    def selected(self, runs: Array) -> IntegrationErrors:
        """Errors of some of B runs, by their indices or a mask."""
        return IntegrationErrors._make(each[runs] for each in self.arrays)

    def of_runs(self, size: int) -> IntegrationErrors:
        """Errors of B runs that are all these."""
        return IntegrationErrors._make(np.array([each] * size) for each in self)


def difference_errors(position: Array, velocity: Array, smooth: bool) -> Array:
    """Errors (..., 2 nv) of a sample from its difference to the one with twice as many substeps.

    Args:
        position: difference of the configurations (..., nv).
        velocity: difference of the velocities (..., nv).
        smooth: True if the integration is of fourth order.
    """
    return np.concatenate([position, velocity], axis=-1) * (_ORDER_4 if smooth else _ORDER_1)


def above_rounding(errors: Array, scale: float) -> Array:
    """Errors of one sample, zero where they are rounding of states with this largest absolute value."""
    return np.where(np.abs(errors) > _ROUNDING * (1.0 + scale), errors, 0.0)
