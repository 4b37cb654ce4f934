"""Joints with limits, and their rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.robots.joint_values import NO_LIMIT
from rnc_pin.robots.robot import Robot


class LimitedPositions(NamedTuple):
    """Joints with position limits: entries of q and v, and the limits [rad or m]."""

    q: list[int]
    v: list[int]
    lower: np.ndarray
    upper: np.ndarray


def limited_positions(robot: Robot, joints: Sequence[str] | None) -> LimitedPositions:
    """Return the joints with position limits; continuous joints and bases have none.

    Args:
        robot: the robot.
        joints: names; by default all joints of the robot.

    Raises:
        ModelError: unknown joint.
        ConfigurationError: a named joint has no position limits.
    """
    model, found = robot.model, []
    for name in robot.joint_names if joints is None else joints:
        joint = model.joints[robot.joint_id(name)]
        places = range(joint.nq) if joint.nq == joint.nv else ()  # coordinates on a circle or sphere have no limits
        low, high = model.lowerPositionLimit, model.upperPositionLimit
        limited = [i for i in places if -NO_LIMIT < low[joint.idx_q + i] < high[joint.idx_q + i] < NO_LIMIT]
        if joints is not None and not limited:
            raise ConfigurationError(f"joint '{name}' has no position limits")
        found += [(joint.idx_q + i, joint.idx_v + i) for i in limited]
    q, v = [place for place, _ in found], [place for _, place in found]
    return LimitedPositions(q, v, model.lowerPositionLimit[q], model.upperPositionLimit[q])


def limited_velocities(robot: Robot, joints: Sequence[str] | None, limit: float | None) -> tuple[list[int], np.ndarray]:
    """Return the entries of v with velocity limits, and the limits [rad/s or m/s].

    Args:
        robot: the robot.
        joints: names; by default every joint with a limit, or every joint of one degree of freedom if one is given.
        limit: limit of all of them; the limits of the robot's file by default.

    Raises:
        ModelError: unknown joint.
        ConfigurationError: a named joint has no velocity limit in the file, and none is given.
    """
    model = robot.model
    indices: list[int] = []
    limits: list[float] = []
    for name in robot.joint_names if joints is None else joints:
        joint = model.joints[robot.joint_id(name)]
        if limit is not None:
            if joints is not None or joint.nv == 1:
                indices += range(joint.idx_v, joint.idx_v + joint.nv)
                limits += [limit] * joint.nv
            continue
        own = model.upperVelocityLimit[joint.idx_v : joint.idx_v + joint.nv]
        limited = [i for i in range(joint.nv) if 0 < own[i] < NO_LIMIT]
        if joints is not None and not limited:
            raise ConfigurationError(f"joint '{name}' has no velocity limit in the robot's file: give one")
        indices += [joint.idx_v + i for i in limited]
        limits += [float(own[i]) for i in limited]
    return indices, np.array(limits)


def selection_rows(indices: Sequence[int], size: int) -> np.ndarray:
    """Return rows (k, size) that select entries of a vector."""
    rows = np.zeros((len(indices), size))
    rows[np.arange(len(indices)), indices] = 1.0
    rows.setflags(write=False)
    return rows
