"""State of a control loop."""

from __future__ import annotations

from typing import NamedTuple

from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.control.controller import State
from rnc_pin.loop.velocity import VelocityEstimate


class LoopState(NamedTuple):
    """All data that a control loop keeps from one step to the next.

    Example:
        >>> rnc.loop.LoopState().fault is None  # before the first step
        True
    """

    begin: float | None = None
    """Time of the first step [s]; it is the controller's time zero."""
    time: float | None = None
    """Time of the last valid measurement [s]."""
    q: Float[Array, " nq"] | None = None
    """Last measured configuration."""
    v2: Float[Array, " r"] | None = None
    """Reducing velocities of the last measurement."""
    integrals: Float[Array, " r"] | None = None
    """Integrals of the reducing velocities since the first step."""
    motion: VelocityEstimate | None = None
    """State of the velocity estimate; None if velocity is measured."""
    T: Float[Array, " p"] | None = None
    """Last inputs."""
    input_deficit: Float[Array, " p"] | None = None
    """Requested minus applied inputs. None if it is zero."""
    controller: State = None
    """State of the controller."""
    invalid_since: float | None = None
    """Time of the first invalid measurement since the last valid one [s]."""
    fault: str | None = None
    """Reason for the safe command, as text; None in normal operation."""
    failed: bool = False
    """True after an error of the controller: the safe command is permanent."""
