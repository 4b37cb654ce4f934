"""Anti-windup of adaptation by conditional integration, while actuators are saturated.

Lemmas 2 and 3 assume that the applied force is the commanded force. If the applied force is x less than commanded,
``V = e^T H e / 2 + |learnt - true|^2 / (2 beta)`` has the additional rate ``e^T x``. For output i,

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


def saturation_mask(deficit: Float[Array, "*batch k"], added: Float[Array, "*batch k"]) -> Bool[Array, "*batch k"]:
    """Return a mask of the outputs whose learnt force must not change.

    Args:
        deficit: commanded minus applied force at the last sample.
        added: next change of the learnt force, or any quantity with the same sign.
    """
    return np.asarray(deficit * added > 0.0)
