"""What a loop remembers."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.control.protocol import State
from rnc_pin.loop.velocity import VelocityEstimate


class LoopState(NamedTuple):
    """Everything that a loop remembers from one step to the next.

    Example:
        >>> rnc.loop.LoopState().trouble is None  # of a loop that has not begun
        True
    """

    begin: float | None = None
    """Time of the first step [s]: the controller's time zero."""
    time: float | None = None
    """Of the last measurement that was taken [s]."""
    q: Float[Array, " nq"] | None = None
    """Configuration measured last."""
    v2: Float[Array, " r"] | None = None
    """Reducing velocities then."""
    integrals: Float[Array, " r"] | None = None
    """Of the reducing velocities since the first step."""
    motion: VelocityEstimate | None = None
    """Of the velocity's estimate."""
    T: Float[Array, " p"] | None = None
    """Inputs given last."""
    missing: Float[Array, " p"] | None = None
    """Inputs that were asked for and not given: asked less given. None where all of them were."""
    controller: State = None
    """What the controller remembers."""
    bad_since: float | None = None
    """Time of the first of the measurements that were not taken [s]."""
    trouble: str | None = None
    """Why the controller is not listened to; None while it is."""
    failed: bool = False
    """Whether that lasts: the controller itself ended."""
