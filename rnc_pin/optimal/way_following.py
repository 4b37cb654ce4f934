"""Motion along a way: speeds within an acceleration, stops where the velocity jumps, feedback, and predictions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal, NamedTuple

import numpy as np
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Bool, Float
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.parameter_types import Positive, check_positive_settings
from rnc_pin.optimal.plan_feedback import regulator_gains
from rnc_pin.planning.action_models import KinematicModel, Nodes
from rnc_pin.planning.exact_steering import ExactMotion
from rnc_pin.planning.way import Way
from rnc_pin.planning.way_checking import WayChecker

_MOVED = 1e-3  # [m or rad]; an obstacle that is farther from where it was has moved
_SPACING = 0.05  # [m or rad]; largest displacement between two gains of the feedback
_SAME = 1e-9  # relative difference of velocities without a stop between them
_END = 1e-9  # [s] before a place of the way that counts as the place

Status = Literal["following", "waiting", "stopping", "replanning", "giving way", "no way", "arrived"]


@dataclass(frozen=True)
class WayFollowing:
    """Settings of a robot that follows a way among obstacles.

    Attributes:
        acceleration: largest rate of each entry of the velocity along the way [m/s^2 or rad/s^2].
        speed: share of the velocity limits of the robot's file that the way uses.
        tube: distance of the robot from the way from which it plans again [m or rad].
        tolerance: error at the goal above which it plans again [m or rad].
        check: time between two looks at obstacles that move [s].
        horizon: time ahead for which the motions of obstacles count [s].
        state_cost: weight of the distance from the way in the gains of the feedback.
        slice_size: effort of a step of a search, about 1 for 0.1 ms. It is counted, and does not depend on the
            computer.

    Raises:
        ConfigurationError: a number is out of range.

    Example:
        >>> rnc.control.WayFollowing(acceleration=1.5).horizon
        8.0
    """

    acceleration: Positive = 0.5
    speed: Positive = 0.8
    tube: Positive = 0.05
    tolerance: Positive = 0.02
    check: Positive = 0.1
    horizon: Positive = 8.0
    state_cost: Positive = 10.0
    slice_size: Positive = 60.0

    def __post_init__(self) -> None:
        check_positive_settings(**{each.name: getattr(self, each.name) for each in fields(self)})
        if self.speed > 1.0:
            raise ConfigurationError(f"speed: expected a share of the velocity limits up to 1, found {self.speed:g}")


class FollowedWay(NamedTuple):
    """Way with the gains of its feedback. Places are times of the way at its largest speeds [s]."""

    time: Float[Array, " n"]
    """Places of the nodes."""
    q: Float[Array, "n nq"]
    v: Float[Array, "k nv"]
    sizes: Float[Array, " k"]
    """Largest entry of the planned velocities after each node."""
    stops: Float[Array, " k"]
    """Next place at which the velocity jumps, after each node."""
    places: Float[Array, " m"]
    """Places of the gains."""
    gains: Float[Array, "m r nv"]

    @property
    def end(self) -> float:
        """Place of the goal."""
        return float(self.time[-1])

    def segment(self, place: float) -> int:
        """Segment after a place."""
        return min(max(int(self.time.searchsorted(place + _END, "right")) - 1, 0), len(self.v) - 1)


class WayProgress(NamedTuple):
    """Place on a way, its rate, and the rate of this in the last step [1/s]."""

    place: float = 0.0
    speed: float = 0.0
    rate: float = 0.0


class NavigationState(NamedTuple):
    """Way, the place on it, and the search for the next one."""

    way: FollowedWay
    start: Float[Array, " s"]
    """Configuration from which the search starts; empty if the measured one counts, after the stop."""
    since: float
    """Time between the last steps [s]."""
    progress: WayProgress = WayProgress()
    status: Status = "replanning"
    """"following" a way, "waiting" or "stopping" on it, "replanning" at rest, "giving way", "no way", or "arrived"."""
    reason: str = ""
    """Why the robot does not follow a way; "" if it does."""
    t: float | None = None
    """Time of the last step [s]."""
    begin: float = 0.0
    """Time at which the status began [s]."""
    end: float = 0.0
    """Place at which the robot stops."""
    safe: float = -np.inf
    """Time until which nothing reaches a robot that drives there and stands; with a threat, its time [s]."""
    threat: str = ""
    """Obstacle that reaches it before the horizon; "" for none."""
    tries: int = 0
    """Other places to stop that were tried, or looks at what blocks the way of a robot that waits."""
    world: int = -1
    """Number of the obstacles that were set last, as far as the way was checked."""
    watched: int = -1
    """The same, as far as obstacles that move were watched."""
    seen: float = -np.inf
    """Time at which they were watched [s]."""
    posed: float = 0.0
    """Time of the poses of these obstacles in the search [s]."""
    slices: int = 0
    """Slices of the search that were made; negative after the last one."""
    least_slices: int = 0
    """Slices of the search before a change of the obstacles begins it again."""
    searches: int = 0
    ways: int = 0


class WayFollower:
    """Motion along ways.

    Args:
        model: kinematic form of the model.
        planned: mask (nv,) of the velocities that are planned.
        following: settings.
    """

    def __init__(self, model: KinematicModel, planned: Bool[Array, " nv"], following: WayFollowing) -> None:
        self.model, self._planned, self.following = model, planned, following

    def standing(self, q: Float[Array, " nq"]) -> FollowedWay:
        """Way that stays at a configuration."""
        nv, none = len(self._planned), np.zeros(0)
        return FollowedWay(
            np.zeros(1), q[None], np.zeros((0, nv)), none, none, np.zeros(1), np.zeros((1, self.model.nu, nv))
        )

    def followed(self, way: Way) -> FollowedWay:
        """Way with the gains of a linear-quadratic regulator from each place to the next, at the speeds of the way."""
        if not len(way.v):
            return self.standing(way.q[0])
        durations, v = np.diff(way.time), np.where(self._planned, way.v, 0.0)
        speeds = np.abs(v).max(axis=1)
        counts = np.maximum(np.ceil(speeds * durations / _SPACING), 1.0).astype(int)
        h, k = np.repeat(durations / counts, counts), np.repeat(np.arange(len(v)), counts)
        places = np.concatenate([[0.0], np.cumsum(h)[:-1]])
        q = way.at(places)
        u = np.matvec(self.model.reduced.at(q).J2, way.v[k])
        weights = np.where(self._planned, self.following.state_cost, 0.0)
        ones = np.ones(self.model.nu)
        gains = regulator_gains(self.model, Nodes(q, np.empty((len(q), 0))), u, h, (weights, ones, 10.0 * weights))
        jumps = np.abs(np.diff(v, axis=0)).max(axis=1) > _SAME * speeds[:-1]
        ends = np.where(np.append(jumps, True), way.time[1:], np.inf)
        stops = np.minimum.accumulate(ends[::-1])[::-1]
        return FollowedWay(way.time, way.q, way.v, speeds, stops, places, gains)

    def at(self, way: FollowedWay, places: ArrayLike) -> Float[Array, "k nq"]:
        """Configurations (k, nq) at places of the way."""
        s = np.atleast_1d(np.asarray(places, dtype=float))
        if not len(way.v):
            return np.repeat(way.q[:1], len(s), axis=0)
        k = np.clip(np.searchsorted(way.time, s, "right") - 1, 0, len(way.v) - 1)
        return self.model.manifold.integrate(way.q[k], (s - way.time[k])[:, None] * way.v[k])

    def between(self, way: FollowedWay, first: float, last: float) -> ExactMotion:
        """Motion along the way between two places; backwards if the second one comes first.

        Args:
            way: the way, with nodes.
            first: place of the start.
            last: place of the end.
        """
        low, high = min(first, last), max(first, last)
        inner = way.time[(way.time > low + _END) & (way.time < high - _END)]
        places = np.concatenate([[low], inner, [high]])
        k = np.searchsorted(way.time[:-1], 0.5 * (places[1:] + places[:-1]), "right") - 1  # the end has no segment
        q, steps = self.at(way, places), np.diff(places)[:, None] * np.where(self._planned, way.v[k], 0.0)
        return ExactMotion(q, steps) if last >= first else ExactMotion(q[::-1], -steps[::-1])

    def away(self, way: FollowedWay, place: float, q: Float[Array, " nq"]) -> float:
        """Distance of the planned joints from a place of the way [m or rad]."""
        step = self.model.manifold.difference(self.at(way, place), q[None])[0]
        return float(np.abs(step[self._planned]).max(initial=0.0))

    def command(
        self, way: FollowedWay, progress: WayProgress, q: Float[Array, " nq"]
    ) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
        """Reduced velocity with feedback, and the reduced acceleration along the way."""
        if not progress.speed:
            still = np.zeros(self.model.nu)
            return still, still
        desired = self.at(way, progress.place)
        along = self.model.reduced.at(desired[0]).J2 @ way.v[way.segment(progress.place)]
        K = way.gains[min(int(way.places.searchsorted(progress.place, "right")), len(way.gains)) - 1]
        correction = K @ self.model.manifold.difference(desired, q[None])[0]
        return progress.speed * (along + correction), progress.rate * along

    def moved(self, way: FollowedWay, progress: WayProgress, end: float, since: float) -> WayProgress:
        """WayProgress after a time [s]: the speed rises, stays, or falls so that the robot stops at a place."""
        place, speed = progress.place, progress.speed
        if not len(way.v) or place >= end:
            return WayProgress(place)
        k = way.segment(place)
        last, most = min(float(way.stops[k]), end), self.following.acceleration / float(way.sizes[k])
        room = max(last - place - 0.5 * speed * since, 0.0)
        top = most * ((0.25 * since**2 + 2.0 * room / most) ** 0.5 - 0.5 * since)
        new = max(min(self.following.speed, speed + most * since, top), speed - most * since, 0.0)
        place += 0.5 * (speed + new) * since
        if place >= last - _END:
            return WayProgress(last)
        return WayProgress(place, new, (new - speed) / since if since else 0.0)

    def braked(self, way: FollowedWay, progress: WayProgress) -> float:
        """Place at which the robot stops if it brakes now."""
        if not progress.speed:
            return progress.place
        k = way.segment(progress.place)
        most = self.following.acceleration / float(way.sizes[k])
        return min(progress.place + 0.5 * progress.speed**2 / most, float(way.stops[k]))

    def predicted(
        self, way: FollowedWay, progress: WayProgress, end: float, since: float
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Times from now [s] and places until the horizon, for a robot that drives to a place, and stands there.

        Args:
            way: the way.
            progress: progress now.
            end: place at which the robot stops.
            since: time of a step [s].
        """
        times, places = [0.0], [progress.place]
        while times[-1] < self.following.horizon:
            progress = self.moved(way, progress, end, since)
            times.append(times[-1] + since)
            places.append(progress.place)
            if progress.place >= end:
                times.append(max(times[-1], self.following.horizon))
                places.append(end)
                break
        return np.array(times), np.array(places)


class DriveChecks:
    """Checks of drives along ways beside obstacles; the search of a way has checked the links against each other.

    Args:
        follower: motion along ways.
        obstacles: all obstacles.
        clearance: smallest distance to them [m].

    Attributes:
        moving: check beside the obstacles that move; None for none.
    """

    def __init__(self, follower: WayFollower, obstacles: Sequence[Obstacle], clearance: float) -> None:
        self._follower, self._horizon = follower, follower.following.horizon
        robot, links = follower.model.reduced.robot, PairSelection(links=False)
        kinds = [[each for each in obstacles if (each.motion is not None) == moves] for moves in (False, True)]
        self._standing, self.moving = (
            WayChecker(CollisionDistances(robot, each, links), clearance) if each else None for each in kinds
        )

    def is_free(self, way: FollowedWay, first: float, last: float) -> bool:
        """True if the way is free between two places, beside the obstacles that stand.

        Args:
            way: the way.
            first: place of the start.
            last: place of the end.
        """
        if self._standing is None or not len(way.v):
            return True
        return self._standing.is_free(self._follower.between(way, first, last))

    def stays_blocked(self, t: float, way: FollowedWay, first: float) -> str:
        """Obstacle that blocks the rest of a way both in the middle and at the end of the horizon; "" for none.

        Args:
            t: time now [s].
            way: the way.
            first: place from which the rest begins.
        """
        name, q = "", self._follower.between(way, first, way.end).q
        for part in (0.5, 1.0):
            if self.moving is not None:
                name = self.moving.crossing(np.full(len(q), t + part * self._horizon), q)[0]
            if not name:
                break
        return name

    def crossing(
        self,
        t: float,
        way: FollowedWay,
        drive: tuple[Float[Array, " n"], Float[Array, " n"]],
        first: float,
        last: float,
    ) -> tuple[str, float]:
        """Obstacle that crosses a drive between two times, and when [s]; "" if bounds show that none does.

        Args:
            t: time now [s].
            way: the way.
            drive: times from now [s] and places, as they are predicted.
            first: time from which the drive counts [s].
            last: time until which it counts, at most the horizon [s].
        """
        last = min(last, t + self._horizon)
        if self.moving is None or first >= last - _END:
            return "", last
        times, places = t + drive[0], drive[1]
        inner = times[(times > first + _END) & (times < last - _END)]
        chosen = np.concatenate([[first], inner, [last]])
        return self.moving.crossing(chosen, self._follower.at(way, np.interp(chosen, times, places)))

    def have_moved(self, before: float, t: float) -> bool:
        """True if an obstacle is elsewhere than at an earlier time.

        Args:
            before: the earlier time [s].
            t: time now [s].
        """
        moving = () if self.moving is None else self.moving.distances.obstacles
        motions = [each.motion for each in moving if each.motion is not None]
        steps = [np.subtract(each.at(t).position, each.at(before).position) for each in motions]
        return any(np.abs(step).max() > _MOVED for step in steps)
