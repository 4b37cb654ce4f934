"""Physical mechanisms and words of constraints, which simulators, drawings and texts read in place of the kinds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol

import numpy as np
import pinocchio as pin

Friction = Literal["all", "longitudinal", "lateral", "oblique", "none"]
"""Directions of ground friction: all, along the heading, across it, along one oblique line, or none."""


@dataclass(frozen=True)
class GroundContact:
    """Wheel, ball or runner on the ground z = 0.

    Attributes:
        frame: name of a frame on the body.
        radius: radius [m]; None for a runner: a point, or wheels that the robot's file draws on its axle.
        axle: unit vector in the frame's axes (3,); None for a ball.
        center: center in the frame's axes (3,) [m].
        friction: directions of friction.
    """

    frame: str
    radius: float | None = None
    axle: np.ndarray | None = None
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    friction: Friction = "all"


@dataclass(frozen=True)
class JointCoupler:
    """Joint whose position follows from that of another joint.

    Attributes:
        joint: name of the joint that follows.
        driver: name of the joint that leads; None if the joint stays at its position.
        ratio: motion of the joint for unit motion of the driver; the offset follows from the initial positions.
        function: position of the joint up to multiples of ``period`` and its slope, from the position of the driver;
            None for a constant ratio.
        period: period of the position [rad].
    """

    joint: str
    driver: str | None
    ratio: float = 0.0
    function: Callable[[float], tuple[float, float]] | None = None
    period: float = 2 * np.pi


@dataclass(frozen=True)
class FrameAnchor:
    """Two frames that coincide, or only their origins.

    Attributes:
        frames: names of the parent frames.
        placements: placements of the joined frames on them.
        point: True if only the origins coincide.
    """

    frames: tuple[str, str]
    placements: tuple[pin.SE3, pin.SE3]
    point: bool


Mechanism = GroundContact | JointCoupler | FrameAnchor


class GroundSurface(Protocol):
    """Surface on which bodies roll, as drawings read it."""

    def mesh(self, center: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Part of the surface near a point (3,) [m], of half width ``size``: vertices (n, 3) and triangles (m, 3)."""


def carrier_of(ground: GroundSurface | None) -> str | None:
    """Name of the frame that carries a ground and stands for the world; None for ground in the world."""
    return None if ground is None else getattr(ground, "frame", None)


class Phrases(NamedTuple):
    """Words for the description of a system with a constraint; an empty string says nothing.

    Attributes:
        support: what the robot stands on, in the singular, e.g. "rolling wheel".
        robot: noun phrase of a robot that stands on nothing, e.g. "a mechanism with closed loops".
        prevents: motion that the constraint prevents, e.g. "slip at".
        where: name that follows ``prevents``.
    """

    support: str = ""
    robot: str = ""
    prevents: str = ""
    where: str = ""
