"""Limit: distances between links and to obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.collision.flat_contacts import MOST_CORNERS
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.parameter_types import NotNegative, Positive
from rnc_pin.model.reduced_model import ReducedModel

_SHARE = 0.5


@dataclass(frozen=True)
class CollisionAvoidance(ControlLimit):
    """Velocity damper: ``d_dot >= -rate (d - clearance)`` for pairs nearer than ``influence`` (Faverjon and Tournassoud
    1987, with ``rate = xi / (influence - clearance)``).

    The rate of approach decreases with the remaining distance, so that the clearance is reached only in infinite time.
    If the velocity changes linearly over a sample, ``rate * dt <= 2`` keeps the clearance up to the turning of the
    normal within a sample. The motion of obstacles enters with its velocity at the end of the sample.

    Pairs of links that are nearer than twice the clearance at ``q0`` keep half of that distance instead, because
    neighbours in a wrist are near by design.

    Between parallel faces the nearest points are not unique: a body that turns can lose clearance within a sample. With
    ``corners``, such pairs have a row for each corner of the common region of both faces.

    Args:
        clearance: distance that remains [m].
        influence: distance from which a pair is slowed down [m]; larger than the clearance.
        rate: largest rate of approach over remaining distance [1/s].
        obstacles: bodies in the world.
        selection: rules for pairs of links; by default all pairs that are not adjacent.
        q0: configuration (nq,) without collisions; by default the neutral one.
        corners: True for rows at the corners of parallel faces and edges.
    """

    clearance: NotNegative = 0.02
    influence: Positive = 0.15
    rate: Positive = 5.0
    obstacles: Sequence[Obstacle] = ()
    selection: PairSelection = field(default_factory=PairSelection)
    q0: Sequence[float] | np.ndarray | None = None
    corners: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.clearance < self.influence < np.inf or not 0 < self.rate < np.inf:
            raise ConfigurationError(
                "collision avoidance needs 0 <= clearance < influence and a positive rate, found clearance "
                f"{self.clearance}, influence {self.influence} and rate {self.rate}"
            )

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return BoundCollisionAvoidance(self, reduced)


class BoundCollisionAvoidance(BoundLimit):
    """Collision avoidance of one model, with a row for each pair.

    Attributes:
        distances: distances of the pairs; ``distances.omitted`` lists pairs that are not checked.
        clearances: distance that each pair keeps (k,) [m].
    """

    def __init__(self, limit: CollisionAvoidance, reduced: ReducedModel) -> None:
        robot = reduced.robot
        q0 = robot.configuration() if limit.q0 is None else np.asarray(limit.q0, dtype=float)
        self.distances = CollisionDistances(robot, limit.obstacles, limit.selection, q0)
        labels = [pair.label for pair in self.distances.pairs]
        further = [f"{label} corner {k + 1}" for k in range(MOST_CORNERS if limit.corners else 0) for label in labels]
        self.names = (*(f"{label} distance" for label in labels), *further)
        self._influence, self._rate = limit.influence, limit.rate
        self._corners, self.clearances = limit.corners, np.full(len(labels), limit.clearance)
        links = len(robot.collision_model.geometryObjects) if robot.collision_model is not None else 0
        at_start = self.distances.at(q0, within=limit.clearance / _SHARE)
        for k, distance in zip(at_start.pairs.tolist(), at_start.distance.tolist(), strict=True):
            if self.distances.pairs[k].second < links:
                self.clearances[k] = _SHARE * distance
        self.clearances.setflags(write=False)

    def rows(self, sample: ControlSample) -> LimitRows:
        near = self.distances.at(sample.end.q, sample.time, self._influence, corners=self._corners)
        lower = -self._rate * (near.distance - self.clearances[near.pairs]) - near.drift
        places = near.pairs
        if self._corners:
            # Within the sample the gap of a corner is convex: this keeps the clearance at its end.
            room = near.distance - self.clearances[near.pairs]
            lower = np.maximum(lower, near.jacobian @ sample.end.v - 2.0 / sample.dt * room)
            number = np.arange(len(places)) - np.searchsorted(places, places)  # of each row among those of its pair
            places = places + number * len(self.clearances)
        return LimitRows(near.jacobian, lower, np.full(len(lower), np.inf), places)
