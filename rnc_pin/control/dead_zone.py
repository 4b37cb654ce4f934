"""What adaptation takes of an error that noise is part of.

With ``error = e + n``, of which only the sum is measured, a law that learns at ``beta error`` also learns at
``beta n``, and what it learns wanders off with the sum of all noise. A dead zone z with ``|n| <= z`` takes z off what
is measured: what is left is zero or has the sign of e and is not longer, ``theta e`` with 0 <= theta <= 1. So

* where e = 0 nothing is learnt: noise moves nothing;
* elsewhere it is learnt from the true error, at a gain between 0 and beta. In the Lyapunov functions of Lemmas 2 to 4,
  ``|learnt - true|^2 / (2 beta)`` changes by ``theta e`` times what is missing instead of ``e`` times it. As
  ``|e| - |theta e| <= 2 z``, what no longer cancels in Lemmas 2 and 3 is at most 2 z times what is missing, and errors
  end in a region of that size; in Lemma 4 every entry still shrinks its own part, so estimates only come closer.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array


def apply_dead_zone(error: Float[Array, "*batch k"], zone: float | Array) -> Float[Array, "*batch k"]:
    """Errors less the zone, entry by entry; zero within it.

    Args:
        error: as measured.
        zone: not negative; a number, or one for each entry (k,).
    """
    return error - np.clip(error, -np.asarray(zone), zone)
