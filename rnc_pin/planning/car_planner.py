"""Legs from pose to pose: one where one will do, else by way of one or two poses where the car stops."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.errors import ConfigurationError, InfeasibleError
from rnc_pin.planning.leg import Leg, best_legs

# First and last legs that are tried, in turning radii: what is too far for them is left to the leg in between.
_DISTANCES = np.array([1.2, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 11.0])
_BEARINGS = np.deg2rad([-60.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0])
_TURNS = np.deg2rad([-120.0, -90.0, -60.0, -30.0, 0.0, 30.0, 60.0, 90.0, 120.0])
_FEW = 13  # of them for each turn at either end, when there is a leg in between


def plan_legs(
    start: Float[Array, " 3"], goal: Float[Array, " 3"], radius: float, forward_only: bool = False
) -> list[Leg]:
    """The fewest legs, at most three, and of those the cheapest (``best_legs``) that a lattice of stops offers.

    The same poses always give the same legs.

    Args:
        start: (x, y, heading) of the rear axle's middle [m, m, rad].
        goal: the same.
        radius: smallest that the car can turn at [m].
        forward_only: never back up.

    Raises:
        ConfigurationError: start and goal are the same.
        InfeasibleError: no such legs are found.
    """
    single = _joined(np.stack([start, goal])[:, None], radius, forward_only)
    if single is not None:
        return single
    if np.hypot(*(goal - start)[:2]) < 1e-6 * radius and abs(np.sin((goal - start)[2] / 2)) < 1e-9:
        raise ConfigurationError("start and goal of the path are the same pose")
    moves = _moves(forward_only) * [radius, radius, 1.0]
    after, before = _ahead(start, moves), _behind(goal, moves)
    found = _joined(_rows(start, np.concatenate([after, before]), goal), radius, forward_only)
    if found is None:
        few = np.concatenate([np.flatnonzero(moves[:, 2] == turn)[:_FEW] for turn in _TURNS])
        first, last = np.repeat(after[few], len(few), axis=0), np.tile(before[few], (len(few), 1))
        middle, _ = best_legs(first, last, radius, forward_only)
        out, _ = best_legs(*_rows(start, after[few]), radius, forward_only)
        home, _ = best_legs(*_rows(before[few], goal), radius, forward_only)
        best = int(np.argmin(np.add.outer(out, home).ravel() + middle))
        found = _joined(np.stack([start, first[best], last[best], goal])[:, None], radius, forward_only)
    if found is None:
        what = "forward legs" if forward_only else "legs"
        raise InfeasibleError(
            f"no path of at most three {what} is found from {_words(start)} to {_words(goal)} with turns of at least "
            f"{radius:.3g} m: allow more steering{' or backing up' if forward_only else ''}, or give poses to go by"
        )
    return found


def _rows(*poses: Array) -> Array:
    return np.stack(np.broadcast_arrays(*poses))


def _joined(poses: Float[Array, "stops n 3"], radius: float, forward_only: bool) -> list[Leg] | None:
    """Legs along the cheapest of n rows of poses, or None where none can be driven."""
    each = [best_legs(a, b, radius, forward_only) for a, b in pairwise(poses)]
    total = np.sum([costs for costs, _ in each], axis=0)
    best = int(np.argmin(total))
    if not np.isfinite(total[best]):
        return None
    return [Leg(poses[i, best], poses[i + 1, best], float(charts[best])) for i, (_, charts) in enumerate(each)]


@cache
def _moves(forward_only: bool) -> Float[Array, "n 3"]:
    """Poses that one leg reaches from the origin at turning radius one, the cheapest first."""
    grid = np.stack(np.meshgrid(_DISTANCES, _BEARINGS, _TURNS, indexing="ij"), axis=-1).reshape(-1, 3)
    distance, bearing, turn = grid.T
    poses = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), turn])
    if not forward_only:
        poses = np.concatenate([poses, poses * [-1.0, 1.0, 1.0]])
    costs, _ = best_legs(np.zeros_like(poses), poses, 1.0, forward_only)
    return poses[np.argsort(costs, kind="stable")[: np.isfinite(costs).sum()]]


def _ahead(pose: Array, moves: Array) -> Array:
    """Poses (n, 3) that moves (n, 3) lead to from a pose."""
    return _placed(pose[2], moves) + pose


def _behind(pose: Array, moves: Array) -> Array:
    """Poses (n, 3) from which moves (n, 3) lead to a pose."""
    turned = pose[2] - moves[:, 2]
    back = _placed(turned, moves)
    return np.column_stack([pose[:2] - back[:, :2], turned])


def _placed(heading: float | Array, moves: Array) -> Array:
    c, n = np.cos(heading), np.sin(heading)
    x, y, turn = moves.T
    return np.column_stack([c * x - n * y, n * x + c * y, turn])


def _words(pose: Array) -> str:
    return f"({pose[0]:.3g}, {pose[1]:.3g}, {np.rad2deg(pose[2]):.0f} deg)"
