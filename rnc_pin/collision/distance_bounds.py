"""Lower bounds of distances, from bounding volumes and from motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.array_shapes import Float, Int


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
        # One place, in a control loop: the kernel avoids the overhead of NumPy. Many places share their cost.
        if joints.ndim == 2:
            found = cls.__new__(cls)
            found.rotations, found.origins, found.middles = (np.empty(a.shape) for a in (rotations, origins, origins))
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
        """Bounds of these pairs [m], from spheres and from boxes along the axes of the world.

        Args:
            at: poses of all shapes, at one place or at n.
            pairs: indices of the pairs (k,); all by default.
        """
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

        A distance decreases at most by the motion of both bodies: of the centre, and of the rotation about it
        at the corner of the box. So pairs that were far need no volumes until they may be near.

        Args:
            at: poses of all shapes at one place.
            within: the distance [m].
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
        few = 6  # pairs for which bounds of volumes cost more than distances
        if len(fresh) > few:
            self._known[fresh] = np.maximum(self._known[fresh], self.of_volumes(at, fresh))
            # A fresh pair was known by its motion only; bounds of volumes may show that it is far.
            near = near[self._known[near] < within]
        self._measured[:] = False
        return near

    def _moved_by_kernel(self, at: ShapePoses, last: ShapePoses) -> bool:
        """Decrease the bounds by the motion since the last poses; False if NumPy has to."""
        return _kernel.library.pair_bounds(
            at.rotations, at.middles, last.rotations, last.middles, self._radii, self._shapes, self._known
        )

    def measured(self, pairs: Int[Array, " n"], distances: Float[Array, " n"]) -> None:
        """Remember the distances [m] of pairs at the poses of ``nearby``.

        Args:
            pairs: indices of the pairs.
            distances: their measured distances [m].
        """
        tolerance = 1e-5  # [m] of coal's error, with a margin: a measured distance less this is a lower bound
        self._known[pairs] = distances - tolerance
        self._measured[pairs] = True


def _product(left: Float[Array, "*k 3 3"], right: Float[Array, "*k 3 c"]) -> Float[Array, "*k 3 c"]:
    """Matrix products with the order of additions of the compiled kernel: coal then sees the same bits."""
    first, second, third = (left[..., k : k + 1] * right[..., k : k + 1, :] for k in range(3))
    return first + second + third
