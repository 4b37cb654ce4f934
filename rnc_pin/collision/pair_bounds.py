"""Lower bounds of the distances of pairs along segments of a motion.

The motion of a pair is seen from its first body, or from the obstacle. It is that of the joints between both bodies.
``V`` bounds the path of any point of the other body: the sum of the translations and of the rotations times levers.
``A = 2 W V`` bounds the second derivative along the segment, with ``W`` the sum of the rotations: the derivative of the
velocity that joint j causes, by joint i, is the axis of the one nearer to the first body times the velocity of the
other. Two bounds follow:

* The distance changes at most by the path: ``(d0 + d1 - L) / 2``, where L is V, or the largest displacement between
  both ends plus ``A / 4``. With V it holds for joints that move at any rate.
* The gap along a fixed direction is at least that of points on straight lines, less ``A / 8``. So it is not smaller
  than its linear interpolation less ``A / 8``. The directions are the normals at both ends. Turns about such a
  direction do not change the gap: ``A``, and the part of ``V`` by rotations, count with the sine of the angle between
  the direction and the axes. So the height of a level arm over a base is certain, however the arm turns.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import coal
import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Bool, Float, Int
from rnc_pin.collision.collision_distances import CollisionDistances
from rnc_pin.collision.distance_bounds import PlacedBodies
from rnc_pin.collision.motion_segments import Segments
from rnc_pin.errors import ModelError

_CHUNK = 20_000  # entries at a time: bounds memory
_LARGEST = 50.0  # exponent; the bound is of no use far below
_NO_GAP = -1e9  # [m]; gap along a direction that coal does not give, or in which a half space has no end
_UNIT = 1e-6  # error of the square of a unit vector
BoundKind = Literal["path", "normals", "steady"]
_ALONG = 1e-9  # distance of a direction from the normal of a half space that counts as rounding


def support(shape: coal.CollisionGeometry, directions: Float[Array, "k 3"]) -> Float[Array, " k"]:
    """Largest value of ``direction . x`` over the points x of a convex shape [m].

    The gap of two convex bodies along any unit direction is a lower bound of their signed distance: the gap is minus
    the supports of the first body along the direction and of the second body against it.

    Args:
        shape: box, sphere, cylinder, capsule, cone, ellipsoid, hull or half space.
        directions: unit vectors in the frame of the shape. A half space is bounded along its normal alone.

    Raises:
        ModelError: the shape is not convex.
    """
    x, y, z = directions.T
    swept = shape.getSweptSphereRadius()
    match shape:
        case coal.Box():
            found = np.abs(directions) @ np.ravel(shape.halfSide)
        case coal.Sphere():
            found = np.full(len(directions), shape.radius)
        case coal.Capsule():
            found = shape.halfLength * np.abs(z) + shape.radius
        case coal.Cylinder():
            found = shape.halfLength * np.abs(z) + shape.radius * np.hypot(x, y)
        case coal.Cone():
            found = np.maximum(shape.halfLength * z, shape.radius * np.hypot(x, y) - shape.halfLength * z)
        case coal.Ellipsoid():
            found = np.linalg.norm(directions * np.ravel(shape.radii), axis=1)
        case coal.ConvexBase():
            found = (directions @ np.array(shape.points()).T).max(axis=1)
        case coal.Halfspace():
            normal = np.ravel(shape.n)
            found = np.where(np.abs(directions - normal).max(axis=1) < _ALONG, shape.d, np.inf)
        case _:
            raise ModelError(f"a {type(shape).__name__} has no support function")
    return np.asarray(found + swept)


class PairEnds(NamedTuple):
    """Pairs along segments: the numbers of both places, and distance and normal (k, 4) of the pair at both.

    Normals are NaN where the distance is a lower bound.
    """

    start: Int[Array, " k"]
    end: Int[Array, " k"]
    pair: Int[Array, " k"]
    at_start: Float[Array, "k 4"]
    at_end: Float[Array, "k 4"]


class PairBounds:
    """Lower bounds of distances along segments.

    Args:
        distances: pairs of a robot and its obstacles.
    """

    def __init__(self, distances: CollisionDistances) -> None:
        model, links = distances.robot.model, distances.link_shapes
        moving = [k for k, each in enumerate(distances.obstacles) if each.motion is not None]
        columns = {links + k: model.njoints + place for place, k in enumerate(moving)}
        carried = np.zeros((len(distances.carriers), model.njoints + len(moving)), dtype=bool)
        for shape, joint in enumerate(distances.carriers):
            carried[shape, list(model.supports[joint])[1:]] = True
            if shape in columns:
                carried[shape, columns[shape]] = True
        spinning = distances.spinning
        carried[spinning.shapes, np.array(distances.carriers)[spinning.shapes]] = False
        first, second = distances.shape_pairs
        # The other body is the smaller one: its radius is the lever of rotations. Obstacles are seen from.
        swap = (second >= links) | (distances.radii[first] < distances.radii[second])
        self._from, self._other = np.where(swap, second, first), np.where(swap, first, second)
        self._sign = np.where(swap, -1.0, 1.0)  # of normals, which point from the first to the second body
        self._between: Bool[Array, "k j"] = carried[first] ^ carried[second]
        # Both bounds and measured distances are those of turned shapes, each within a wobble of an exact one.
        self._wobble: Float[Array, " k"] = 4.0 * spinning.wobble[distances.shape_pairs].sum(axis=0)
        self._radii, self._shapes, self._links = distances.radii, distances.shapes, links
        self._moving = np.array([columns.get(shape, 0) for shape in second.tolist()])  # the column of an obstacle
        self._joints = model.njoints

    def coarse(self, segments: Segments, placed: PlacedBodies) -> Float[Array, "s k"]:
        """Largest decrease of each pair's mean distance along each segment, cheap and far from sharp.

        Segment k starts at place k.
        """
        middles, joints = placed.middles, placed.joints
        rows, robot = slice(0, len(segments.angular)), slice(1, self._joints)
        centers = middles[rows, : self._links]
        center = centers.mean(axis=1, keepdims=True)
        far = (np.linalg.norm(centers - center, axis=2) + self._radii[: self._links]).max(axis=1)[:, None]
        levers = far + np.linalg.norm(joints[rows] - center, axis=2)
        levers[:, robot] = levers[:, robot].max(axis=1, initial=0.0, keepdims=True)
        found = np.empty((len(levers), len(self._from)))
        for column in np.unique(self._moving).tolist():
            used = np.arange(levers.shape[1]) < self._joints
            used[column] = True
            path, _, error = _paths(Segments(*(each * used for each in segments)), levers)
            found[:, self._moving == column] = (0.5 * path + error)[:, None]
        return found

    def along(
        self, kind: BoundKind, ends: PairEnds, segments: Segments, rows: Int[Array, " k"], placed: PlacedBodies
    ) -> Float[Array, " k"]:
        """Lower bounds (k,) of distances [m].

        Args:
            kind: bound that is used: that of the path, that of the path along the normals at both ends, or all of them
                with that of motion at constant rates. The first two hold however the joints move: their segments are
                lengths of paths. The others are displacements.
            ends: pairs and their segments.
            segments: displacements of some segments.
            rows: the row of ``segments`` of each pair.
            placed: poses at all places.
        """
        found = np.empty(len(rows))
        for first in range(0, len(rows), _CHUNK):
            part = slice(first, first + _CHUNK)
            own = Segments(*(each[rows[part]] for each in segments))
            found[part] = self._along(PairEnds(*(each[part] for each in ends)), own, placed, kind)
        return found

    def _along(self, ends: PairEnds, segments: Segments, placed: PlacedBodies, kind: BoundKind) -> Float[Array, " k"]:
        pair, between = ends.pair, self._between[ends.pair]
        radius = self._radii[self._other[pair]]
        arms = placed.joints[ends.start] - placed.middles[ends.start, self._other[pair]][:, None]
        levers = np.sqrt(np.vecdot(arms, arms)) + radius[:, None]
        own = Segments(*(each * between for each in segments))
        path, turning, error = _paths(own, levers)
        curved = 2.0 * turning * path  # bound of the second derivative
        longest = np.minimum(path, self._chords(ends, placed) + 0.25 * curved) if kind == "steady" else path
        before, after = ends.at_start[:, 0], ends.at_end[:, 0]
        found = 0.5 * (before + after - longest)
        exact = np.flatnonzero(np.isfinite(ends.at_start[:, 1]) & np.isfinite(ends.at_end[:, 1]))
        if kind != "path" and len(exact):
            some = PairEnds(*(each[exact] for each in ends))
            gaps = self._gaps_at_ends(some, placed)
            tilt = _tilt(some, own.angular[exact], turning[exact], placed)
            if kind == "steady":
                straight = np.minimum(np.minimum(before[exact], after[exact]), _smallest_maximum(*gaps[0], *gaps[1]))
                along = straight - 0.125 * curved[exact] * tilt
            else:
                moved = own.linear[exact].sum(axis=1) * np.exp(np.minimum(turning[exact], _LARGEST))
                along = 0.5 * (gaps.sum(axis=1).max(axis=0) - moved - tilt * (path[exact] - moved))
            found[exact] = np.maximum(found[exact], along)
        return found - error - self._wobble[pair]

    def _chords(self, ends: PairEnds, placed: PlacedBodies) -> Float[Array, " k"]:
        """Largest displacement of a point of the other body between both ends, seen from the first one [m]."""
        one, other = self._from[ends.pair], self._other[ends.pair]
        relative, centers = [], []
        for place in (ends.start, ends.end):
            world = placed.rotations[place, one].swapaxes(1, 2)
            relative.append(world @ placed.rotations[place, other])
            centers.append(np.matvec(world, placed.middles[place, other] - placed.origins[place, one]))
        turn = np.linalg.norm((relative[1] - relative[0]).reshape(-1, 9), axis=1) * np.sqrt(0.5)
        return np.linalg.norm(centers[1] - centers[0], axis=1) + turn * self._radii[other]

    def _gaps_at_ends(self, ends: PairEnds, placed: PlacedBodies) -> Float[Array, "2 2 k"]:
        """Gaps along the normals of both ends (first axis) at both ends (second axis) [m]."""
        one, other, sign = self._from[ends.pair], self._other[ends.pair], self._sign[ends.pair, None]
        poses, normals = [], []
        for place, numbers in ((ends.start, ends.at_start), (ends.end, ends.at_end)):
            world = placed.rotations[place, one].swapaxes(1, 2)
            shift = placed.origins[place, other] - placed.origins[place, one]
            poses.append((world @ placed.rotations[place, other], np.matvec(world, shift)))
            normals.append(np.matvec(world, sign * numbers[:, 1:]))
        return np.array([[self._gaps(one, other, normal, *pose) for pose in poses] for normal in normals])

    def _gaps(self, one: Array, other: Array, normal: Array, rotation: Array, place: Array) -> Float[Array, " k"]:
        """Gaps of two shapes along unit vectors in the frame of the first one; very low without a unit vector."""
        inner = -np.matvec(rotation.swapaxes(1, 2), normal)
        found = np.vecdot(normal, place) - self._supports(one, normal) - self._supports(other, inner)
        unit = np.abs(np.vecdot(normal, normal) - 1.0) < _UNIT
        return np.where(unit, np.maximum(found, _NO_GAP), _NO_GAP)

    def _supports(self, shapes: Array, directions: Array) -> Float[Array, " k"]:
        found = np.empty(len(shapes))
        for shape in np.unique(shapes).tolist():
            which = np.flatnonzero(shapes == shape)
            found[which] = support(self._shapes[shape], directions[which])
        return found


def _paths(segments: Segments, levers: Float[Array, "k j"]) -> tuple[Array, Array, Array]:
    """Longest path of a point, sum of rotations, and deviation of a point from constant rates, (k,) each.

    Levers are those at the start; along the segment they grow with the path, which gives the exponential function.
    """
    angular, linear, turned, moved = segments
    turning = angular.sum(axis=1)
    path = (linear + angular * levers).sum(axis=1) * np.exp(np.minimum(turning, _LARGEST))
    error = (moved + turned * (levers + path[:, None])).sum(axis=1)
    return path, turning, error * np.exp(np.minimum(turned.sum(axis=1), _LARGEST))


def _tilt(
    ends: PairEnds, angular: Float[Array, "k j"], turning: Float[Array, " k"], placed: PlacedBodies
) -> Float[Array, " k"]:
    """Largest sine of the angle between the normals and the axes of the joints that turn, along each segment.

    The angle of two axes changes at most by the turn times the sine of the angle to the axis of the turn, so that the
    largest sine grows at most as the exponential function of twice the turn. Parallel axes stay parallel.
    """
    largest = np.zeros(len(turning))
    for place, numbers in ((ends.start, ends.at_start), (ends.end, ends.at_end)):
        across = np.cross(placed.axes[place], numbers[:, None, 1:])
        sines = np.where(angular > 0.0, np.sqrt(np.vecdot(across, across)), 0.0)
        largest = np.maximum(largest, np.where(np.isnan(sines), 1.0, sines).max(axis=1, initial=0.0))
    return np.minimum(1.0, largest * np.exp(np.minimum(2.0 * turning, _LARGEST)))


def _smallest_maximum(a0: Array, a1: Array, b0: Array, b1: Array) -> Array:
    """Value where two lines on [0, 1] cross, one from a0 to a1, the other from b0 to b1; the larger if they do not."""
    start, end = a0 - b0, b1 - a1
    steady = np.maximum(np.minimum(a0, a1), np.minimum(b0, b1))
    cross = (start > 0.0) & (end > 0.0)
    part = start / np.where(cross, start + end, 1.0)
    return np.where(cross, np.maximum(a0 + part * (a1 - a0), steady), steady)
