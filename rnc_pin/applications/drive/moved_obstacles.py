"""Obstacles that a user moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rnc_pin.applications.drive.goals import ObstacleLeg
from rnc_pin.collision import Obstacle


class _PlaceAndRate(NamedTuple):
    position: np.ndarray
    velocity: np.ndarray


class MovedMotion:
    """Motion of an obstacle along legs; its yaw is constant.

    Args:
        yaw: rotation about the world's z [rad].
        leg: first leg.

    Attributes:
        legs: legs so far; the controller replaces this tuple, and the thread of the page reads it.
    """

    size = 4

    def __init__(self, yaw: float, leg: ObstacleLeg) -> None:
        self._yaw = yaw
        self.legs: tuple[ObstacleLeg, ...] = (leg,)

    def at(self, t: float) -> _PlaceAndRate:
        """Position and velocity (4,) of x, y, z and yaw at a time [s]."""
        leg = next((each for each in reversed(self.legs) if each.begin <= t), self.legs[0])
        place, rate = leg.at(t)
        return _PlaceAndRate(np.append(place, self._yaw), np.append(rate, 0.0))


def movable(obstacles: Sequence[Obstacle]) -> tuple[tuple[Obstacle, ...], tuple[MovedMotion, ...]]:
    """Return obstacles that move by commands, and their motions; a motion of the scenario ends at its first pose."""
    motions = []
    for each in obstacles:
        x, y, z = (float(value) for value in each.placement(0.0).translation)
        yaw = each.yaw if each.motion is None else float(each.motion.at(0.0).position[3])
        motions.append(MovedMotion(yaw, ObstacleLeg(0.0, (x, y, z), (x, y, z), 1.0)))
    return tuple(replace(each, motion=motion) for each, motion in zip(obstacles, motions, strict=True)), tuple(motions)
