"""Poses of a frame along configurations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Float
from rnc_pin.robots import Robot


class FramePoses(NamedTuple):
    """Poses of a frame."""

    planar: Float[np.ndarray, "n 3"]
    """Position x, y [m] and heading [rad]."""
    heights: Float[np.ndarray, " n"]
    """Position z [m]."""


def frame_poses(robot: Robot, frame: str, configurations: np.ndarray) -> FramePoses:
    """Return the poses of a frame at configurations (n, nq)."""
    data, index = robot.model.createData(), robot.frame_id(frame)
    poses = np.empty((len(configurations), 4))
    for pose, q in zip(poses, configurations, strict=True):
        pin.framesForwardKinematics(robot.model, data, q)
        placement = data.oMf[index]
        pose[[0, 1, 3]] = placement.translation
        pose[2] = np.arctan2(placement.rotation[1, 0], placement.rotation[0, 0])
    return FramePoses(poses[:, :3], poses[:, 3])
