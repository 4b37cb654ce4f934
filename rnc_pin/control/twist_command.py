"""Twists, states and commands of a twist controller, and its reasons for a cut."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.printing import printed

Twist: TypeAlias = Sequence[float | None] | Array
"""Twist (vx, vy, wz) [m/s, m/s, rad/s]; an entry that is None or NaN is free."""


class TwistCut(NamedTuple):
    """Reason why a base does not have the commanded twist."""

    kind: Literal["constraint", "angle", "steering", "speed", "range"]
    """"constraint": rows forbid a part of the twist, at any steering angle. "angle": a pivot is at its limit.
    "steering": a pivot is still turning. "speed": a joint is at its velocity limit. "range": a joint that follows the
    base is at its position limit."""
    name: str
    """Joint, or frame of the base."""
    amount: float
    """Speed that is cut [m/s], yaw rates times the base's length; remaining angle [rad]; or share of the twist left."""

    def __str__(self) -> str:
        amount, name = f"{self.amount:.3g}", self.name
        return {
            "constraint": f"the rows forbid {amount} m/s of the twist of {name}",
            "angle": f"{name} is at its limit, {amount} rad before the angle of the twist",
            "steering": f"{name} has {amount} rad to turn",
            "speed": f"{name} is at its velocity limit: the twist is scaled by {amount}",
            "range": f"{name} is at its position limit: the twist is scaled by {amount}",
        }[self.kind]


class TwistState(NamedTuple):
    """State of a twist controller between two samples."""

    aim: Float[Array, " 3"]
    """Last commanded twist that was not zero: the pivots keep its angles while the base waits."""
    twist: Float[Array, " 3"]
    """Twist of the last command."""
    rates: Float[Array, " k"]
    """Rates of the pivots [rad/s]."""


@printed(joints="rad/s or m/s", twist="m/s, m/s, rad/s", u="rad/s or m/s")
class TwistCommand(NamedTuple):
    """Velocities for one sample."""

    joints: Float[Array, " j"]
    """Velocities of the controller's ``joints`` [rad/s, m/s]."""
    twist: Float[Array, " 3"]
    """Twist (vx, vy, wz) of the frame that these velocities cause [m/s, m/s, rad/s]."""
    v: Float[Array, " nv"]
    """Velocity of the whole robot; passive wheels included."""
    u: Float[Array, " p"]
    """Velocities of the actuators, ``B^T v``."""
    cuts: tuple[TwistCut, ...]
    """Reasons why ``twist`` is not the commanded one; empty if it is."""


@printed(twist="m/s, m/s, rad/s")
class FeasibleTwist(NamedTuple):
    """Twist that a base reaches under a constant command, when its pivots have turned."""

    twist: Float[Array, " 3"]
    """Twist (vx, vy, wz) of the frame."""
    q: Float[Array, " nq"]
    """Configuration with the pivots at their angles."""
    v: Float[Array, " nv"]
    """Velocity of the whole robot there."""
    cuts: tuple[TwistCut, ...]
    """Reasons why it is not the commanded twist."""
