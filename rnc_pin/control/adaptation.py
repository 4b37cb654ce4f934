"""Conditions of adaptation: a dead zone against measurement noise, and anti-windup while actuators are saturated.

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

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Bool, Float


def apply_dead_zone(error: Float[Array, "*batch k"], zone: float | Array) -> Float[Array, "*batch k"]:
    """Return the errors reduced by the zone, entry by entry; zero within it.

    Args:
        error: measured errors.
        zone: half width of the zone, not negative; a number, or one for each entry (k,).
    """
    return error - np.clip(error, -np.asarray(zone), zone)


def saturation_mask(deficit: Float[Array, "*batch k"], added: Float[Array, "*batch k"]) -> Bool[Array, "*batch k"]:
    """Return a mask of the outputs whose learnt force must not change.

    Args:
        deficit: commanded minus applied force at the last sample.
        added: next change of the learnt force, or any quantity with the same sign.
    """
    return np.asarray(deficit * added > 0.0)
