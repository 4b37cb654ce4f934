"""Smallest distances along a motion, between its samples too, guaranteed to a tolerance.

The motion is divided into segments. A lower bound of the distance of a pair along a segment follows from the distances
at both ends and from bounds of the relative motion of both bodies. Where the bound is not below the smallest distance
that is known, the segment is done; else it is halved. coal therefore measures only pairs and times that matter.

The bounds hold for joints that move at constant rate. A bound of the deviation from constant rates is subtracted where
a segment contains further samples, or where an obstacle moves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Bool, Float, Int
from rnc_pin.collision.collision_distances import CollisionDistances
from rnc_pin.collision.distance_bounds import PlacedBodies
from rnc_pin.collision.motion_segments import SampledMotion
from rnc_pin.collision.pair_bounds import BoundKind, PairBounds, PairEnds
from rnc_pin.errors import InputError

TOLERANCE = 1e-3
"""Default tolerance of smallest distances [m]."""
_SHARE = 0.01  # of the radius of the largest link, for robots that are small
_FINEST = 2e-5  # [m]; coal's errors are below
_MOST_PLACES = 2_500  # places beside the samples: those of a diverged run have no end
_FIRST = 16  # samples between those of the first look
_SAME = 1e-7  # [m]; errors of coal: a sample that may be nearer by less is not measured
_UNCHANGED = 1e-5  # [m]; range of distances of a pair that counts as constant


@dataclass(frozen=True)
class ContinuousDistances:
    """Smallest distances of all pairs along a motion.

    Attributes:
        smallest: smallest distance (k,) of each pair [m]. Below ``within`` the motion has this distance at ``time``,
            and it is nowhere smaller by more than ``tolerance``; else the pair is nowhere nearer than ``within``.
        time: time (k,) of the smallest distance [s].
        constant: True (k,) for pairs whose distance is the same wherever it was measured.
        uncertain: True (k,) for pairs whose smallest distance is not certain to the tolerance, because the motion is
            too fast between its samples, as in a run that diverged.
        within: distance up to which smallest distances are exact [m].
        tolerance: their tolerance [m].
        curves: distances at samples, measured when they are asked for.
    """

    smallest: Float[Array, " k"]
    time: Float[Array, " k"]
    constant: Bool[Array, " k"]
    uncertain: Bool[Array, " k"]
    within: float
    tolerance: float
    curves: DistanceCurves


@dataclass(frozen=True)
class DistanceCurves:
    """Distances of pairs at the samples of a motion, for pictures.

    Attributes:
        distances: pairs of a robot and its obstacles.
        time: times (n,) of the samples [s].
        q: configurations (n, nq).
        within: distance up to which distances are exact [m].
    """

    distances: CollisionDistances
    time: Float[Array, " n"]
    q: Float[Array, "n nq"]
    within: float

    def of(self, pairs: Int[Array, " k"]) -> Float[Array, "n k"]:
        """Distances (n, k) of pairs [m]; lower bounds beyond ``within``."""
        found = np.empty((len(self.q), len(pairs)))
        for row, q, t in zip(found, self.q, self.time.tolist(), strict=True):
            self.distances.place(q, t)
            row[:] = _measured(self.distances, pairs, self.within)[:, 0]
        return found


def _measured(distances: CollisionDistances, pairs: Int[Array, " k"], within: float) -> Float[Array, "k 4"]:
    """Distances and normals of pairs, as placed. Beyond ``within`` lower bounds, with NaN as normals."""
    if within == np.inf:
        return distances.measure(pairs)[:, :4]
    found = np.full((len(pairs), 4), np.nan)
    found[:, 0] = distances.lower_bounds(pairs)
    near = np.flatnonzero(found[:, 0] < within)
    found[near] = distances.measure(pairs[near])[:, :4]
    return found


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
    exact: float | None = None,
) -> ContinuousDistances:
    """Find the smallest distance of each pair along a motion whose joints move at constant rate between samples.

    Args:
        distances: pairs of a robot and its obstacles.
        time: times (N,) of the motion [s], not decreasing.
        q: configurations (N, nq).
        within: distance up to which smallest distances are exact [m].
        tolerance: tolerance of the smallest distances [m]; ``default_tolerance`` by default.
        samples: samples that count, with the first and the last one; all by default. A smallest distance is not larger
            than the distance at any of them if this is below ``exact``.
        exact: distance up to which samples have no tolerance [m]; ``within`` by default. A smaller one is faster.

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
        >>> bool(found.smallest.min() < 0.0 < found.curves.of(np.arange(len(distances.pairs))).min())
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
    curves = DistanceCurves(distances, time[chosen], q[chosen], within)
    bounds = within, within if exact is None else exact, max(accuracy, _FINEST)
    return _Search(distances, motion, chosen, *bounds).result(curves)


class _Places:
    """Poses of all bodies at the places of a motion that are known so far."""

    def __init__(self) -> None:
        self._places: list[float] = []
        self._fresh: list[PlacedBodies] = []
        self._stacked: PlacedBodies | None = None

    def __len__(self) -> int:
        return len(self._places)

    def add(self, place: float, bodies: PlacedBodies) -> int:
        """Keep the poses of a place, and return its number."""
        self._places.append(place)
        self._fresh.append(bodies)
        return len(self._places) - 1

    def of(self, numbers: Int[Array, "s 2"]) -> Float[Array, "s 2"]:
        """Places by their numbers."""
        return np.array(self._places)[numbers]

    def stacked(self) -> PlacedBodies:
        """Poses of all bodies, with the place as first axis."""
        if self._fresh:
            fresh = PlacedBodies(*map(np.array, zip(*self._fresh, strict=True)))
            known = [fresh] if self._stacked is None else [self._stacked, fresh]
            self._stacked, self._fresh = PlacedBodies(*map(np.concatenate, zip(*known, strict=True))), []
        assert self._stacked is not None
        return self._stacked


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
    """Search for the smallest distances of one motion.

    Places are measured as far as the bounds do not show that they are not nearer, to the tolerance, than the smallest
    distance that is known. Samples that may be nearer than ``exact`` have no tolerance.
    """

    def __init__(
        self,
        distances: CollisionDistances,
        motion: SampledMotion,
        samples: Int[Array, " n"],
        within: float,
        exact: float,
        tolerance: float,
    ) -> None:
        self._distances, self._motion, self._samples = distances, motion, samples
        self._within, self._exact, self._tolerance = within, exact, tolerance
        self._places = _Places()
        count = len(distances.pairs)
        self._best, self._best_time = np.full(count, np.inf), np.zeros(count)
        self._largest = np.full(count, -np.inf)
        self._bounds = PairBounds(distances)

    def result(self, curves: DistanceCurves) -> ContinuousDistances:
        """Smallest distances, after a first look at every few samples."""
        entries, most = self._first_look(), len(self._samples) + _MOST_PLACES
        while len(entries.pair) and len(self._places) < most:
            entries = self._halved(entries)
        uncertain = np.zeros(len(self._best), dtype=bool)
        uncertain[entries.pair] = True
        kind = self._largest - self._best < _UNCHANGED, uncertain
        return ContinuousDistances(self._best, self._best_time, *kind, self._within, self._tolerance, curves)

    def _first_look(self) -> _Entries:
        """Distances at every few samples, and the pairs and segments between them that need a closer look."""
        every = np.arange(len(self._distances.pairs))
        last = len(self._samples) - 1
        looked = self._samples[np.unique(np.append(np.arange(0, last, _FIRST), last))] if len(every) else []
        known = np.array([self._look(float(sample), every, self._within)[1] for sample in looked])
        starts = np.arange(len(looked) - 1)
        if not len(starts):
            return _Entries(*(np.zeros(0, dtype=int),) * 3, *(np.zeros((0, 4)),) * 2)
        paths = self._motion.paths(self._places.of(np.column_stack([starts, starts + 1])).tolist())
        means = 0.5 * (known[:-1, :, 0] + known[1:, :, 0])
        doubtful = means - self._bounds.coarse(paths, self._places.stacked()) < self._target()
        rows, pairs = np.nonzero(doubtful)
        return self._undecided(_Entries(rows, rows + 1, pairs, known[rows, pairs], known[rows + 1, pairs]))

    def _halved(self, entries: _Entries) -> _Entries:
        """Measure pairs halfway along their segments, and return the halves that need a closer look."""
        ends, of_segment = _unique_segments(entries)
        middle = np.full(len(of_segment), -1)
        measured = np.full((len(of_segment), 4), np.nan)
        order = np.argsort(of_segment, kind="stable")
        cuts = np.searchsorted(of_segment[order], np.arange(len(ends) + 1))
        for k, place in enumerate(self._halfway(self._places.of(ends))):
            if place is None:
                continue
            which = order[cuts[k] : cuts[k + 1]]
            middle[which], measured[which] = self._look(place, entries.pair[which])
        kept = middle >= 0
        entries, middle, measured = entries.chosen(kept), middle[kept], measured[kept]
        return self._undecided(
            _Entries(
                np.concatenate([entries.start, middle]),
                np.concatenate([middle, entries.end]),
                np.tile(entries.pair, 2),
                np.concatenate([entries.at_start, measured]),
                np.concatenate([measured, entries.at_end]),
            )
        )

    def _undecided(self, entries: _Entries) -> _Entries:
        """Entries whose distance may fall below the smallest one that is known: the cheapest bound decides first."""
        for kind in get_args(BoundKind):
            entries = self._doubtful(entries, kind)
        return entries

    def _doubtful(self, entries: _Entries, kind: BoundKind) -> _Entries:
        """Entries that a bound does not decide."""
        if not len(entries.pair):
            return entries
        ends, of_segment = _unique_segments(entries)
        places = self._places.of(ends)
        displaced = self._motion.segments if kind == "steady" else self._motion.paths
        own = PairEnds(*vars(entries).values())
        bound = self._bounds.along(kind, own, displaced(places.tolist()), of_segment, self._places.stacked())
        first, last = self._inside(places)
        slack = np.where((first < last)[of_segment] & (bound < self._exact), _SAME, self._tolerance)
        return entries.chosen(np.flatnonzero(bound < self._target()[entries.pair] - slack))

    def _look(self, place: float, pairs: Int[Array, " k"], within: float = np.inf) -> tuple[int, Float[Array, "k 4"]]:
        """Number of a new place, and the distances and normals of pairs there, exact up to a distance [m]."""
        t = self._motion.time_at(place)
        number = self._places.add(place, self._distances.place(self._motion.configuration_at(place), t))
        found = _measured(self._distances, pairs, within)
        distance = found[:, 0]
        smaller = distance < self._best[pairs]
        self._best[pairs[smaller]], self._best_time[pairs[smaller]] = distance[smaller], t
        self._largest[pairs] = np.maximum(self._largest[pairs], distance)
        return number, found

    def _target(self) -> Array:
        return np.minimum(self._best, self._within)

    def _inside(self, places: Float[Array, "s 2"]) -> tuple[Int[Array, " s"], Int[Array, " s"]]:
        """First sample inside each segment, and the one after the last, as indices into the samples."""
        return np.searchsorted(self._samples, places[:, 0], "right"), np.searchsorted(self._samples, places[:, 1])

    def _halfway(self, places: Float[Array, "s 2"]) -> Iterator[float | None]:
        """Places about halfway, samples if there are some; None for segments that are not halved."""
        for (start, end), first, last in zip(places.tolist(), *self._inside(places), strict=True):
            inside = first < last
            yield float(self._samples[(first + last) // 2]) if inside else self._motion.halfway(start, end)


def _unique_segments(entries: _Entries) -> tuple[Int[Array, "s 2"], Int[Array, " k"]]:
    """Segments, each once, as numbers of both places; and the segment of each entry."""
    count = int(entries.end.max(initial=0)) + int(entries.start.max(initial=0)) + 1
    keys, of_segment = np.unique(entries.start * count + entries.end, return_inverse=True)
    return np.stack(np.divmod(keys, count), axis=1), of_segment.ravel()
