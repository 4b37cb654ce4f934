"""Timing of a way among obstacles that move: where the robot waits, so that nothing comes too near.

A robot that has waited for a delay is at a place of its way that much later. Places and delays make a grid: from each
node, the robot drives to the next place, or waits. Its distances from the obstacles at the nodes decide which are free,
and the smallest delay with a path to the end gives the timing. Bounds then show that the whole way is free, between the
nodes too; where they do not, the nearest node is closed, and another timing is tried.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Bool, Float
from rnc_pin.collision import Obstacle
from rnc_pin.planning.way import Way
from rnc_pin.planning.way_checking import WayChecker

_STEP = 0.2  # [s] between the places of the grid, and between its delays
_TRIES = 40  # timings of a way whose bounds are evaluated


class TimedWay(NamedTuple):
    """Way with its waits; None with the obstacle that crosses it whatever it waits, and when without waits [s]."""

    way: Way | None
    crossing: Obstacle | None = None
    at: float = 0.0


class WayTiming:
    """Waits on ways, from time zero on.

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
