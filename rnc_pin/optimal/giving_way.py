"""Search in space and time for a place where nothing reaches a robot at rest, and a way there."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import InfeasibleError
from rnc_pin.optimal.way_following import DriveChecks, FollowedWay, WayFollower, WayFollowing
from rnc_pin.planning.exact_steering import ExactMotion
from rnc_pin.planning.way_checking import WayChecker
from rnc_pin.planning.way_finding import WayFinder
from rnc_pin.planning.way_goals import position_limits
from rnc_pin.planning.way_search import SearchBudget, in_slices, speed_limits

_APART = 0.5  # [s] along the way that the robot came from, between places that are looked at
_LOOKS = 0.25  # [s] between the looks at obstacles that move, before bounds decide
_NEAR, _FARTHER, _FAR = 0.5, 1.02, 4.0  # [m or rad]; range of the first drawn places, its growth, and its end
_DRAWN = 1.0  # effort of a drawn place, beside its checks


class _Node(NamedTuple):
    """Place that the robot can drive to, and its time from the departure [s]."""

    q: Float[Array, " nq"]
    time: float
    steps: Float[Array, "k nv"]


class GivingWay:
    """Search for places where nothing reaches a robot at rest until a horizon.

    A tree grows from the place of the robot: first back along the way that it came from, then over exact motions to
    drawn places near nodes. The times of its nodes are those of the drive. Where a robot can stand until the horizon,
    the search hands over the way. Looks at samples decide in the tree; the caller checks each way by bounds.

    Args:
        finder: search among the obstacles that stand.
        checks: checks beside those that move.
        follower: motion along ways.
        following: its settings.
    """

    def __init__(self, finder: WayFinder, checks: DriveChecks, follower: WayFollower, following: WayFollowing) -> None:
        assert finder.steering is not None
        assert checks.moving is not None
        self._finder, self._steering, self._follower, self._following = finder, finder.steering, follower, following
        reduced = self._steering.reduced
        self._moving, self._speeds = checks.moving, speed_limits(reduced, finder.planned)
        base = reduced.robot.model.joints[1]
        own = np.arange(len(finder.planned)) < base.nv
        self._drawn = finder.planned & own if (finder.planned & own).any() and base.nv > 1 else finder.planned
        self._limits = position_limits(reduced)

    def slices(
        self, t: float, since: float, way: FollowedWay, place: float, seed: int
    ) -> Generator[FollowedWay | None, None, None]:
        """Search step by step, without an end: None after each slice, and each way that is found.

        Args:
            t: time of the first slice [s].
            since: time between slices [s].
            way: way that the robot came along.
            place: its place on it.
            seed: seed of all random choices.
        """

        def work(hand: Callable[[FollowedWay | None], None]) -> None:
            departure = t

            def pause() -> None:
                nonlocal departure
                departure += since
                hand(None)

            budget = SearchBudget(np.inf, None, pause, self._following.slice_size)
            checker = self._finder.checker
            still = None if checker is None else WayChecker(checker.distances, checker.clearance, budget.spend)
            moving = WayChecker(self._moving.distances, self._moving.clearance, budget.spend)
            root = _Node(self._follower.at(way, place)[0], 0.0, np.zeros((0, len(self._finder.planned))))
            nodes = [root]
            for parent, motion in self._motions(nodes, way, place, seed):
                budget.spend(_DRAWN)
                time = self._times(motion.steps)
                begin, arrival = departure + parent.time, departure + parent.time + float(time[-1])
                end = t + self._following.horizon
                rests = not _seen(moving, motion.q[-1:], np.array([arrival, max(end, arrival)]), motion.steps[:0])
                if _seen(moving, motion.q, begin + time, motion.steps):
                    continue
                if still is not None and not still.is_free(motion):
                    continue
                node = _Node(motion.q[-1], parent.time + float(time[-1]), np.concatenate([parent.steps, motion.steps]))
                nodes.append(node)
                if rests:
                    pause()
                    try:
                        found = self._finder.along(self._steering.along(root.q, node.steps))
                    except InfeasibleError:  # wheels that follow collide
                        continue
                    followed = self._follower.followed(found)
                    pause()  # the caller's check takes a slice of its own
                    hand(followed)

        return in_slices(work)

    def _motions(
        self, nodes: list[_Node], way: FollowedWay, place: float, seed: int
    ) -> Iterator[tuple[_Node, ExactMotion]]:
        """Motions to try: back along the way, then from nodes to drawn places, farther and farther."""
        root, generator = nodes[0], np.random.default_rng(seed)
        if self._steering.reverse:
            for back in np.arange(place - _APART, -_APART, -_APART):
                if place > 0.0:
                    yield root, self._follower.between(way, place, max(float(back), 0.0))
        for number in count():
            parent = nodes[int(generator.integers(len(nodes)))] if number % 2 else root
            reach = min(_NEAR * _FARTHER**number, _FAR)
            step = np.where(self._drawn, generator.uniform(-reach, reach, len(self._drawn)), 0.0)
            end = self._limits.clip(self._steering.manifold.integrate(parent.q[None], step[None])[0])
            motion = next(self._steering.motions(parent.q, self._steering.prepared(end)))
            if len(motion.steps):
                yield parent, motion

    def _times(self, steps: Float[Array, "k nv"]) -> Float[Array, " n"]:
        """Times (k + 1,) of a drive along displacements that stops at each node [s]."""
        share, least = self._following.speed, (np.abs(steps) / self._speeds).max(axis=1)
        sizes = np.abs(steps[:, self._finder.planned]).max(axis=1) / np.maximum(least, 1e-300)
        return np.concatenate([[0.0], np.cumsum(least / share + share * sizes / self._following.acceleration)])


def _seen(moving: WayChecker, q: Array, time: Array, steps: Array) -> bool:
    """True if a look at one of the samples of a drive sees an obstacle that is too near."""
    counts = int(np.clip(np.ceil((time[-1] - time[0]) / _LOOKS), 1, 100))
    for at in np.linspace(time[-1], time[0], counts + 1):
        place = q[-1]
        if len(steps):
            k = int(np.clip(np.searchsorted(time, at, "right") - 1, 0, len(steps) - 1))
            part = (at - time[k]) / max(time[k + 1] - time[k], 1e-300)
            place = moving.manifold.integrate(q[k][None], part * steps[k][None])[0]
        if moving.violation(place, float(at)) is not None:
            return True
    return False
