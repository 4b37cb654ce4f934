"""Camera placement that keeps the motion in the picture."""

from __future__ import annotations

import numpy as np

from rnc_pin.simulation import PlannedPath

FIELD_OF_VIEW = 50.0  # vertical [deg]
VIEW_DIRECTION = (-0.35, 1.0, -0.8)  # viewing direction of a camera that is placed automatically
ASPECT = 1.6  # width over height of the picture
_USED_PART = np.array(
    [0.8, 0.58]
)  # used part of the picture's width and height; overlay, legend and player need the rest
_CENTERINGS = 4
_BOX_SCALE = 1.5  # box around a robot that the camera follows, over the size of the robot
# Largest distance of the robot from the target, over the distance between camera and target.
_MAX_DISTANCE = 0.3  # beyond this the robot soon leaves the picture
_MAX_DISTANCE_CLOSE = 0.1  # for a robot that fills the picture


def with_plan(points: np.ndarray, plan: PlannedPath | None, height: float) -> np.ndarray:
    """Points (N, 3) together with the points of the planned path, if any, at this height [m]."""
    if plan is None:
        return points
    path = np.array(plan.poses)[:, :2]
    heights = np.array(plan.heights) if plan.heights else np.full(len(path), height)
    return np.concatenate([points, np.column_stack([path, heights])])


def enlarged_box(corners: np.ndarray) -> np.ndarray:
    """Scale the corners of a robot (N, 3) about their centre, so that parts of its tracks are in the picture."""
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return middle + _BOX_SCALE * (corners - middle)


def fitting_camera(points: np.ndarray, forward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Camera that shows all points as large as possible.

    Args:
        points: (N, 3) [m].
        forward: viewing direction (3,), of any length; not vertical.

    Returns:
        Position of the camera and its target, (3,) each [m].
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
        distance = max(float((np.abs(beside) / (_USED_PART * half) - depth[:, None]).max()), 0.2)
        if centerings_left:
            # Perspective enlarges near points, so the middle of the picture is not the middle of the points.
            seen = beside / (distance + depth)[:, None]
            target = target + 0.5 * (seen.min(axis=0) + seen.max(axis=0)) * distance @ axes
    return target - forward * distance, target


class Follower:
    """Camera offset that follows a robot. The camera moves only as far as the robot leaves the middle of the picture.

    Args:
        camera: initial position of the camera (3,) [m].
        target: initial target of the camera (3,) [m].
        point: initial position of the robot (3,) [m]. Its distance from the target is always allowed later.
        close: True if the robot fills the picture.
    """

    def __init__(self, camera: np.ndarray, target: np.ndarray, point: np.ndarray, close: bool = False) -> None:
        self._target = target
        leash = (_MAX_DISTANCE_CLOSE if close else _MAX_DISTANCE) * float(np.linalg.norm(camera - target))
        self._max_distance = max(leash, float(np.linalg.norm(point - target)))
        self.offset = np.zeros(3)

    def follow(self, point: np.ndarray) -> np.ndarray:
        """Return the offset (3,) [m] of camera and target for a robot at a point (3,) [m]."""
        away = point - self._target - self.offset
        distance = float(np.linalg.norm(away))
        if distance > self._max_distance:  # False if the distance is NaN
            self.offset = self.offset + away * (1.0 - self._max_distance / distance)
        return self.offset
