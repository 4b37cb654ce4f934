"""Limits of accelerations that a controller keeps, for verdicts about its runs; it loads no program."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple


class LimitedAcceleration(NamedTuple):
    """Limits of one entry of an acceleration.

    Attributes:
        name: name of the entry.
        quantity: "v2" for a reduced velocity, "v" for a velocity of the robot.
        column: column of the entry.
        lower, upper: smallest and largest acceleration [rad/s^2 or m/s^2].
        rounding: excess that counts as rounding, as a share of the larger limit. The acceleration of a run is a
            quotient of two samples, between which the inputs are held.
        until: time up to which the limits hold [s], as those of a controller of one phase.
    """

    name: str
    quantity: Literal["v", "v2"]
    column: int
    lower: float
    upper: float
    rounding: float = 1e-4
    until: float = math.inf


def limited_accelerations(controller: object) -> tuple[LimitedAcceleration, ...]:
    """Accelerations that a controller limits, or that the one within it as its ``target`` limits."""
    while controller is not None and not hasattr(controller, "limited_accelerations"):
        controller = getattr(controller, "target", None)
    return () if controller is None else controller.limited_accelerations
