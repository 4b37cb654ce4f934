"""Control of the integration error of a plant: the number of substeps of each sample, and the error that remains.

An estimate by comparison with twice as many substeps is reliable, but it costs two more integrations. So only some
samples are compared. In between, the stages of the Runge-Kutta steps show by their roughness how the error changes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.errors import InputError
from rnc_pin.model.input_validation import is_count, is_number

MOST_SUBSTEPS = 1024
"""Largest number of substeps that a plant chooses."""
MOST_EVENT_SUBSTEPS = 16
"""The same with friction, where the error at an event falls slowly with the step."""

_PERIOD = 128  # samples after which a comparison is due
_ROUNDING = 1e-14  # relative difference that is rounding


class Substeps(NamedTuple):
    """Choice of the number of substeps.

    Attributes:
        number: fixed number; None for as many as the tolerance asks for.
        tolerance: largest error that the integration adds in a second [m, rad, m/s or rad/s].
    """

    number: int | None
    tolerance: float

    @classmethod
    def checked(cls, number: object, tolerance: object) -> Substeps:
        """Return a valid choice.

        Args:
            number: number of substeps that the user gave; None for a free choice.
            tolerance: tolerance that the user gave [m, rad, m/s or rad/s].

        Raises:
            InputError: the number is not a positive integer, or the tolerance not a positive number.
        """
        if number is not None and not is_count(number, 1):
            raise InputError(f"substeps of a plant have to be a positive integer, found {number!r}")
        if not (is_number(tolerance) and tolerance > 0):
            raise InputError(f"tolerance of a plant has to be a positive number, found {tolerance!r}")
        return cls(None if number is None else int(number), float(tolerance))

    @property
    def followed(self) -> float:
        """Error per second above which a sample is compared; a fixed number does not follow the tolerance."""
        return self.tolerance if self.number is None else np.inf


class IntegrationErrors(NamedTuple):
    """Estimated errors of a run, and its choice of substeps. Those of B runs are arrays (B,).

    The error of a sample is the error of its worst entry of configuration and velocity [m, rad, m/s or rad/s].

    Attributes:
        steps, used: substeps of the next and of the last sample.
        age: samples since the last comparison.
        roughness: roughness of the compared sample.
        size: error of the compared sample, at least rounding.
        span: duration of the compared sample [s].
        total: sum of the estimated errors of all samples.
        rate: largest error per second of a compared sample.
        most: largest number of substeps so far.
        enough: number of substeps that the tolerance asks for.
    """

    steps: int
    used: int
    age: int
    roughness: float
    size: float
    span: float
    total: float
    rate: float
    most: int
    enough: int

    @classmethod
    def initial(cls, substeps: Substeps) -> IntegrationErrors:
        """Return the errors at the start of a run.

        Args:
            substeps: choice of the number of substeps.
        """
        # Due for a comparison at once (age): nothing is known of the motion yet.
        steps = substeps.number or 1
        return IntegrationErrors(steps, steps, _PERIOD, 0.0, 0.0, 0.0, 0.0, 0.0, steps, 1)

    def after(self, roughness: float, dt: float, limit: float) -> tuple[bool, IntegrationErrors]:
        """Judge a sample by its roughness.

        Args:
            roughness: roughness of its steps.
            dt: duration of the sample [s].
            limit: largest error that needs no comparison.

        Returns:
            True where the sample needs no comparison, and the errors after it.
        """
        # Arithmetic alone, without branches: the same lines judge one run and arrays of runs.
        steps, _, age, reference, size, span, total = self[:7]
        least = 1e-60  # roughness of a motion at rest: no division by zero
        # The ratio to the roughness of the compared sample estimates drawn motions better than a power of the ratio.
        share = roughness / (reference + least)
        error = share * size
        pause = 32  # samples after a comparison without another one, unless the tolerance needs it
        growth = 4.0  # error of a sample over the compared one, from which a comparison is due
        settled = (age < pause) | (share < growth) | (error < self.rate * dt)
        longer = 1.5  # duration over the compared sample's, from which a comparison is due
        # The error falls faster with the duration than the roughness, and the error of a short sample may be below
        # rounding.
        accepted = (error <= limit) & (age < _PERIOD) & settled & (dt <= longer * span)
        return accepted, IntegrationErrors(
            steps, steps, age + 1, reference, size, span, total + error, self.rate, self.most, self.enough
        )

    def interrupted(self) -> IntegrationErrors:
        """Return the errors at a jump of the velocity, after which a comparison is due."""
        return self._replace(age=_PERIOD)

    def compared(
        self, steps: int, roughness: float, error: float, dt: float, substeps: Substeps, enough: int
    ) -> IntegrationErrors:
        """Return the errors after a compared sample.

        Args:
            steps: its number of substeps.
            roughness: roughness of its steps.
            error: its estimated error.
            dt: its duration [s].
            substeps: choice of the number of substeps.
            enough: number of substeps that keeps the tolerance.
        """
        following, again = steps, not roughness < np.inf
        margin = 64.0  # half the substeps have 16 times the error; four times that is a reserve
        if substeps.number is None and steps > 1 and error * margin < substeps.tolerance * dt:
            following, again = steps // 2, True
        return IntegrationErrors(
            following, steps, _PERIOD if again else 0, roughness, max(error, _ROUNDING), dt,
            self.total + error, max(self.rate, error / dt), max(self.most, steps), max(self.enough, enough),
        )  # fmt: skip


def estimated_errors(position: Array, velocity: Array, smooth: bool, scale: float) -> Array:
    """Errors (2 nv,) of a sample from its difference to the one with twice as many substeps; zero if it is rounding.

    Args:
        position: difference of the configurations (nv,).
        velocity: difference of the velocities (nv,).
        smooth: True if the integration is of fourth order.
        scale: largest absolute value of the states.
    """
    fourth = 16.0 / 15.0  # of order 4, error over its difference from the result with half the step
    first = 2.0  # of order 1, the same
    errors = np.concatenate([position, velocity]) * (fourth if smooth else first)
    return np.where(np.abs(errors) > _ROUNDING * (1.0 + scale), errors, 0.0)
