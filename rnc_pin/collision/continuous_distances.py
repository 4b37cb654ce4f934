"""Smallest distances along a motion, between its samples too, guaranteed to a tolerance.

The motion is divided into segments. A lower bound of the distance of a pair along a segment follows from the distances
at both ends and from bounds of the relative motion of both bodies. Where the bound is not below the smallest distance
that is known, the segment is done; else it is halved. coal therefore measures only pairs and times that matter.

The bounds hold for joints that move at constant rate. A bound of the deviation from constant rates is subtracted where
a segment contains further samples, or where an obstacle moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Bool, Float, Int
from rnc_pin.collision.collision_distances import CollisionDistances
from rnc_pin.collision.distance_bounds import ShapePoses
from rnc_pin.collision.motion_segments import SampledMotion, Segments
from rnc_pin.collision.pair_bounds import PairBounds, PairEnds
from rnc_pin.errors import InputError

TOLERANCE = 1e-3
"""Default tolerance of smallest distances [m]."""
_SHARE = 0.01  # of the radius of the largest link, for robots that are small
_FINEST = 2e-5  # [m]; coal's errors are below
_MOST_PLACES = 2_500  # places beside the samples: those of a diverged run have no end
_UNCHANGED = 1e-5  # [m]; range of distances of a pair that counts as constant


@dataclass(frozen=True)
class ContinuousDistances:
    """Smallest distances of all pairs along a motion.

    Attributes:
        smallest: smallest distance (k,) of each pair [m]. Below ``within`` the motion has this distance at ``time``,
            and it is nowhere smaller by more than ``tolerance``; else ``smallest`` is a lower bound of the samples.
        time: time (k,) of the smallest distance [s].
        constant: True (k,) for pairs whose distance does not change.
        uncertain: True (k,) for pairs whose smallest distance is not certain to the tolerance, because the motion is
            too fast between its samples, as in a run that diverged.
        within: distance up to which smallest distances are exact [m].
        tolerance: their tolerance [m].
        at_samples: distances (n, k) at the samples that were measured [m]. Beyond ``within`` they are lower bounds.
    """

    smallest: Float[Array, " k"]
    time: Float[Array, " k"]
    constant: Bool[Array, " k"]
    uncertain: Bool[Array, " k"]
    within: float
    tolerance: float
    at_samples: Float[Array, "n k"]


def default_tolerance(distances: CollisionDistances) -> float:
    """Tolerance of smallest distances [m]: 1 mm, or 1 % of the radius of the largest link of a small robot."""
    links = distances.radii[: distances.link_shapes]
    return float(np.clip(_SHARE * links.max(), _FINEST, TOLERANCE))


def continuous_distances(
    distances: CollisionDistances,
    time: Float[Array, " N"],
    q: Float[Array, "N nq"],
    within: float = 0.05,
    tolerance: float | None = None,
    samples: Int[Array, " n"] | None = None,
) -> ContinuousDistances:
    """Find the smallest distance of each pair along a motion whose joints move at constant rate between samples.

    Args:
        distances: pairs of a robot and its obstacles.
        time: times (N,) of the motion [s], not decreasing.
        q: configurations (N, nq).
        within: distance up to which smallest distances are exact [m].
        tolerance: tolerance of the smallest distances [m]; ``default_tolerance`` by default.
        samples: samples that are measured at first, with the first and the last one; all by default.

    Raises:
        InputError: times decrease, or do not belong to the configurations.
        ModelError: the robot has a joint of an unknown kind.

    Example:
        >>> import coal
        >>> robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
        >>> wall = rnc.collision.Obstacle(coal.Box(0.01, 2.0, 2.0), position=(1.0, 0.0, 0.0), name="wall")
        >>> distances = rnc.collision.CollisionDistances(robot, [wall])
        >>> q = np.array([robot.configuration(), robot.configuration()])
        >>> q[1, 0] = 2.0  # through the wall between two samples
        >>> found = rnc.collision.continuous_distances(distances, np.array([0.0, 1.0]), q)
        >>> bool(found.smallest.min() < 0.0 < found.at_samples.min())
        True
    """
    time, q = np.asarray(time, dtype=float), np.asarray(q, dtype=float)
    if q.ndim != 2 or time.shape != (len(q),) or not len(q):
        raise InputError(f"expected configurations (N, nq) and their times (N,), found shapes {q.shape}, {time.shape}")
    if not (np.diff(time) >= 0.0).all():
        raise InputError("the times of a motion must not decrease")
    accuracy = default_tolerance(distances) if tolerance is None else float(tolerance)
    if not accuracy > 0.0:
        raise InputError(f"the tolerance of distances has to be positive, found {accuracy:g} m")
    chosen = np.arange(len(q)) if samples is None else np.asarray(samples, dtype=int)
    motion = SampledMotion(distances.robot.model, time, q, distances.obstacles)
    return _Search(distances, motion, within, max(accuracy, _FINEST)).result(chosen)


class _Places:
    """Poses of all shapes and joints at the places of a motion that are known so far."""

    def __init__(self) -> None:
        self.places: list[float] = []
        self._rotations: list[Array] = []
        self._origins: list[Array] = []
        self._middles: list[Array] = []
        self._joints: list[Array] = []

    def add(self, place: float, poses: ShapePoses, joints: Array) -> int:
        """Keep the poses of a place, and return its number."""
        self.places.append(place)
        self._rotations.append(poses.rotations)
        self._origins.append(poses.origins)
        self._middles.append(poses.middles)
        self._joints.append(joints)
        return len(self.places) - 1

    def stacked(self) -> tuple[Array, Array, Array, Array]:
        """Rotations, origins and middles of shapes, and origins of joints, each with the place as first axis."""
        found = self._rotations, self._origins, self._middles, self._joints
        rotations, origins, middles, joints = (np.array(each) for each in found)
        return rotations, origins, middles, joints


@dataclass
class _Entries:
    """Pairs along segments: both ends and the numbers of the pair at both."""

    start: Array
    end: Array
    pair: Array
    at_start: Array
    at_end: Array

    def chosen(self, which: Array) -> _Entries:
        return _Entries(*(each[which] for each in vars(self).values()))


class _Search:
    """Search for the smallest distances of one motion."""

    def __init__(self, distances: CollisionDistances, motion: SampledMotion, within: float, tolerance: float) -> None:
        self._distances, self._motion = distances, motion
        self._within, self._tolerance = within, tolerance
        self._places = _Places()
        count = len(distances.pairs)
        self._best, self._best_time = np.full(count, np.inf), np.zeros(count)
        self._largest = np.full(count, -np.inf)
        self._bounds = PairBounds(distances)

    def result(self, samples: Int[Array, " n"]) -> ContinuousDistances:
        """Smallest distances, after a first look at some samples."""
        at_samples, entries = self._first_look(samples)
        most = len(samples) + _MOST_PLACES
        while len(entries.pair) and len(self._places.places) < most:
            entries = self._halved(entries)
        uncertain = np.zeros(len(self._best), dtype=bool)
        uncertain[entries.pair] = True
        kind = self._largest - self._best < _UNCHANGED, uncertain
        return ContinuousDistances(self._best, self._best_time, *kind, self._within, self._tolerance, at_samples)

    def _first_look(self, samples: Int[Array, " n"]) -> tuple[Float[Array, "n k"], _Entries]:
        """Distances at samples, and the pairs and segments between them that need a closer look."""
        count = len(self._distances.pairs)
        known = np.empty((len(samples), count))
        keys, normals = [], [np.zeros((0, 3))]  # of the distances that are exact
        for number, sample in enumerate(samples.tolist()):
            self._place(float(sample))
            known[number] = self._distances.lower_bounds()
            near = np.flatnonzero(known[number] < self._within)
            found = self._distances.measure(near)
            known[number, near] = found[:, 0]
            keys += (number * count + near).tolist()
            normals.append(found[:, 1:4])
            self._note(np.arange(count), known[number], self._motion.time_at(float(sample)))
        starts = np.arange(len(samples) - 1)
        if not (count and len(starts)):
            return known, _Entries(*(np.zeros(0, dtype=int),) * 3, *(np.zeros((0, 4)),) * 2)
        segments, stacked = self._segments(starts, starts + 1), self._places.stacked()
        means = 0.5 * (known[:-1] + known[1:])
        doubtful = means - self._bounds.coarse(segments, stacked) < self._target() - self._tolerance
        rows, pairs = np.nonzero(doubtful)
        exact, every = np.array(keys, dtype=int), np.concatenate([*normals, np.full((1, 3), np.nan)])

        def numbers(row: Array) -> Array:
            wanted = row * count + pairs
            place = np.searchsorted(exact, wanted)
            is_exact = np.append(exact, -1)[place] == wanted
            return np.column_stack([known[row, pairs], every[np.where(is_exact, place, len(exact))]])

        entries = _Entries(rows, rows + 1, pairs, numbers(rows), numbers(rows + 1))
        return known, entries.chosen(self._undecided(entries, segments, rows, stacked))

    def _halved(self, entries: _Entries) -> _Entries:
        """Measure pairs halfway along their segments, and return the halves that need a closer look."""
        ends, of_segment = np.unique(np.stack([entries.start, entries.end]), axis=1, return_inverse=True)
        of_segment = of_segment.ravel()
        middle = np.full(len(of_segment), -1)
        measured = np.full((len(of_segment), 4), np.nan)
        order = np.argsort(of_segment, kind="stable")
        cuts = np.searchsorted(of_segment[order], np.arange(ends.shape[1] + 1))
        for k, (start, end) in enumerate(ends.T.tolist()):
            place = self._motion.halfway(self._places.places[start], self._places.places[end])
            if place is None:
                continue
            which = order[cuts[k] : cuts[k + 1]]
            middle[which] = self._place(place)
            pairs = entries.pair[which]
            measured[which] = self._distances.measure(pairs)[:, :4]
            self._note(pairs, measured[which, 0], self._motion.time_at(place))
        kept = middle >= 0
        entries, middle, measured = entries.chosen(kept), middle[kept], measured[kept]
        halves = _Entries(
            np.concatenate([entries.start, middle]),
            np.concatenate([middle, entries.end]),
            np.tile(entries.pair, 2),
            np.concatenate([entries.at_start, measured]),
            np.concatenate([measured, entries.at_end]),
        )
        if not len(halves.pair):
            return halves
        ends, of_segment = np.unique(np.stack([halves.start, halves.end]), axis=1, return_inverse=True)
        segments = self._segments(*ends)
        return halves.chosen(self._undecided(halves, segments, of_segment.ravel(), self._places.stacked()))

    def _undecided(
        self, entries: _Entries, segments: Segments, rows: Array, stacked: tuple[Array, Array, Array, Array]
    ) -> Array:
        """Indices of entries whose distance may fall below the smallest one that is known."""
        bound = self._bounds.along(PairEnds(*vars(entries).values()), segments, rows, stacked)
        return np.flatnonzero(bound < self._target()[entries.pair] - self._tolerance)

    def _target(self) -> Array:
        return np.minimum(self._best, self._within)

    def _place(self, place: float) -> int:
        motion = self._motion
        poses, joints = self._distances.place(motion.configuration_at(place), motion.time_at(place))
        return self._places.add(place, poses, joints)

    def _note(self, pairs: Array, found: Array, t: float) -> None:
        smaller = found < self._best[pairs]
        self._best[pairs[smaller]], self._best_time[pairs[smaller]] = found[smaller], t
        self._largest[pairs] = np.maximum(self._largest[pairs], found)

    def _segments(self, starts: Array, ends: Array) -> Segments:
        places = self._places.places
        return self._motion.segments([(places[a], places[b]) for a, b in zip(starts, ends, strict=True)])
