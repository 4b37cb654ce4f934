"""Path of the platform through a doorway: planned for the whole robot, with the hand in place.

The way is a curve y(x) with the headings of the start and of the goal. It passes the door at an offset and a slope;
these two numbers are searched. The hand fixes the arm for each pose of the platform. So coal gives the clearance of all
bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from benchmarks.doorway_circle import doorway_robot
from rnc_pin.collision import CollisionDistances, Obstacle

ENOUGH = 0.09  # [m]; clearance with which the search ends: the scenario keeps 0.05 m
_OFFSETS = np.linspace(-0.3, 0.3, 13)  # [m] of the platform in the door
_SLOPES = np.linspace(-0.45, 0.45, 7)
_POSES = 33  # that are tested
_FAR = 0.3  # [m] up to which distances are exact
_LONGEST_TURN = 0.5  # [rad] of the elbow about the hand between two tested poses


class DoorwayPath(NamedTuple):
    """Path of the platform."""

    poses: np.ndarray
    """Poses (x, y, yaw) at equal steps of x, (n, 3)."""
    clearance: float
    """Smallest distance of a body from the jambs along it [m]."""


def doorway_path(
    start: Sequence[float], bend: float, goal: Sequence[float], jambs: Sequence[Obstacle]
) -> DoorwayPath | None:
    """Return the path with the largest clearance, or the first with enough; None if the arm follows none.

    Args:
        start: pose (x, y, yaw) of the platform at the start.
        bend: joint_1 at the start; joint_2 is -2 of it [rad].
        goal: pose of the platform at the end.
        jambs: the door, at x = 0.
    """
    x, y, yaw = start
    hand = np.array([x + np.cos(yaw + bend) + np.cos(yaw - bend), y + np.sin(yaw + bend) + np.sin(yaw - bend)])
    first = whole_configuration(start, hand)
    assert first is not None
    distances = CollisionDistances(doorway_robot(), jambs, q0=first)
    best: DoorwayPath | None = None
    for offset, slope in _ways():
        poses = _curve(start, goal, offset, slope)
        clearance = _clearance(poses, hand, distances)
        if best is None or clearance > best.clearance:
            best = DoorwayPath(poses, clearance)
        if best.clearance >= ENOUGH:
            break
    return None if best is None or best.clearance <= 0.0 else best


@cache
def _ways() -> list[tuple[float, float]]:
    """Offsets and slopes in the door, those near the straight way through its middle first."""
    return sorted(product(_OFFSETS.tolist(), _SLOPES.tolist()), key=lambda way: way[0] ** 2 + 0.1 * way[1] ** 2)


def _curve(start: Sequence[float], goal: Sequence[float], offset: float, slope: float) -> np.ndarray:
    knots = [start[0], 0.0, goal[0]]
    spline = CubicHermiteSpline(knots, [start[1], offset, goal[1]], [np.tan(start[2]), slope, np.tan(goal[2])])
    x = np.linspace(start[0], goal[0], _POSES)
    return np.column_stack([x, spline(x), np.arctan(spline(x, 1))])


def _clearance(poses: np.ndarray, hand: np.ndarray, distances: CollisionDistances) -> float:
    """Smallest distance of any pair [m]; -1 if the arm cannot follow."""
    found, before = _FAR, None
    for pose in poses.tolist():
        q = whole_configuration(pose, hand)
        if q is None:
            return -1.0
        elbow = np.arctan2(pose[1] + np.sin(pose[2] + q[4]) - hand[1], pose[0] + np.cos(pose[2] + q[4]) - hand[0])
        if before is not None and abs(np.angle(np.exp(1j * (elbow - before)))) > _LONGEST_TURN:
            return -1.0  # the platform comes under the hand
        before = elbow
        found = min(found, float(distances.smallest(q, 0.0, _FAR).min(initial=_FAR)))
        if found <= 0.0:
            break
    return found


def whole_configuration(pose: Sequence[float], hand: np.ndarray) -> np.ndarray | None:
    """Configuration with the platform at a pose and the tip at the hand's place, joint_2 negative."""
    ahead = hand - pose[:2]
    half = 0.5 * float(np.linalg.norm(ahead))
    if half >= 1.0:
        return None
    bend = float(np.arccos(half))
    turn = float(np.arctan2(ahead[1], ahead[0])) - pose[2]
    joint_1 = float(np.angle(np.exp(1j * (turn + bend))))
    return doorway_robot().configuration({"root_joint": list(pose), "joint_1": joint_1, "joint_2": -2.0 * bend})
