"""Feedback of outputs: deviations from references, and conditions of adaptation.

A dead zone is against measurement noise, anti-windup acts while actuators are saturated.

Dead zone: only the sum ``error = e + n`` of the true error e and the noise n is measured. A law that adapts at ``beta
error`` also adapts at ``beta n``, and its estimates drift with the integral of the noise. A dead zone z with ``|n| <=
z`` reduces the measured error by z. The result is ``theta e`` with 0 <= theta <= 1: zero, or of the sign of e and not
larger. So

* where e = 0 the estimates do not change: noise has no effect;
* elsewhere the law adapts from the true error, at a gain between 0 and beta. In the Lyapunov functions of Lemmas 2 to
  4, the rate of ``|learnt - true|^2 / (2 beta)`` is ``theta e`` times the parameter error, instead of ``e`` times it.
  As ``|e| - |theta e| <= 2 z``, the terms that no longer cancel in Lemmas 2 and 3 are at most 2 z times the parameter
  error. So errors end in a region of that size. In Lemma 4 every entry still shrinks its own part, so estimates only
  approach the true values.

Anti-windup by conditional integration: Lemmas 2 and 3 assume that the applied force is the commanded force. If the
applied force is x less than commanded, ``V = e^T H e / 2 + |learnt - true|^2 / (2 beta)`` has the additional rate
``e^T x``. For output i,

* if ``e_i x_i <= 0``, this rate does not increase V: the law does not change, and the inequality of the lemma holds;
* if ``e_i x_i > 0``, the law would respond to the error of the saturated actuator with a larger force. It would then
  need as long to unlearn it: windup. So adaptation and leak of this output stop.

So saturation never moves the learnt values away from the true values: their part of V does not grow at any sample
without a bound from the lemma. Only e may grow meanwhile, as far as a robot moves under bounded forces. After the
saturation ends the lemma holds again, with everything that was learnt before.
"""

from __future__ import annotations

from math import exp, expm1, isfinite
from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Bool, Float
from rnc_pin.errors import InputError
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.references.reference import ReferencePoint


class Deviation(NamedTuple):
    """Errors and feedforward of k outputs, (..., k) each; for rotations, angular quantities in world axes."""

    velocity: np.ndarray
    """Velocity of the reference, (k,)."""
    acceleration: np.ndarray
    """Acceleration of the reference, (k,)."""
    error: np.ndarray
    """Desired minus actual output."""
    error_rate: np.ndarray


def deviation(coordinates: Coordinates, desired: ReferencePoint, actual: np.ndarray, rate: np.ndarray) -> Deviation:
    """Return the deviation of outputs (..., k) and their rates (..., k) from a reference.

    Args:
        coordinates: coordinate types of the outputs.
        desired: values of the reference.
        actual: measured outputs.
        rate: measured rates.
    """
    velocity, acceleration = coordinates.to_rates(desired.position, desired.velocity, desired.acceleration)
    error = coordinates.difference(desired.position, actual)
    return Deviation(velocity, acceleration, error, coordinates.difference_rate(error, velocity, rate))


def fed_back(gain: float | np.ndarray, error: np.ndarray, actual: np.ndarray) -> np.ndarray:
    """Return ``gain * error`` (..., k) for outputs (..., k); an output with zero gain needs no value.

    Args:
        gain: a number or one for each output.
        error: desired minus actual values; NaN where one is unknown.
        actual: measured outputs.

    Raises:
        InputError: an output with a nonzero gain has no desired value; or it is a quasi-velocity whose integral is not
            given.
    """
    product = gain * error
    # The rule; the rest of the function explains what is missing.
    if isfinite(np.vdot(product, product)) or np.isfinite(product).all():  # the first is quick, and may overflow
        return product
    # NaN times zero is NaN: an output without gain may have no value, one with gain may not.
    missing = np.isnan(error) & (np.broadcast_to(gain, error.shape) != 0)
    without = missing & ~np.isnan(actual)
    if without.any():
        column = int(np.flatnonzero(without.any(axis=tuple(range(without.ndim - 1))))[0])
        raise InputError(
            f"the reference is NaN at output {column + 1} of {error.shape[-1]}: expected a number for each output with "
            "a feedback gain"
        )
    if missing.any():
        raise InputError(
            "a feedback gain acts on an output without a value: it is a quasi-velocity, and its integral is not given; "
            "pass it to measure(q, v2, integrals)"
        )
    return np.asarray(np.where(np.broadcast_to(gain, error.shape) == 0, 0.0, product))


class Feedback:
    """``xd_dot + gain (xd - x)`` and ``xd_ddot + gain (xd - x)_dot`` of k outputs.

    Args:
        coordinates: coordinate types of the outputs.
        gain: a number or one for each output.
    """

    def __init__(self, coordinates: Coordinates, gain: float | np.ndarray) -> None:
        self._coordinates, self._gain = coordinates, gain

    def __call__(self, desired: ReferencePoint, actual: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return both sums (..., k) for outputs (..., k) and their rates (..., k)."""
        seen = deviation(self._coordinates, desired, actual, rate)
        v2 = seen.velocity + fed_back(self._gain, seen.error, actual)
        # The rate of v2, without a measured acceleration.
        return v2, seen.acceleration + self._gain * seen.error_rate


# ------------------------------------------------------------------ adaptation


def leak(sigma: float, elapsed: float) -> tuple[float, float]:
    """Return the share of a leaky integral that is left after a sample, and the integral of that share over it [s].

    Args:
        sigma: leak rate [1/s]; 0 for none.
        elapsed: duration of the sample [s].
    """
    # expm1 keeps all digits for small products, where 1 - exp loses them.
    return exp(-sigma * elapsed), -expm1(-sigma * elapsed) / sigma if sigma else elapsed


def apply_dead_zone(error: Float[Array, "*batch k"], zone: float | Array) -> Float[Array, "*batch k"]:
    """Return the errors reduced by the zone, entry by entry; zero within it.

    Args:
        error: measured errors.
        zone: half width of the zone, not negative; a number, or one for each entry (k,).
    """
    # What the clip keeps is the part that noise may have caused.
    return error - np.clip(error, -np.asarray(zone), zone)


def saturation_mask(deficit: Float[Array, "*batch k"], added: Float[Array, "*batch k"]) -> Bool[Array, "*batch k"]:
    """Return a mask of the outputs whose learnt force must not change.

    Args:
        deficit: commanded minus applied force at the last sample.
        added: next change of the learnt force, or any quantity with the same sign.
    """
    # The deficit has the sign of the missing force: a change with this sign is windup.
    return np.asarray(deficit * added > 0.0)
