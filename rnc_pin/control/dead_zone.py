"""Dead zone of adaptation against measurement noise.

Only the sum ``error = e + n`` of the true error e and the noise n is measured. A law that adapts at ``beta error`` also
adapts at ``beta n``, and its estimates drift with the integral of the noise. A dead zone z with ``|n| <= z`` reduces
the measured error by z. The result is ``theta e`` with 0 <= theta <= 1: zero, or of the sign of e and not larger. So

* where e = 0 the estimates do not change: noise has no effect;
* elsewhere the law adapts from the true error, at a gain between 0 and beta. In the Lyapunov functions of Lemmas 2 to
  4, the rate of ``|learnt - true|^2 / (2 beta)`` is ``theta e`` times the parameter error, instead of ``e`` times it.
  As ``|e| - |theta e| <= 2 z``, the terms that no longer cancel in Lemmas 2 and 3 are at most 2 z times the parameter
  error. So errors end in a region of that size. In Lemma 4 every entry still shrinks its own part, so estimates only
  approach the true values.
"""

from __future__ import annotations

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float


def apply_dead_zone(error: Float[Array, "*batch k"], zone: float | Array) -> Float[Array, "*batch k"]:
    """Return the errors reduced by the zone, entry by entry; zero within it.

    Args:
        error: measured errors.
        zone: half width of the zone, not negative; a number, or one for each entry (k,).
    """
    return error - np.clip(error, -np.asarray(zone), zone)
