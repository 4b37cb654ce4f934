"""Where to look from, so that all of it is in the picture."""

from __future__ import annotations

import numpy as np

from rnc_pin.simulation import PlannedPath

FIELD_OF_VIEW = 50.0  # [deg], from the bottom of the picture to its top
GAZE = (-0.35, 1.0, -0.8)  # of a camera whose place is looked for
ASPECT = 1.6
_FILLED = np.array([0.8, 0.58])  # of the picture's width and height; the rest is for figures, legend and player
_CENTERINGS = 4
_ROOM = 1.5  # around a robot that the camera follows, of its size
# How far from the middle of the picture a robot may go, by the distance from the camera.
_WIDE = 0.3  # what is farther is soon out of it
_CLOSE = 0.1  # for a robot that fills it


def with_plan(points: np.ndarray, plan: PlannedPath | None, height: float) -> np.ndarray:
    """Points (N, 3), and those of the planned path at this height, where there is one."""
    if plan is None:
        return points
    path = np.array(plan.poses)[:, :2]
    return np.concatenate([points, np.column_stack([path, np.full(len(path), height)])])


def spread_out(corners: np.ndarray) -> np.ndarray:
    """Corners of a robot (N, 3), moved apart so that some of its tracks are in the picture."""
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return middle + _ROOM * (corners - middle)


def fitting_camera(points: np.ndarray, forward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A camera that has points in the picture, as large as it goes.

    Args:
        points: (N, 3) [m].
        forward: the gaze, (3,), of any length; not straight up or down.

    Returns:
        Where the camera is and what it looks at, (3,) each.
    """
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, forward)])
    half = np.tan(np.deg2rad(FIELD_OF_VIEW / 2)) * np.array([ASPECT, 1.0])
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    for centerings_left in reversed(range(_CENTERINGS)):
        away = points - target
        beside, depth = away @ axes.T, away @ forward
        distance = max(float((np.abs(beside) / (_FILLED * half) - depth[:, None]).max()), 0.2)
        if centerings_left:
            # What is nearer looks larger, so the middle of the picture is not the middle of the points.
            seen = beside / (distance + depth)[:, None]
            target = target + 0.5 * (seen.min(axis=0) + seen.max(axis=0)) * distance @ axes
    return target - forward * distance, target


class Follower:
    """How far a camera goes along with a robot that leaves the middle of the picture, and no farther.

    Args:
        camera: where it is at first, (3,) [m].
        target: what it looks at, (3,).
        point: where the robot is at first, (3,); it may be as far from the target later.
        close: whether the robot fills the picture.
    """

    def __init__(self, camera: np.ndarray, target: np.ndarray, point: np.ndarray, close: bool = False) -> None:
        self._target = target
        leash = (_CLOSE if close else _WIDE) * float(np.linalg.norm(camera - target))
        self._leash = max(leash, float(np.linalg.norm(point - target)))
        self.offset = np.zeros(3)

    def follow(self, point: np.ndarray) -> np.ndarray:
        """By what camera and target have moved, (3,), now that the robot is at a point (3,)."""
        away = point - self._target - self.offset
        distance = float(np.linalg.norm(away))
        if distance > self._leash:  # never where it is not finite
            self.offset = self.offset + away * (1.0 - self._leash / distance)
        return self.offset
