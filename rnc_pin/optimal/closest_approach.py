"""Smallest distances along a motion, also between its samples: conservative bisection.

Between two samples the configuration follows the geodesic of the manifold. The motion of both bodies of a pair bounds
its distance from below there. Steps in which a pair could be nearer than a limit are halved until this bound or a
measurement decides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.collision import CollisionDistances
from rnc_pin.optimal.state_manifold import StateManifold

_DEEPEST = 10  # halvings of a step
_RESOLUTION = 1e-4  # [m], error of the smallest distance of a pair below the limit
_FAR = 0.2  # [m], distance beyond the limit up to which pairs are measured


class Approach(NamedTuple):
    """Smallest distance of a pair along a motion.

    Attributes:
        names: names of the two bodies.
        distance: signed distance [m]; negative for a penetration.
        time: its time [s].
    """

    names: tuple[str, str]
    distance: float
    time: float


class _Sample(NamedTuple):
    """One time: distances (k,) and normals (k, 3) of all pairs; centres (s, 3) and rotations (s, 3, 3) of shapes."""

    time: float
    q: Array
    distance: Array
    normal: Array
    middles: Array
    rotations: Array


class ClosestApproach:
    """Search for pairs that come nearer than a limit.

    Args:
        distances: pairs of bodies.
        limit: distance below which a pair counts [m].
        tolerance: no pair comes nearer than the limit by more than this between the measurements that decide [m].
    """

    def __init__(self, distances: CollisionDistances, limit: float, tolerance: float) -> None:
        self._distances, self._limit, self._tolerance = distances, limit, max(tolerance, _RESOLUTION)
        self._within = limit + _FAR
        self._manifold = StateManifold(distances.robot.model)
        self._first = np.array([pair.first for pair in distances.pairs], dtype=int)
        self._second = np.array([pair.second for pair in distances.pairs], dtype=int)
        self._slides, self._turns = _kinds_of_motion(distances)
        self._lowest = np.full(len(distances.pairs), np.inf)
        self._when = np.zeros(len(distances.pairs))

    def along(self, time: Float[Array, " n"], q: Float[Array, "n nq"]) -> list[Approach]:
        """Return the smallest distance of each pair that comes nearer than the limit, nearest first.

        Args:
            time: times of the samples [s].
            q: configurations; between them the motion is a geodesic.
        """
        self._lowest[:], self._when[:] = np.inf, 0.0
        before = self._measured(float(time[0]), q[0])
        for t, after in zip(time[1:].tolist(), q[1:], strict=True):
            now = self._measured(t, after)
            self._between(before, now, _DEEPEST)
            before = now
        near = [int(k) for k in np.argsort(self._lowest, kind="stable") if self._lowest[k] < self._limit]
        pairs = self._distances.pairs
        return [Approach(pairs[k].names, float(self._lowest[k]), float(self._when[k])) for k in near]

    def _between(self, a: _Sample, b: _Sample, depth: int) -> None:
        """Halve a step until every pair is far enough, or is measured nearer than the limit."""
        if not depth:
            return
        shift, turn = b.middles - a.middles, self._turns_of(a, b) + self._bends(a, b)
        longest = 2.0 * float((np.sqrt(np.vecdot(shift, shift)) + turn).max())
        near = np.flatnonzero(np.minimum(a.distance, b.distance) - longest < self._limit - self._tolerance)
        if not len(near):
            return
        least = self._least(a, b, near, shift, turn)
        if not ((least < self._limit - self._tolerance) & (self._lowest[near] > least + _RESOLUTION)).any():
            return
        middle = self._manifold.interpolate(a.q, b.q, np.array([0.5]))[0]
        halfway = self._measured(0.5 * (a.time + b.time), middle)
        self._between(a, halfway, depth - 1)
        self._between(halfway, b, depth - 1)

    def _measured(self, t: float, q: Array) -> _Sample:
        """Distances at one time. Pairs that are far from the limit have a lower bound instead."""
        found = self._distances.at(q, t, self._within)
        distance, normal = np.full(len(self._first), self._within), np.zeros((len(self._first), 3))
        distance[found.pairs], normal[found.pairs] = found.distance, found.normal
        lower = distance < self._lowest
        self._lowest[lower], self._when[lower] = distance[lower], t
        at = self._distances.poses
        return _Sample(t, q, distance, normal, at.middles.copy(), at.rotations.copy())

    def _least(self, a: _Sample, b: _Sample, pairs: Array, shift: Array, turn: Array) -> Array:
        """Lower bounds of the distances of pairs in a step (n,) [m].

        Convex bodies that are apart along a normal stay apart by at least the distance less their approach along it.
        This approach is that of their centres (``shift``), and that of points which turn about these on bent paths
        (``turn``).
        """
        first, second = self._first[pairs], self._second[pairs]
        aside = turn[first] + turn[second]
        moved = shift[first] - shift[second]
        forward = np.vecdot(a.normal[pairs], moved)
        backward = -np.vecdot(b.normal[pairs], moved)
        path = np.sqrt(np.vecdot(moved, moved))
        known = [
            np.where(sample.normal[pairs].any(axis=1), np.maximum(approach, 0.0), path)
            for sample, approach in ((a, forward), (b, backward))
        ]
        sides = np.maximum(a.distance[pairs] - known[0], b.distance[pairs] - known[1])
        return np.maximum(sides, 0.5 * (a.distance[pairs] + b.distance[pairs] - path)) - aside

    def _turns_of(self, a: _Sample, b: _Sample) -> Array:
        """Largest motion of a point of each shape relative to its centre (s,) [m]."""
        turn = (b.rotations - a.rotations).reshape(-1, 9)
        return np.sqrt(0.5 * np.vecdot(turn, turn)) * self._distances.radii

    def _bends(self, a: _Sample, b: _Sample) -> Array:
        """Largest distances of the path of a point of each shape from its chord (s,) [m].

        A path is at most an eighth of its largest second derivative in the step beside its chord, and a quarter longer.
        The derivative of a body with angular rates w and linear rates u of its joints is at most ``w^2 r + 2 w u`` at
        the distance r.
        """
        radii, obstacles = self._distances.radii, self._distances.obstacles
        step = np.abs(self._manifold.difference(a.q[None], b.q[None])[0])
        angle, slide = float(step @ self._turns), float(step @ self._slides)
        links = len(radii) - len(obstacles)
        size = float(np.linalg.norm(np.ptp(a.middles[:links], axis=0)))
        bends = np.zeros(len(radii))
        bends[:links] = 0.25 * (angle**2 * (size + float(radii[:links].max(initial=0.0))) + 2 * angle * slide)
        for k, obstacle in enumerate(obstacles):
            if obstacle.motion is not None:
                change = np.abs(obstacle.twist(b.time) - obstacle.twist(a.time))
                rate = float(np.linalg.norm(change[:3])) + float(change[5] * radii[links + k])
                bends[links + k] = 0.25 * rate * (b.time - a.time)
        return bends


def _kinds_of_motion(distances: CollisionDistances) -> tuple[Array, Array]:
    """Masks (nv,) of linear and of angular rates."""
    model = distances.robot.model
    slides = np.zeros(model.nv)
    for joint in list(model.joints)[1:]:
        name = joint.shortname()
        if name == "JointModelFreeFlyer":
            slides[joint.idx_v : joint.idx_v + 3] = 1.0
        elif name == "JointModelPlanar":
            slides[joint.idx_v : joint.idx_v + 2] = 1.0
        elif name.startswith("JointModelP") or name == "JointModelTranslation":
            slides[joint.idx_v : joint.idx_v + joint.nv] = 1.0
    return slides, 1.0 - slides
