"""What adaptation does while actuators give less than they are asked for.

In Lemmas 2 and 3 the force that acts is the one that was asked for. Where x of it is missing, ``V = e^T H e / 2 +
|learnt - true|^2 / (2 beta)`` changes by ``e^T x`` more a second. Of output i

* with ``e_i x_i <= 0`` that is nothing that makes V grow: its law stays as it is, and so does the lemma's inequality;
* with ``e_i x_i > 0`` the law would answer the error that the clipped actuator leaves by asking for more of the same,
  to be unlearnt for as long afterwards: the windup. What is learnt stays there as it is, its leak included.

So what is learnt never moves away from the truth because of a clipped actuator: the learnt part of V grows at no sample
at which the lemma does not bound it. Only e may grow meanwhile, as far as a robot goes under forces that are bounded;
and once nothing is clipped any more the lemma holds from there on, with all that was learnt before.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array


def saturation_mask(excess: Float[Array, "*batch k"], added: Float[Array, "*batch k"]) -> Bool[Array, "*batch k"]:
    """Outputs whose learnt force must stay as it is.

    Args:
        excess: force asked for at the last sample and not given.
        added: by which the learnt force is about to change, or anything of its sign.
    """
    return np.asarray(excess * added > 0.0)
