"""Lower bounds of distances, from bounding volumes and from motion, and corners of contacts, which bound the rates.

Corners belong to the region where two bodies are nearest: parallel faces, a face along an edge, parallel edges.
Between parallel faces the nearest points are not unique, and the rate at one of them says nothing about the others: a
body that turns brings a corner nearer. Along the normal the gap is linear over the common region of both faces. So its
smallest value is always at a corner of that region, and rates at all corners bound it.
"""

from __future__ import annotations

from typing import NamedTuple

import coal
import numpy as np
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.array_shapes import Float, Int

_TOLERANCE = 1e-5
"""Bound of coal's error [m], with a margin: a measured distance less this is a lower bound."""

_FEW = 6  # pairs for which bounds of volumes cost more than distances


class ShapePoses:
    """Poses of all shapes, at one place of a motion or at many, which are then the first axis.

    Args:
        rotations: (..., s, 3, 3) in the world.
        origins: (..., s, 3) in the world [m].
        centers: centres of the boxes around the shapes, in their own frames (s, 3) [m].

    Attributes:
        middles: these centres in the world (..., s, 3) [m].
    """

    __slots__ = ("middles", "origins", "rotations")

    def __init__(self, rotations: Array, origins: Array, centers: Array) -> None:
        self.rotations, self.origins = rotations, origins
        self.middles = origins + np.matvec(rotations, centers)

    @classmethod
    def carried(cls, joints: Array, carriers: Array, rotations: Array, origins: Array, centers: Array) -> ShapePoses:
        """Poses of shapes that joints carry.

        Args:
            joints: placements of all joints (..., njoints, 12): the columns of a rotation, then a translation.
            carriers: joint of each of the first shapes (k,); further shapes are in the world.
            rotations, origins: poses of all shapes in their joints (..., s, 3, 3) and (..., s, 3).
            centers: as for the class.
        """
        if joints.ndim == 2:
            found = cls.__new__(cls)
            found.rotations, found.origins, found.middles = (
                np.empty(each.shape) for each in (rotations, *[origins] * 2)
            )
            known = joints, carriers, rotations.reshape(-1, 9), origins, centers
            if _kernel.library.shape_poses(*known, found.rotations, found.origins, found.middles):
                return found
        rotations, origins, count = rotations.copy(), origins.copy(), len(carriers)
        carrying = joints.take(carriers, -2)
        turns = carrying[..., :9].reshape(*carrying.shape[:-1], 3, 3).swapaxes(-1, -2)
        origins[..., :count, :] = _product(turns, origins[..., :count, :, None])[..., 0] + carrying[..., 9:]
        rotations[..., :count, :, :] = _product(turns, rotations[..., :count, :, :])
        return cls(rotations, origins, centers)


class PlacedBodies(NamedTuple):
    """Poses of all bodies in the world at n places of a motion.

    Attributes:
        rotations: rotations (n, s, 3, 3) of the shapes.
        still: the same, with shapes that spin about their own axes as if they did not.
        origins: origins (n, s, 3) of the shapes [m].
        middles: centres (n, s, 3) of the boxes around the shapes [m].
        joints: origins (n, j, 3) of all joints, then of the obstacles that move [m].
        axes: axes (n, j, 3) about which they turn; NaN for joints that turn about several ones, or none.
    """

    rotations: Array
    still: Array
    origins: Array
    middles: Array
    joints: Array
    axes: Array


class DistanceBounds:
    """Lower bounds of the distances of pairs of shapes.

    Args:
        first, second: shapes of each pair (k,).
        halves: half sides of the boxes around the shapes, in their own frames (s, 3) [m].
    """

    def __init__(self, first: Int[Array, " k"], second: Int[Array, " k"], halves: Float[Array, "s 3"]) -> None:
        self._first, self._second, self._halves = first, second, halves
        self._shapes = np.array([first, second])
        self._radii = np.linalg.norm(halves, axis=1)
        self._reach = self._radii[first] + self._radii[second]
        self._last: ShapePoses | None = None
        self._known = np.zeros(len(first))
        self._measured = np.zeros(len(first), dtype=bool)

    def of_volumes(self, at: ShapePoses | PlacedBodies, pairs: Array | slice = slice(None)) -> Float[Array, "*n k"]:
        """Bounds of these pairs [m], from spheres and from boxes along the axes of the world."""
        first, second = self._first[pairs], self._second[pairs]
        halves = np.matvec(np.abs(at.rotations), self._halves)
        apart = np.abs(at.middles.take(second, -2) - at.middles.take(first, -2))
        spheres = np.sqrt(np.vecdot(apart, apart)) - self._reach[pairs]
        apart -= halves.take(first, -2)
        apart -= halves.take(second, -2)
        gaps = np.maximum(apart, 0.0, out=apart)
        # A sphere's bound is negative where spheres overlap, a box's bound is then zero.
        return np.maximum(np.sqrt(np.vecdot(gaps, gaps)), spheres, where=gaps.any(axis=-1), out=spheres)

    def nearby(self, at: ShapePoses, within: float) -> Int[Array, " n"]:
        """Pairs that may be nearer than a distance [m].

        A distance decreases at most by the motion of both bodies: that of the centre, and that of the rotation about it
        at the corner of the box. So pairs that were far need no volumes until they may be near.
        """
        if self._last is None:
            self._known = self.of_volumes(at)
            self._measured[:] = True
        elif not self._moved_by_kernel(at, self._last):
            turn = (at.rotations - self._last.rotations).reshape(-1, 9)
            shift = at.middles - self._last.middles
            # The norm of a difference of rotations is its Frobenius norm over the root of two.
            moved = np.sqrt(np.vecdot(shift, shift)) + np.sqrt(0.5 * np.vecdot(turn, turn)) * self._radii
            self._known -= moved.take(self._first)
            self._known -= moved.take(self._second)
        self._last = at
        near = np.flatnonzero(self._known < within)
        fresh = near[~self._measured[near]]
        if len(fresh) > _FEW:
            self._known[fresh] = np.maximum(self._known[fresh], self.of_volumes(at, fresh))
            near = near[self._known[near] < within]
        self._measured[:] = False
        return near

    def _moved_by_kernel(self, at: ShapePoses, last: ShapePoses) -> bool:
        """Decrease the bounds by the motion since the last poses; False if NumPy has to."""
        return _kernel.library.pair_bounds(
            at.rotations, at.middles, last.rotations, last.middles, self._radii, self._shapes, self._known
        )

    def measured(self, pairs: Int[Array, " n"], distances: Float[Array, " n"]) -> None:
        """Remember the distances [m] of pairs at the poses of ``nearby``."""
        self._known[pairs] = distances - _TOLERANCE
        self._measured[pairs] = True


def _product(left: Float[Array, "*k 3 3"], right: Float[Array, "*k 3 c"]) -> Float[Array, "*k 3 c"]:
    """Matrix products with the order of additions of the compiled kernel: coal then sees the same bits."""
    first, second, third = (left[..., k : k + 1] * right[..., k : k + 1, :] for k in range(3))
    return first + second + third


# ------------------------------------------------------------------ corners of contacts

_ANGLE = 0.02  # [rad] below which faces count as parallel: they may become so within a sample
_SIDES = 8
MOST_CORNERS = 8
"""Largest number of corners of one pair."""

_RIM = np.linspace(0.0, 2 * np.pi, _SIDES, endpoint=False)
_OCTAGON = np.stack([np.cos(_RIM), np.sin(_RIM), 0.0 * _RIM], axis=1) / np.cos(np.pi / _SIDES)
"""Corners of the octagon around a unit circle."""
_PLANE = 1e4  # [m]; half side of the square that stands for a plane
_SQUARE = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


class FlatParts:
    """Faces and edges of a convex shape, found by direction.

    Args:
        shape: box, cylinder, capsule, hull or half space; other shapes have no flat parts.
    """

    def __init__(self, shape: coal.CollisionGeometry) -> None:
        self._radius, self._half, points = 0.0, 0.0, np.zeros((0, 3))
        if isinstance(shape, coal.Box):
            points = _CORNERS * shape.halfSide
        elif isinstance(shape, coal.Convex):
            points = np.array(shape.points())
        elif isinstance(shape, coal.Halfspace):
            normal = np.ravel(shape.n)
            across = np.linalg.svd(normal[None])[2][1:]
            points = shape.d * normal + _PLANE * (_SQUARE @ across)
        elif isinstance(shape, coal.Capsule | coal.Cylinder):
            points = np.array([[0.0, 0.0, -shape.halfLength], [0.0, 0.0, shape.halfLength]])
            self._radius = float(shape.radius)
            self._half = float(shape.halfLength) if isinstance(shape, coal.Cylinder) else 0.0
        self._points = points
        self._slack = _ANGLE * float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0

    def towards(self, direction: Float[Array, " 3"]) -> Float[Array, "k 3"]:
        """Corners of the face or edge that is foremost in a unit direction, in the frame of the shape [m]."""
        points, slack = self._points, self._slack
        if self._half:  # a cylinder: the face at one end, or the line along its side
            along, across = float(direction[2]), direction * (1.0, 1.0, 0.0)
            width = float(np.linalg.norm(across))
            if width < _ANGLE:
                return self._radius * _OCTAGON + [0.0, 0.0, np.copysign(self._half, along)]
            points = points + self._radius / width * across
        elif self._radius:
            points = points + self._radius * direction
        if len(points) < 2:
            return points
        heights = points @ direction
        return np.asarray(points[heights > heights.max() - slack - 1e-9])


def common_corners(
    first: Float[Array, "a 3"], second: Float[Array, "b 3"], normal: Float[Array, " 3"]
) -> Float[Array, "k 7"]:
    """Return gap, point of the first and point of the second body at each corner of the common region.

    Args:
        first: corners of the face or edge of the first body [m].
        second: those of the second body, in the same frame [m].
        normal: unit vector from the first to the second body.

    Returns:
        At most eight corners (k, 7); none if the bodies meet at a point.
    """
    if len(first) < 2 or len(second) < 2:
        return np.zeros((0, 7))
    axis = np.eye(3)[int(np.abs(normal).argmin())]
    u = np.cross(normal, axis)
    u /= np.linalg.norm(u)
    plane = np.stack([u, np.cross(normal, u)])
    a, b = _hull(first @ plane.T), _hull(second @ plane.T)
    if len(a) == len(b) == 2:
        ahead, across = np.subtract(a[1], a[0]), np.subtract(b[1], b[0])
        if abs(ahead[0] * across[1] - ahead[1] * across[0]) > _ANGLE * np.linalg.norm(ahead) * np.linalg.norm(across):
            return np.zeros((0, 7))  # crossing edges meet at a point
    region = np.array(_clipped(a, b) if len(b) > 2 or len(a) < 3 else _clipped(b, a))
    if len(region) < 2 or np.ptp(region, axis=0).max() < 1e-6:
        return np.zeros((0, 7))
    if len(region) > MOST_CORNERS:  # the corners that are foremost in eight directions
        region = region[sorted({int(k) for k in (region @ _OCTAGON[:, :2].T).argmax(axis=0)})]
    low, high = _heights(first, normal, plane, region), _heights(second, normal, plane, region)
    base = region @ plane
    return np.hstack([(high - low)[:, None], base + low[:, None] * normal, base + high[:, None] * normal])


def _heights(points: Array, normal: Array, plane: Array, region: Array) -> Array:
    """Heights along the normal, at places of the plane, of the face or edge through points."""
    middle = points.mean(axis=0)
    offsets = points - middle
    slope = np.linalg.lstsq(offsets @ plane.T, offsets @ normal, rcond=1e-9)[0]
    return np.asarray(middle @ normal + (region - plane @ middle) @ slope)


def _hull(points: Array) -> list[tuple[float, float]]:
    """Corners of the convex hull of points in the plane, counterclockwise."""
    ordered = sorted({(round(x, 12), round(y, 12)) for x, y in points.tolist()})
    if len(ordered) < 3:
        return ordered

    def chain(given: list[tuple[float, float]]) -> list[tuple[float, float]]:
        found: list[tuple[float, float]] = []
        for point in given:
            while len(found) > 1 and _turn(found[-2], found[-1], point) <= 1e-12:
                found.pop()
            found.append(point)
        return found[:-1]

    return chain(ordered) + chain(ordered[::-1])


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _clipped(subject: list[tuple[float, float]], window: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Part of a polygon or segment inside a convex polygon or beside a segment (Sutherland and Hodgman 1974)."""
    for x, y, limit in _half_planes(window):
        ahead = subject[1:] + (subject[:1] if len(subject) > 2 else [])
        found: list[tuple[float, float]] = []
        for k, (px, py) in enumerate(subject):
            p = x * px + y * py - limit
            if p <= 0.0:
                found.append((px, py))
            if k < len(ahead):
                q = x * ahead[k][0] + y * ahead[k][1] - limit
                if p * q < 0.0:
                    share = p / (p - q)
                    found.append((px + share * (ahead[k][0] - px), py + share * (ahead[k][1] - py)))
        subject = found
    return subject


def _half_planes(window: list[tuple[float, float]]) -> list[tuple[float, float, float]]:
    """Half planes ``x px + y py <= limit`` of a convex polygon; of a segment, a narrow strip along it."""
    found = []
    for (ax, ay), (bx, by) in zip(window, window[1:] + window[:1], strict=True):
        x, y = by - ay, ax - bx  # outward
        length = float(np.hypot(x, y))
        if length > 1e-12:
            x, y = x / length, y / length
            room = _ANGLE * length if len(window) == 2 else 1e-12
            found.append((x, y, x * ax + y * ay + room))
            if len(window) == 2:  # and the end of the segment
                found.append((-y, x, -y * bx + x * by))
    return found
