"""Collision-free way of a reduced system from one configuration to another, and its timing."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Bool, Float, Int
from rnc_pin.collision import Obstacle
from rnc_pin.model.configuration_manifold import ConfigurationManifold
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.planning.action_models import KinematicFlow
from rnc_pin.planning.exact_steering import ExactMotion, base_axes
from rnc_pin.planning.way_checking import NarrowPlace, WayChecker
from rnc_pin.planning.way_search import drive_times, speed_limits
from rnc_pin.printing import Line, ObjectSummary, SummaryMixin, counted, items

_JUMP = 1e-6  # change of the direction of reduced velocities above which a motion stops in between
_TURN = 0.02  # the same for propagated ways, whose nodes give velocities to the accuracy of a step
_SEEN = 1.0  # [m]; the narrowest place is looked for within this distance


@dataclass(frozen=True, repr=False)
class WayInfo:
    """Record of the search for a way.

    Attributes:
        steering: kind of the exact steering; "propagated" if none is known.
        seconds: time of the search [s].
        edges: number of motions whose collisions were checked.
        goals: number of goal configurations.
        first_duration: duration of the first way, before it was shortened [s].
        history: number of checked motions and duration [s] of each way that was faster than those before, to this one.
    """

    steering: str
    seconds: float
    edges: int
    goals: int
    first_duration: float
    history: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, repr=False)
class Way(SummaryMixin):
    """Collision-free motion along which the constraint rows hold.

    The reduced velocities ``J2(q) v`` are constant between nodes. By exact steering, joints move at constant rates too:
    a node is followed by a geodesic. The velocity jumps at nodes, so that a robot has to stop there, or to follow a
    smoother motion beside the way.

    Attributes:
        reduced: the model.
        time: times (N,) of the nodes [s]. Joints keep the velocity limits of the robot's file; planned joints without
            a limit keep 1 rad/s or 1 m/s.
        q: configurations (N, nq).
        v: velocities (N - 1, nv) after the nodes.
        length: length of the path of the base [m]; zero for a fixed base.
        residual: largest entry of ``A(q) v`` at the nodes, and halfway between them.
        info: record of the search.
        checker: distances that the way keeps; None without obstacles and shapes of links.
        geodesic: True if joints move at constant rates between nodes.
    """

    reduced: ReducedModel
    time: Float[Array, " n"]
    q: Float[Array, "n nq"]
    v: Float[Array, "k nv"]
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
        return self.checker.narrowest(self.time, self.q, _SEEN)

    @cached_property
    def _manifold(self) -> ConfigurationManifold:
        return ConfigurationManifold(self.reduced.robot.model)

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
            if self.geodesic:
                found = self._manifold.integrate(self.q[k], since * v)
            else:
                u = np.einsum("nij,nj->ni", self.reduced.at(self.q[k]).J2, v)
                found = KinematicFlow(self.reduced).step(self.q[k], since * u)
        return found[0] if np.ndim(t) == 0 else found

    def reduced_velocity(self, t: float) -> Float[Array, " r"]:
        """Reduced velocities (r,) at a time [s]: ``v = R(q) v2``."""
        return np.array(self.reduced.at(self.at(t)).J2 @ self.v[self._before(t)])

    def _before(self, t: ArrayLike) -> Int[Array, "*k"]:
        """Nodes before times."""
        return np.clip(np.searchsorted(self.time, t, "right") - 1, 0, len(self.v) - 1)

    def _summary(self) -> ObjectSummary:
        lines: list[Line] = [
            ("length of the path of the base", items([f"{self.length:.3g} m"])),
            ("duration", items([f"{self.duration:.3g} s, {self.info.first_duration:.3g} s before it was shortened"])),
            ("nodes", items([f"{len(self.q)}"])),
            ("residual of constraint rows", items([f"{self.residual:.1g}"])),
        ]
        waits = float(np.diff(self.time)[~self.v.any(axis=1)].sum())
        if waits:
            lines.append(("waits for obstacles that move", items([f"{waits:.3g} s"])))
        if self.narrowest is not None:
            place = self.narrowest
            lines.append(("narrowest place", items([f"{place.distance:.3g} m at {place.time:.3g} s, {place.pair}"])))
        found = f"found in {self.info.seconds:.2g} s, {counted(self.info.edges, 'motion')} checked"
        how = "steering" if self.geodesic else "motions"
        return ObjectSummary(f"Way by {self.info.steering} {how}", [*lines, ("search", items([found]))])


def way_along(
    reduced: ReducedModel,
    planned: Bool[Array, " nv"],
    checker: WayChecker | None,
    motion: ExactMotion,
    info: WayInfo,
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
    time = np.concatenate([[0.0], np.cumsum(durations)])
    v = motion.steps / durations[:, None]
    for array in (time, motion.q, v):
        array.setflags(write=False)
    geodesic = info.steering != "propagated"
    return Way(
        reduced=reduced,
        time=time,
        q=motion.q,
        v=v,
        length=_length(reduced, motion),
        residual=_residual(reduced, motion, v, geodesic),
        info=info,
        checker=checker,
        geodesic=geodesic,
    )


def _length(reduced: ReducedModel, motion: ExactMotion) -> float:
    """Length of the path of a base [m]."""
    base = reduced.robot.model.joints[1].idx_v
    places = slice(base, base + base_axes(reduced.robot.model))
    return float(np.linalg.norm(motion.steps[:, places], axis=1).sum())


def _residual(reduced: ReducedModel, motion: ExactMotion, v: Array, geodesic: bool) -> float:
    """Largest entry of ``A(q) v`` at the nodes; for geodesics also halfway and at their ends."""
    places = [motion.q[:-1]]
    if geodesic:
        places += [
            ConfigurationManifold(reduced.robot.model).integrate(motion.q[:-1], 0.5 * motion.steps),
            motion.q[1:],
        ]
    pairs = [(q, rate) for each in places for q, rate in zip(each, v, strict=True)]
    return max((float(np.abs(reduced.at(q).A @ rate).max(initial=0.0)) for q, rate in pairs), default=0.0)


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
    slowest: Float[Array, " m"]
    """Smallest speed of the way between stops."""

    def counts(self, intervals: int) -> tuple[Int[Array, " m"], Int[Array, " m"]]:
        """Intervals of each piece, by its duration, and those among them in which its speed rises, and falls."""
        durations = np.diff(self.stops) / self.slowest
        share = (intervals - 2 * len(durations)) * np.cumsum(durations) / durations.sum()
        counts = 2 + np.diff(np.round(share), prepend=0.0).astype(int)
        return counts, np.maximum(counts // 4, 1)


def _pieces(way: Way) -> _Pieces:
    u = np.matvec(way.reduced.at(way.q[:-1]).J2, way.v)
    sizes = np.abs(u).max(axis=1)
    k = np.flatnonzero(sizes)
    sizes, directions = sizes[k], u[k] / sizes[k, None]
    ends = np.concatenate([[0.0], np.cumsum(sizes * np.diff(way.time)[k])])
    turns = np.abs(np.diff(directions, axis=0, prepend=2.0)).max(axis=1)
    first = np.flatnonzero(turns > (_JUMP if way.geodesic else _TURN))
    return _Pieces(k, directions, ends, ends[np.append(first, len(k))], np.minimum.reduceat(sizes, first))


def intervals_along(way: Way, least: int, duration: float) -> int:
    """Number of intervals in which ``motion_along`` stops where it has to, and keeps the speeds of the way.

    Args:
        way: a way that moves.
        least: number to begin with; it is doubled up to three times, unless even that leaves no time to stop.
        duration: duration of the motion [s].
    """
    pieces, found = _pieces(way), least
    for intervals in [least * 2**doubled for doubled in range(4)]:
        counts, ramps = pieces.counts(intervals)
        if counts.min() < 2:
            continue
        found = intervals
        if (np.diff(pieces.stops) <= pieces.slowest * duration / intervals * (counts - ramps)).all():
            break
    return found


def motion_along(
    way: Way, intervals: int, duration: float
) -> tuple[Float[Array, "n nq"], Float[Array, "n r"], Float[Array, "k r"]]:
    """Configurations and reduced velocities (K + 1, r) at equal times, and the means of these over the intervals.

    The motion starts and ends at rest, and stops where the direction of the reduced velocities jumps. In between, they
    keep their direction, and the reduced acceleration is constant over each interval: so the motion is exact where the
    way is. With less than two intervals for each piece, the speed is constant.

    Args:
        way: a way that moves.
        intervals: number K of intervals.
        duration: duration [s].
    """
    pieces, h = _pieces(way), duration / intervals
    counts, ramps = pieces.counts(intervals)
    speed = np.full(intervals + 1, pieces.ends[-1] / duration)
    if (counts >= 2).all():
        within = np.concatenate([np.arange(count) for count in counts])
        left, ramp = np.repeat(counts, counts) - within, np.repeat(ramps, counts)
        most = np.repeat(np.diff(pieces.stops) / (h * (counts - ramps)), counts)
        speed[:-1] = most * np.minimum(np.minimum(within, left) / ramp, 1.0)
        speed[-1] = 0.0
    mean = 0.5 * (speed[:-1] + speed[1:])
    places = np.concatenate([[0.0], np.cumsum(h * mean)])
    middle = np.searchsorted(pieces.ends, 0.5 * (places[:-1] + places[1:]), "right") - 1
    along = pieces.directions[np.clip(middle, 0, len(pieces.k) - 1)]
    at = np.clip(np.searchsorted(pieces.ends, places, "right") - 1, 0, len(pieces.k) - 1)
    share = np.clip((places - pieces.ends[at]) / np.diff(pieces.ends)[at], 0.0, 1.0)
    times = way.time[pieces.k[at]] + share * np.diff(way.time)[pieces.k[at]]
    return way.at(times), speed[:, None] * pieces.directions[at], mean[:, None] * along


# ------------------------------------------------------------------ timing among obstacles that move

_STEP = 0.2  # [s] between the places of the grid, and between its delays
_TRIES = 40  # timings of a way whose bounds are evaluated


class TimedWay(NamedTuple):
    """Way with its waits; None with the obstacle that crosses it whatever it waits, and when without waits [s]."""

    way: Way | None
    crossing: Obstacle | None = None
    at: float = 0.0


class WayTiming:
    """Waits on ways, from time zero on, so that no obstacle that moves comes too near.

    A robot that has waited for a delay is at a place of its way that much later. Places and delays make a grid: from
    each node, the robot drives to the next place, or waits. Its distances from the obstacles at the nodes decide which
    are free, and the smallest delay with a path to the end gives the timing. Bounds then show that the whole way is
    free, between the nodes too; where they do not, the nearest node is closed, and another timing is tried.

    Args:
        moving: distances from obstacles that move.
        every: distances of the robot from all obstacles, which timed ways record.
        longest: longest sum of all waits [s].
    """

    def __init__(self, moving: WayChecker, every: WayChecker, longest: float) -> None:
        self._moving, self._every, self._longest = moving, every, longest

    def timed(self, way: Way) -> TimedWay:
        """Way that waits as little as it has to.

        Args:
            way: way that is free among the obstacles that stand.
        """
        name, at = self._moving.crossing(way.time, way.q)
        if not name:
            return TimedWay(replace(way, checker=self._every))
        grid, crossed = _Grid(way, self._moving), at
        for _ in range(_TRIES):
            delays = grid.delays(self._longest)
            if delays is None:
                break
            waiting = _with_waits(way, grid.places, delays, self._every)
            still, at = self._moving.crossing(waiting.time, waiting.q)
            if not still:
                return TimedWay(waiting)
            grid.close(delays, at)
        (obstacle,) = (each for each in self._moving.distances.obstacles if each.name == name)
        return TimedWay(None, obstacle, crossed)


class _Grid:
    """Places and delays of a way, and which of them are free.

    Args:
        way: the way.
        checker: distances from obstacles that move.
    """

    def __init__(self, way: Way, checker: WayChecker) -> None:
        self._checker = checker
        if way.geodesic:
            counts = np.maximum(np.ceil(np.diff(way.time) / _STEP), 1.0).astype(int)
            starts, lengths = np.repeat(way.time[:-1], counts), np.repeat(np.diff(way.time) / counts, counts)
            number = np.arange(len(starts)) - np.repeat(np.cumsum(counts) - counts, counts)
            places = starts + number * lengths
        else:  # nodes alone lie on a way of propagated motions
            places = way.time[np.searchsorted(way.time, np.arange(0.0, way.duration, _STEP))]
        self.places: Float[Array, " m"] = np.unique(np.append(places, way.duration))
        self._q = way.at(self.places)
        self._free: list[Bool[Array, " m"]] = []

    def delays(self, longest: float) -> Float[Array, " m"] | None:
        """Delays with which the robot leaves each place; None if there are none."""
        reached: list[Bool[Array, " m"]] = []
        for number in range(int(longest / _STEP) + 1):
            if number == len(self._free):
                self._free.append(np.array([self._is_free(k, number) for k in range(len(self.places))]))
            free = self._free[number]
            seeds = free & reached[-1] if reached else free & (np.arange(len(free)) == 0)
            blocked = np.maximum.accumulate(np.where(free, -1, np.arange(len(free))))
            first = np.maximum.accumulate(np.where(seeds, np.arange(len(free)), -1))
            reached.append(free & (first > blocked))
            if reached[-1][-1]:
                return self._path(reached)
        return None

    def _path(self, reached: list[Bool[Array, " m"]]) -> Float[Array, " m"]:
        """Delays that lead to the end, with each wait as early as it can be."""
        number, found = len(reached) - 1, np.zeros(len(self.places))
        for k in reversed(range(len(self.places))):
            found[k] = number * _STEP
            while k and number and not reached[number][k - 1]:
                number -= 1
        return found

    def _is_free(self, place: int, number: int) -> bool:
        """True if a place is free after a delay."""
        return self._checker.violation(self._q[place], float(self.places[place]) + number * _STEP) is None

    def close(self, delays: Float[Array, " m"], at: float) -> None:
        """Close the node that a timing passes nearest to a time [s]."""
        left = np.round(delays / _STEP).astype(int)
        nodes = [(k, n) for k, first in enumerate([0, *left[:-1].tolist()]) for n in range(first, int(left[k]) + 1)]
        times = np.array([self.places[k] + n * _STEP for k, n in nodes])
        place, number = nodes[int(np.argmin(np.abs(times - at)))]
        self._free[number][place] = False


def _with_waits(way: Way, places: Float[Array, " m"], delays: Float[Array, " m"], checker: WayChecker) -> Way:
    """The way with waits at places."""
    waits = np.flatnonzero(np.diff(delays, prepend=0.0) > 0.5 * _STEP)
    time = np.unique(np.concatenate([way.time, places[waits]]))
    k = np.clip(np.searchsorted(way.time, time[:-1], "right") - 1, 0, len(way.v) - 1)
    q, v = way.at(time), way.v[k]
    at = np.searchsorted(time, places[waits])
    length = np.diff(delays, prepend=0.0)[waits]
    shifted = time + np.array([length[at <= node].sum() for node in range(len(time))])
    arrived = shifted[at] - length
    time, q = np.insert(shifted, at, arrived), np.insert(q, at, q[at], axis=0)
    v = np.insert(v, at, 0.0, axis=0)
    for array in (time, q, v):
        array.setflags(write=False)
    return replace(way, time=time, q=q, v=v, checker=checker)
