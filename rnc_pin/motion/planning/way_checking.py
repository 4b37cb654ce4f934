"""Motions without collisions, between samples too."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Bool, Float
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection, continuous_distances
from rnc_pin.collision.continuous_distances import default_tolerance, too_near
from rnc_pin.model.coordinates import ConfigurationManifold
from rnc_pin.motion.planning.exact_steering import ExactMotion
from rnc_pin.robots.robot import Robot

_HALVED = 1.0 - np.array([int(f"{k:04b}"[::-1], 2) for k in range(16)]) / 16.0
"""Fractions of a motion, in an order that finds collisions early: the end, the middle, the quarters, ..."""


class NarrowPlace(NamedTuple):
    """Smallest distance of a way.

    Attributes:
        distance: [m].
        pair: names of both bodies.
        q: configuration (nq,).
        time: [s].
    """

    distance: float
    pair: str
    q: Float[Array, " nq"]
    time: float


class WayChecker:
    """Check of motions: obstacles stay beyond a clearance, links do not touch each other.

    A motion is free only if bounds of the distances show it, between samples too. The bounds have a tolerance, so that
    gaps that are narrower than the robot, the clearances and the tolerance count as closed. Links may overlap by the
    tolerance: links of many robots are nearer to each other than it.

    Args:
        distances: pairs of the robot and obstacles.
        clearance: smallest distance to obstacles [m].
    """

    def __init__(self, distances: CollisionDistances, clearance: float) -> None:
        self.distances, self.clearance = distances, clearance
        self.tolerance = default_tolerance(distances)
        self._beside = distances.shape_pairs[1] >= distances.link_shapes
        self._least = np.where(self._beside, clearance + self.tolerance, 0.0)
        self.manifold = ConfigurationManifold(distances.robot.model)
        self.blocks = np.zeros(len(distances.pairs), dtype=int)

    def violation(self, q: Float[Array, " nq"]) -> tuple[str, float] | None:
        """Pair that is too near at a configuration, and its distance [m]; None if all are far enough."""
        found = self.distances.smallest(q, 0.0, self.clearance + self.tolerance)
        # Obstacles and links have different limits: the pair that lacks most is named, not the nearest one.
        if not len(found) or found[worst := int(np.argmin(found - self._least))] > self._least[worst]:
            return None
        self.blocks[worst] += 1
        return self.distances.pairs[worst].label, float(found[worst])

    def is_free(self, motion: ExactMotion) -> bool:
        """True if bounds show that no distance of a motion is too small."""
        # A few samples cost less than bounds, and most motions of a search in a narrow place are not free.
        if any(self.violation(q) is not None for q in self._samples(motion)):
            return False
        time = np.arange(len(motion.q), dtype=float)
        found = too_near(self.distances, time, motion.q, self._least, self.tolerance)
        if found is not None:
            self.blocks[found] += 1
        return found is None

    def holds_with(self, motion: ExactMotion, followers: Bool[Array, " nv"]) -> bool:
        """True if a motion that ``is_free`` has accepted stays free where joints that follow move too.

        Only pairs count whose distance depends on these joints. Other samples find other distances, as far as the
        tolerance: what the first check has left of it has to cover the finer tolerance here.

        Args:
            motion: the motion of all joints.
            followers: mask of the velocities of joints that follow.
        """
        moved = self.distances.depends_on(followers)
        finer = 0.1  # tolerance of the second check of wheels that follow, in tolerances of the first one
        tolerance = finer * self.tolerance
        least = self._least - self.tolerance + tolerance
        time, within = np.arange(len(motion.q), dtype=float), self.clearance + self.tolerance
        found = continuous_distances(self.distances, time, motion.q, within, tolerance)
        return not (((found.smallest < least) | found.uncertain) & moved).any()

    def _samples(self, motion: ExactMotion) -> Float[Array, "k nq"]:
        """Configurations along a motion."""
        if not motion.steps.any():
            return motion.q[:1]
        lengths = np.abs(motion.steps).max(axis=1)
        spacing = 0.1  # [m or rad] between the samples that are looked at before the bounds
        count = int(np.clip(lengths.sum() / spacing, 2, len(_HALVED)))
        return motion.at(self.manifold, lengths, _HALVED[:count] * lengths.sum())

    def narrowest(self, time: Float[Array, " n"], q: Float[Array, "n nq"], within: float) -> NarrowPlace | None:
        """Narrowest place beside obstacles along a motion; None if no obstacle is nearer than ``within`` [m]."""
        found = continuous_distances(self.distances, time, q, within, self.tolerance)
        beside = np.where(self._beside, found.smallest, np.inf)
        if not len(beside) or beside.min() >= within:
            return None
        nearest = int(np.argmin(beside))
        at = float(found.time[nearest])
        k = int(np.clip(np.searchsorted(time, at, "right") - 1, 0, len(time) - 2))
        part = (at - time[k]) / max(float(time[k + 1] - time[k]), 1e-300)
        place = self.manifold.interpolate(q[k : k + 1], q[k + 1 : k + 2], np.array([part]))[0]
        return NarrowPlace(float(beside[nearest]), self.distances.pairs[nearest].label, place, at)


def way_checker(
    robot: Robot,
    q0: Float[Array, " nq"],
    obstacles: Sequence[Obstacle],
    selection: PairSelection | None,
    clearance: float,
) -> WayChecker | None:
    """Check of motions; None for a robot without geometry among no obstacles."""
    if not obstacles and not robot.has_collision_shapes:
        return None
    distances = CollisionDistances(robot, obstacles, selection, q0)
    return WayChecker(distances, clearance) if distances.pairs else None
