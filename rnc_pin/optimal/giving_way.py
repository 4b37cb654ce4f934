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
_LOOKS, _LOOK = 0.5, 1.0  # [s] between the looks at obstacles that move, before bounds decide, and the effort of each
_NEAR, _FARTHER, _FAR = 0.5, 1.02, 4.0  # [m or rad]; range of the first drawn places, its growth, and its end
_PATIENCE = 0.25  # part of the time until something reaches the robot, for better places
_WORSE = 1.0  # [s] that a place may be reached before the one where its drive begins
_STILL = 1e-6  # velocity of a joint that counts as none
_DRAWN = 1.0  # effort of a drawn place, beside its checks


class _Node(NamedTuple):
    """Place that the robot can drive to, and its time from the departure [s]."""

    q: Float[Array, " nq"]
    time: float
    steps: Float[Array, "k nv"]
    free: float
    """Time until which nothing was seen that reaches a robot there [s]."""


class Refuge(NamedTuple):
    """Way to a place, and the time until which nothing was seen that reaches a robot there [s]."""

    way: FollowedWay
    free: float


class GivingWay:
    """Search for places where nothing reaches a robot at rest, or later than where it is.

    A tree grows from the place of the robot: first back along the way that it came from, then over exact motions to
    drawn places near nodes. The times of its nodes are those of the drive. Where a robot can stand for twice the
    horizon, the search hands over the way. After a part of the time that is left, it hands over the way to the place
    that is reached last. Looks at samples decide in the tree; the caller checks each way by bounds.

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
        self, t: float, since: float, reached: float, at: tuple[FollowedWay, float], seed: int
    ) -> Generator[Refuge | None, None, None]:
        """Search step by step, without an end: None after each slice, and each way that is found.

        Args:
            t: time of the first slice [s].
            since: time between slices [s].
            reached: time at which something reaches the robot where it is [s].
            at: way that the robot came along, and its place on it.
            seed: seed of all random choices.
        """

        def work(hand: Callable[[Refuge | None], None]) -> None:
            departure, patience, (way, place) = t, t + _PATIENCE * (reached - t), at
            last, best = t + 2.0 * self._following.horizon, reached + _LOOKS
            kept: _Node | None = None

            def pause() -> None:
                nonlocal departure
                departure += since
                hand(None)

            budget = SearchBudget(np.inf, None, pause, self._following.slice_size)
            checker = self._finder.checker
            still = None if checker is None else WayChecker(checker.distances, checker.clearance, budget.spend)
            root = _Node(self._follower.at(way, place)[0], 0.0, np.zeros((0, len(self._finder.planned))), reached)
            nodes = [root]
            for parent, motion in self._motions(nodes, way, place, seed):
                if kept is not None and departure > patience:
                    self._hand(root.q, kept, pause, hand)
                    best = kept.free
                    kept = None
                budget.spend(_DRAWN)
                time = self._times(motion.steps)
                begin, arrival = departure + parent.time, departure + parent.time + float(time[-1])
                if self._free(budget, motion.q, begin + time) < arrival:
                    continue
                stands = np.array([arrival, max(last, arrival)])
                free = self._free(budget, motion.q[[-1, -1]], stands)
                if free < parent.free - _WORSE or (still is not None and not still.is_free(motion)):
                    continue
                steps = np.concatenate([parent.steps, motion.steps])
                node = _Node(motion.q[-1], parent.time + float(time[-1]), steps, free)
                nodes.append(node)
                if free >= last:
                    self._hand(root.q, node, pause, hand)
                elif free > max(best, 0.0 if kept is None else kept.free):
                    kept = node

        return in_slices(work)

    def _hand(self, q: Array, node: _Node, pause: Callable[[], None], hand: Callable[[Refuge | None], None]) -> None:
        """Hand over the way to a node, in slices."""
        pause()
        try:
            found = self._finder.along(self._steering.along(q, node.steps))
        except InfeasibleError:  # wheels that follow collide
            return
        followed = self._follower.followed(found)
        pause()  # the caller's check takes a slice of its own
        hand(Refuge(followed, node.free))

    def _motions(
        self, nodes: list[_Node], way: FollowedWay, place: float, seed: int
    ) -> Iterator[tuple[_Node, ExactMotion]]:
        """Motions to try: back along the way, then from nodes to drawn places, farther and farther.

        Half of the places lie along one reduced velocity: straight ahead is sooner reached than any pose.
        """
        root, generator = nodes[0], np.random.default_rng(seed)
        if self._steering.reverse:
            for back in np.arange(place - _APART, -_APART, -_APART):
                if place > 0.0:
                    yield root, self._follower.between(way, place, max(float(back), 0.0))
        for number in count():
            parent = nodes[int(generator.integers(len(nodes)))] if number % 2 else root
            reach = min(_NEAR * _FARTHER**number, _FAR)
            step = np.where(self._drawn, generator.uniform(-reach, reach, len(self._drawn)), 0.0)
            if number % 4 < 2:
                R = np.where(self._drawn[:, None], self._steering.reduced.at(parent.q).R, 0.0)
                sizes = np.abs(R).max(axis=0)
                column = int(generator.choice(np.flatnonzero(sizes > _STILL)))
                step = generator.uniform(-reach, reach) / sizes[column] * R[:, column]
            end = self._limits.clip(self._steering.manifold.integrate(parent.q[None], step[None])[0])
            motion = next(self._steering.motions(parent.q, self._steering.prepared(end)))
            if len(motion.steps):
                yield parent, motion

    def _times(self, steps: Float[Array, "k nv"]) -> Float[Array, " n"]:
        """Times (k + 1,) of a drive along displacements that stops at each node [s]."""
        share, least = self._following.speed, (np.abs(steps) / self._speeds).max(axis=1)
        sizes = np.abs(steps[:, self._finder.planned]).max(axis=1) / np.maximum(least, 1e-300)
        return np.concatenate([[0.0], np.cumsum(least / share + share * sizes / self._following.acceleration)])

    def _free(self, budget: SearchBudget, q: Array, time: Array) -> float:
        """Time until which looks at a drive see no obstacle that is too near [s]."""
        before = -np.inf
        for at in np.linspace(time[0], time[-1], int(np.clip(np.ceil((time[-1] - time[0]) / _LOOKS), 1, 100)) + 1):
            budget.spend(_LOOK)
            if self._moving.violation(self._moving.between(time, q, float(at)), float(at)) is not None:
                return before
            before = float(at)
        return before
