"""Smallest distances along a motion, between its samples too, guaranteed to a tolerance.

The motion is divided into segments. A lower bound of the distance of a pair along a segment follows from the distances
at both ends and from bounds of the relative motion of both bodies. Where the bound is not below the smallest distance
that is known, the segment is done; else it is halved. coal therefore measures only pairs and times that matter.

The bounds hold for joints that move at constant rate. A bound of the deviation from constant rates is subtracted where
a segment contains further samples, or where an obstacle moves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from rnc_pin.array_shapes import Array, Bool, Float, Int
from rnc_pin.collision.collision_distances import CollisionDistances, PlacedBodies
from rnc_pin.collision.pair_bounds import PairBounds, PairEnds, SampledMotion
from rnc_pin.errors import InputError
from rnc_pin.printing import printed

TOLERANCE = 1e-3
"""Default tolerance of smallest distances [m]."""
_FINEST = 2e-5  # [m]; coal's errors are below


@printed(smallest="m", within="m", tolerance="m")
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
        curves: function of indices of pairs (k,) that measures their distances (n, k) at the samples [m]; beyond
            ``within`` lower bounds.
    """

    smallest: Float[Array, " k"]
    time: Float[Array, " k"]
    constant: Bool[Array, " k"]
    uncertain: Bool[Array, " k"]
    within: float
    tolerance: float
    curves: Callable[[Int[Array, " k"]], Float[Array, "n k"]] = field(repr=False)


def _curves(
    distances: CollisionDistances, time: Float[Array, " n"], q: Float[Array, "n nq"], within: float, pairs: Array
) -> Float[Array, "n k"]:
    """Distances of pairs at samples, for pictures."""
    parts = _chunks(len(q), len(pairs))
    return np.concatenate([_near(distances, distances.place(q[k], time[k]), pairs, within)[..., 0] for k in parts])


def _chunks(places: int, pairs: int) -> Iterator[slice]:
    """Parts of the places, so that memory is bounded."""
    chunk = 5_000  # pairs at places that are measured at a time: bounds memory
    size = max(chunk // max(pairs, 1), 1)
    return (slice(first, first + size) for first in range(0, places, size))


def _near(
    distances: CollisionDistances, placed: PlacedBodies, pairs: Int[Array, " k"], within: float | Float[Array, " k"]
) -> Float[Array, "n k 4"]:
    """Distances and normals of pairs at all places. Beyond ``within`` lower bounds, with NaN as normals."""
    found = np.full((len(placed.joints), len(pairs), 4), np.nan)
    found[..., 0] = distances.lower_bounds(placed, pairs)
    near = np.nonzero(found[..., 0] < within)
    found[near] = distances.measure(placed, near[0], pairs[near[1]])[:, :4]
    return found


def default_tolerance(distances: CollisionDistances) -> float:
    """Tolerance of smallest distances [m]: 1 mm, or 1 % of the radius of the largest link of a small robot.

    Args:
        distances: pairs of a robot and its obstacles.
    """
    links = distances.radii[: distances.link_shapes]
    share = 0.01  # of the radius of the largest link, for robots that are small
    return float(np.clip(share * links.max(), _FINEST, TOLERANCE))


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
        >>> bool(found.smallest.min() < 0.0 < found.curves(np.arange(len(distances.pairs))).min())
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
    curves = partial(_curves, distances, time[chosen], q[chosen], within)
    # Not finer than coal measures: a search for more would not end.
    bounds = within, within if exact is None else exact, max(accuracy, _FINEST)
    return _Search(distances, motion, chosen, *bounds).result(within, curves)


def too_near(
    distances: CollisionDistances,
    time: Float[Array, " N"],
    q: Float[Array, "N nq"],
    least: Float[Array, " k"],
    tolerance: float,
) -> int | None:
    """First pair that is found to be nearer than allowed along a motion.

    None if bounds show that no pair is nearer than its distance at samples, and less the tolerance between them.

    Args:
        distances: pairs of a robot and its obstacles.
        time: times (N,) of the motion [s], not decreasing.
        q: configurations (N, nq).
        least: smallest distance (k,) that each pair may have [m].
        tolerance: tolerance of the distances between samples [m].
    """
    motion = SampledMotion(distances.robot.model, time, q, distances.obstacles)
    exact = float(least.max(initial=0.0))
    return _Search(distances, motion, np.arange(len(q)), least, exact, max(tolerance, _FINEST)).violation()


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
        within: float | Float[Array, " k"],
        exact: float,
        tolerance: float,
    ) -> None:
        self._distances, self._motion, self._samples = distances, motion, samples
        self._within, self._exact, self._tolerance = within, exact, tolerance
        last = len(samples) - 1
        first_samples = 16  # between places of the first look at a long motion; a shorter one is seen at as many places
        apart = int(np.clip(last // first_samples, 1, first_samples))
        first = samples[np.unique(np.append(np.arange(0, last, apart), last))]
        self._places = first.astype(float)  # that are known so far; pairs have their numbers
        self._bodies = self._placed(self._places)
        count = len(distances.pairs)
        self._best, self._best_time = np.full(count, np.inf), np.zeros(count)
        self._largest = np.full(count, -np.inf)
        self._bounds = PairBounds(distances)

    def _placed(self, places: Float[Array, " n"]) -> PlacedBodies:
        """Poses of all bodies at places."""
        return self._distances.place(self._motion.configurations(places), self._motion.times(places))

    def result(self, within: float, curves: Callable[[Array], Array]) -> ContinuousDistances:
        """Smallest distances, after a first look at every few samples."""
        entries = self._refined(below=-np.inf)
        uncertain = np.zeros(len(self._best), dtype=bool)
        uncertain[entries.pair] = True
        unchanged = 1e-5  # [m]; range of distances of a pair that counts as constant
        kind = self._largest - self._best < unchanged, uncertain
        return ContinuousDistances(self._best, self._best_time, *kind, within, self._tolerance, curves)

    def violation(self) -> int | None:
        """First pair that is found below its distance, or that stays uncertain; None for none."""
        entries = self._refined(self._within)
        below = self._best - self._within
        # A measured violation is certain: it is named before a pair that no bound could decide.
        if below.min(initial=0.0) < 0.0:
            return int(np.argmin(below))
        return int(entries.pair[0]) if len(entries.pair) else None

    def _refined(self, below: float | Float[Array, " k"]) -> PairEnds:
        """Entries that stay uncertain, or that are left when a pair is found below a distance."""
        most_places = 2_500  # beside the samples: the places of a diverged run have no end
        # What is left at the limit is uncertain, not free: the result says so.
        entries, most = self._first_look(), len(self._samples) + most_places
        while len(entries.pair) and len(self._places) < most and not (self._best < below).any():
            entries = self._halved(entries)
        return entries

    def _first_look(self) -> PairEnds:
        """Distances at every few samples, and the pairs and segments between them that need a closer look."""
        every, places = np.arange(len(self._distances.pairs)), np.arange(len(self._places))
        bodies = self._bodies
        known = np.empty((len(places), len(every), 4))
        for part in _chunks(len(places), len(every)):
            known[part] = _near(self._distances, PlacedBodies(*(each[part] for each in bodies)), every, self._within)
            at = np.repeat(places[part], len(every))
            self._keep(at, np.tile(every, len(known[part])), known[part].reshape(-1, 4))
        paths = self._motion.paths(np.column_stack([self._places[:-1], self._places[1:]]))
        means = 0.5 * (known[:-1, :, 0] + known[1:, :, 0])
        # Most pairs of a robot are far apart: a bound for all pairs at once leaves few entries.
        doubtful = means - self._bounds.coarse(paths, bodies) < self._target()
        rows, pairs = np.nonzero(doubtful)
        return self._undecided(PairEnds(rows, rows + 1, pairs, known[rows, pairs], known[rows + 1, pairs]))

    def _halved(self, entries: PairEnds) -> PairEnds:
        """Measure pairs halfway along their segments, and return the halves that need a closer look."""
        ends, of_segment = _unique_segments(entries)
        halfway = self._halfway(self._places[ends])
        halved = np.isfinite(halfway)
        numbers = np.where(halved, len(self._places) + np.cumsum(halved) - 1, -1)
        both = self._bodies, self._placed(halfway[halved])
        self._bodies = PlacedBodies(*map(np.concatenate, zip(*both, strict=True)))
        self._places = np.concatenate([self._places, halfway[halved]])
        order = np.argsort(of_segment, kind="stable")
        order = order[halved[of_segment[order]]]
        entries, middle = entries.chosen(order), numbers[of_segment[order]]
        measured = self._distances.measure(self._bodies, middle, entries.pair)[:, :4]
        self._keep(middle, entries.pair, measured)
        before, after = entries._replace(end=middle, at_end=measured), entries._replace(start=middle, at_start=measured)
        return self._undecided(PairEnds(*map(np.concatenate, zip(before, after, strict=True))))

    def _undecided(self, entries: PairEnds) -> PairEnds:
        """Entries whose distance may fall below the smallest one that is known: the cheapest bound decides first."""
        same = 1e-7  # [m]; errors of coal: a sample that may be nearer by less is not measured
        # The bound by the path needs no displacements between samples: it is cheap and settles most pairs.
        for by_path in (True, False):
            if not len(entries.pair):
                break
            # Pairs share segments: bodies are placed once for all pairs of a segment.
            ends, of_segment = _unique_segments(entries)
            places = self._places[ends]
            segments = None if by_path else self._motion.segments(places)
            bound = self._bounds.along(entries, self._bodies, of_segment, self._motion.paths(places), segments)
            first, last = self._inside(places)
            # Samples inside count exactly up to ``exact``; between samples the tolerance holds.
            slack = np.where((first < last)[of_segment] & (bound < self._exact), same, self._tolerance)
            entries = entries.chosen(np.flatnonzero(bound < self._target()[entries.pair] - slack))
        return entries

    def _keep(self, places: Int[Array, " k"], pairs: Int[Array, " k"], measured: Float[Array, "k 4"]) -> None:
        """Keep the smallest and the largest distances of pairs; of equal ones the place with the lowest number."""
        distance = measured[:, 0]
        # The lowest number wins among equal distances, so that the result does not depend on the order of the search.
        order = np.lexsort([places, distance, pairs])
        nearest = order[np.unique(pairs[order], return_index=True)[1]]
        nearest = nearest[distance[nearest] < self._best[pairs[nearest]]]
        self._best[pairs[nearest]] = distance[nearest]
        self._best_time[pairs[nearest]] = self._motion.times(self._places[places[nearest]])
        np.maximum.at(self._largest, pairs, distance)

    def _target(self) -> Array:
        return np.minimum(self._best, self._within)

    def _inside(self, places: Float[Array, "s 2"]) -> tuple[Int[Array, " s"], Int[Array, " s"]]:
        """First sample inside each segment, and the one after the last, as indices into the samples."""
        return np.searchsorted(self._samples, places[:, 0], "right"), np.searchsorted(self._samples, places[:, 1])

    def _halfway(self, places: Float[Array, "s 2"]) -> Float[Array, " s"]:
        """Places about halfway, samples if there are some; NaN for segments that are not halved."""
        first, last = self._inside(places)
        samples = self._samples[np.minimum((first + last) // 2, len(self._samples) - 1)]
        return np.where(first < last, samples, self._motion.halfway(places))


def _unique_segments(entries: PairEnds) -> tuple[Int[Array, "s 2"], Int[Array, " k"]]:
    """Segments, each once, as numbers of both places; and the segment of each entry."""
    count = int(entries.end.max(initial=0)) + int(entries.start.max(initial=0)) + 1
    # One integer for two: numpy.unique of rows is many times slower.
    keys, of_segment = np.unique(entries.start * count + entries.end, return_inverse=True)
    return np.stack(np.divmod(keys, count), axis=1), of_segment.ravel()
