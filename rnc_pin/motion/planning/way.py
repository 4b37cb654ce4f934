"""Collision-free way of a reduced system, the check of its distances, its speeds, and motions along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Bool, Float, Int
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection, continuous_distances
from rnc_pin.collision.continuous_distances import default_tolerance, too_near
from rnc_pin.model.coordinates import ConfigurationManifold
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.planning.action_models import KinematicFlow
from rnc_pin.motion.planning.exact_steering import ExactMotion, base_axes
from rnc_pin.printing import printed
from rnc_pin.robots.joint_values import known_velocity_limits
from rnc_pin.robots.robot import Robot

_SAME = 1e-9  # change of the direction of planned velocities that is none

_HALVED = 1.0 - np.array([int(f"{k:04b}"[::-1], 2) for k in range(16)]) / 16.0
"""Fractions of a motion, in an order that finds collisions early: the end, the middle, the quarters, ..."""

Limits = tuple[Float[Array, " r"], Float[Array, " r"]]
"""Largest reduced velocities and accelerations; infinite without a limit."""


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


@printed(seconds="s")
@dataclass(frozen=True)
class WayInfo:
    """Record of the search for a way.

    Attributes:
        steering: kind of the exact steering; "propagated" if none is known.
        seconds: time of the search [s].
        edges: number of motions whose collisions were checked.
        goals: number of goal configurations.
    """

    steering: str
    seconds: float
    edges: int
    goals: int


@printed(v="rad/s or m/s", length="m")
@dataclass(frozen=True)
class Way:
    """Collision-free motion along which the constraint rows hold.

    Between nodes the planned joints move at constant rates by exact steering. Of propagated motions, the reduced
    velocities ``J2(q) v`` are constant. The velocity jumps at nodes, so that a robot has to stop there, or to follow a
    smoother motion beside the way.

    Attributes:
        reduced: the model.
        time: times (N,) of the nodes [s]. Joints keep the velocity limits of the robot's file; planned joints without
            a limit keep 1 rad/s or 1 m/s.
        q: configurations (N, nq).
        v: velocities (N - 1, nv) after the nodes.
        planned: mask (nv,) of the velocities that are planned; the joints of all others follow.
        length: length of the path of the base [m]; zero for a fixed base.
        residual: largest entry of ``A(q) v`` at the nodes, and halfway between them.
        info: record of the search.
        checker: distances that the way keeps; None without obstacles and shapes of links.
        geodesic: True if joints move at constant rates between nodes.
    """

    reduced: ReducedModel = field(repr=False)
    time: Float[Array, " n"]
    q: Float[Array, "n nq"]
    v: Float[Array, "k nv"]
    planned: Bool[Array, " nv"]
    length: float
    residual: float
    info: WayInfo
    checker: WayChecker | None = field(default=None, repr=False)
    geodesic: bool = True

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.time[-1])

    @cached_property
    def narrowest(self) -> NarrowPlace | None:
        """Narrowest place beside obstacles; None if none is nearer than 1 m. It is measured when it is asked for."""
        if self.checker is None or not len(self.v):
            return None
        seen = 1.0  # [m]; the narrowest place is looked for within this distance
        return self.checker.narrowest(self.time, self.q, seen)

    def at(self, t: ArrayLike) -> Float[Array, "*k nq"]:
        """Configurations (..., nq) at times [s]; those of the ends before and after the way.

        Args:
            t: a time, or times (k,).
        """
        times = np.clip(np.atleast_1d(np.asarray(t, dtype=float)), 0.0, self.duration)
        if not len(self.v):
            found = np.repeat(self.q, len(times), axis=0)
        else:
            k = self._before(times)
            v, since = self.v[k], (times - self.time[k])[:, None]
            if self.geodesic:  # no evaluation of the rows: the check of distances asks for many times
                found = ConfigurationManifold(self.reduced.robot.model).integrate(self.q[k], since * v)
            else:
                planned = None if self.info.steering == "propagated" else self.planned
                u = np.matvec(self.reduced.at(self.q[k]).J2, v) if planned is None else v[:, planned]
                found = KinematicFlow(self.reduced, planned).step(self.q[k], since * u)
        return found[0] if np.ndim(t) == 0 else found

    def reduced_velocity(self, t: float) -> Float[Array, " r"]:
        """Reduced velocities (r,) at a time [s]: ``v = R(q) v2``."""
        return np.array(self.reduced.at(self.at(t)).J2 @ self.v[self._before(t)])

    def _before(self, t: ArrayLike) -> Int[Array, "*k"]:
        """Nodes before times."""
        return np.clip(np.searchsorted(self.time, t, "right") - 1, 0, len(self.v) - 1)


def drive_times(steps: Float[Array, "k nv"], speeds: Float[Array, " nv"]) -> Float[Array, " k"]:
    """Durations (k,) of displacements at the largest speeds [s]."""
    return (np.abs(steps) / speeds).max(axis=1, initial=0.0)


def speed_limits(reduced: ReducedModel, planned: Bool[Array, " nv"]) -> Float[Array, " nv"]:
    """Largest speeds (nv,) of the robot's file; without one, 1 m/s or 1 rad/s, and any speed for joints that follow."""
    limits = known_velocity_limits(reduced.robot.model)
    usual_speed = 1.0  # [m/s or rad/s] of a joint without a limit
    return np.where(np.isfinite(limits) | ~planned, limits, usual_speed)


def way_along(
    reduced: ReducedModel, planned: Bool[Array, " nv"], checker: WayChecker | None, motion: ExactMotion, info: WayInfo
) -> Way:
    """Way along a motion of all joints, at the largest speeds.

    Args:
        reduced: the model.
        planned: mask (nv,) of the velocities that are planned.
        checker: distances to obstacles.
        motion: displacements of all joints.
        info: record of the search.
    """
    durations = drive_times(motion.steps, speed_limits(reduced, planned))
    # Joints that follow slow down all of a straight motion alike, so that its velocity does not jump.
    sizes, first = _straight(np.where(planned, motion.steps, 0.0), _SAME)
    slowest = np.minimum.reduceat(sizes / durations, first)
    durations = sizes / np.repeat(slowest, np.diff(np.append(first, len(sizes))))
    time = np.concatenate([[0.0], np.cumsum(durations)])
    v = motion.steps / durations[:, None]
    for array in (time, motion.q, v):
        array.setflags(write=False)
    length = float(np.linalg.norm(motion.steps[:, : base_axes(reduced.robot.model)], axis=1).sum())
    residual = _residual(reduced, motion, v)
    return Way(reduced, time, motion.q, v, planned, length, residual, info, checker, motion.geodesic)


def _residual(reduced: ReducedModel, motion: ExactMotion, v: Array) -> float:
    """Largest entry of ``A(q) v`` at the nodes; for geodesics also halfway and at their ends."""
    places = [motion.q[:-1]]
    if motion.geodesic:  # other motions have these velocities at their nodes alone
        middles = ConfigurationManifold(reduced.robot.model).integrate(motion.q[:-1], 0.5 * motion.steps)
        places += [middles, motion.q[1:]]
    return max(float(np.abs(np.matvec(reduced.at(each).A, v)).max(initial=0.0)) for each in places)


class _Pieces(NamedTuple):
    """Way in places: lengths in the reduced coordinates, by the largest entry of each step."""

    k: Int[Array, " n"]
    """Nodes after which the way moves."""
    directions: Float[Array, "n r"]
    """Reduced velocities there, of largest entry one."""
    ends: Float[Array, " n1"]
    """Places where the motions after these nodes begin, and the place of the goal."""
    stops: Float[Array, " m1"]
    """Places at which the direction jumps, begin and end."""
    speeds: Float[Array, " m"]
    """Largest speed between stops."""
    rates: Float[Array, " m"]
    """Largest rate of the speed between stops."""

    def loads(self, counts: Int[Array, " m"], h: float) -> tuple[Int[Array, " m"], Float[Array, " m"], Array]:
        """Intervals of length h in which the speed rises, and falls; its top; and how much faster than bounds it is."""
        # A quarter of the intervals each: the peak of the speed is then 4/3 of its mean, and the rate moderate.
        ramps = np.maximum(counts // 4, 1)
        top = np.diff(self.stops) / (h * (counts - ramps))
        return ramps, top, np.maximum(top / self.speeds, np.sqrt(top / (h * ramps * self.rates)))

    def counts(self, intervals: int, duration: float) -> Int[Array, " m"]:
        """Intervals of each piece: each one more is for the piece whose motion exceeds its bounds most."""
        counts = np.full(len(self.speeds), 2)  # one to speed up, one to stop
        for _ in range(intervals - counts.sum()):
            loads = self.loads(counts, duration / intervals)[-1]
            counts[np.argmax(loads > (1.0 - _SAME) * loads.max())] += 1  # rounding does not decide
        return counts


def _straight(steps: Float[Array, "n k"], jump: float) -> tuple[Float[Array, " n"], Int[Array, " m"]]:
    """Sizes of steps, and the first of all those in a row with the same direction, up to a jump."""
    sizes = np.abs(steps).max(axis=1)
    return sizes, np.flatnonzero(np.abs(np.diff(steps / sizes[:, None], axis=0, prepend=2.0)).max(axis=1) > jump)


def _pieces(way: Way, limits: Limits) -> _Pieces:
    u = np.matvec(way.reduced.at(way.q[:-1]).J2, way.v)
    k = np.flatnonzero(np.abs(u).max(axis=1))
    jump = 1e-6  # change of the direction of reduced velocities above which a motion stops in between
    turn = 0.02  # of propagated ways, whose nodes give velocities to the accuracy of a step
    sizes, first = _straight(u[k], jump if way.geodesic else turn)
    ends = np.concatenate([[0.0], np.cumsum(sizes * np.diff(way.time)[k])])
    directions = u[k] / sizes[:, None]
    with np.errstate(divide="ignore"):
        speeds, rates = (np.minimum.reduceat((each / np.abs(directions)).min(axis=1), first) for each in limits)
    speeds = np.minimum(speeds, np.minimum.reduceat(sizes, first))
    return _Pieces(k, directions, ends, ends[np.append(first, len(k))], speeds, rates)


def intervals_along(way: Way, least: int, duration: float, limits: Limits) -> int:
    """Number of intervals in which ``motion_along`` stops where it has to, and keeps its bounds.

    Args:
        way: a way that moves.
        least: number to begin with; it is doubled up to three times, unless even that leaves no time to stop.
        duration: duration of the motion [s].
        limits: as for ``motion_along``.
    """
    pieces, found = _pieces(way, limits), least
    for intervals in [least * 2**doubled for doubled in range(4)]:
        counts = pieces.counts(intervals, duration)
        if counts.sum() > intervals:
            continue
        found = intervals
        if (pieces.loads(counts, duration / intervals)[-1] <= 1.0).all():
            break
    return found


def motion_along(
    way: Way, intervals: int, duration: float, limits: Limits
) -> tuple[Float[Array, "n nq"], Float[Array, "n r"], Float[Array, "k r"]]:
    """Configurations and reduced velocities (K + 1, r) at equal times, and the means of these over the intervals.

    The motion starts and ends at rest, and stops where the direction of the reduced velocities jumps. In between, they
    keep their direction, and the reduced acceleration is constant over each interval: so the motion is exact where the
    way is. With less than two intervals for each piece, the speed is constant. Pieces share the time so that none
    exceeds its bounds by more than others have to: the speeds of the way, and the limits.

    Args:
        way: a way that moves.
        intervals: number K of intervals.
        duration: duration [s].
        limits: largest reduced velocities and accelerations (r,).
    """
    pieces, h = _pieces(way, limits), duration / intervals
    counts = pieces.counts(intervals, duration)
    speed = np.full(intervals + 1, pieces.ends[-1] / duration)
    # Else pieces need more intervals than there are, and the caller has to accept a motion that does not stop.
    if counts.sum() == intervals:
        ramps, top, _ = pieces.loads(counts, h)
        within = np.concatenate([np.arange(count) for count in counts])
        left, ramp = np.repeat(counts, counts) - within, np.repeat(ramps, counts)
        speed[:-1] = np.repeat(top, counts) * np.minimum(np.minimum(within, left) / ramp, 1.0)
        speed[-1] = 0.0
    mean = 0.5 * (speed[:-1] + speed[1:])
    places = np.concatenate([[0.0], np.cumsum(h * mean)])
    # The mean velocity of an interval belongs to the piece of its middle: its ends may be corners.
    middle = np.searchsorted(pieces.ends, 0.5 * (places[:-1] + places[1:]), "right") - 1
    along = pieces.directions[np.clip(middle, 0, len(pieces.k) - 1)]
    at = np.clip(np.searchsorted(pieces.ends, places, "right") - 1, 0, len(pieces.k) - 1)
    share = np.clip((places - pieces.ends[at]) / np.diff(pieces.ends)[at], 0.0, 1.0)
    times = way.time[pieces.k[at]] + share * np.diff(way.time)[pieces.k[at]]
    return way.at(times), speed[:, None] * pieces.directions[at], mean[:, None] * along
