"""Properties of single joints: axes, limits, efforts and body frames; and the words in names.

Names of links, joints, meshes and plugins only help, and only as whole words.
"""

from __future__ import annotations

import itertools
import re
from functools import cache

import numpy as np
import pinocchio as pin

from rnc_pin.robots import Robot

_PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def words_of(*names: str) -> list[str]:
    """Return the words of names in lower case: ``baseFootprint_2`` has the words base and footprint."""
    return [part.lower() for name in names for part in _PARTS.findall(name)]


def has_word(pattern: str, *names: str) -> bool:
    """Return whether a word of the names, or two neighbouring words joined by "_", match a pattern from end to end.

    So "roller" is not found in "controller", and "foot" not in "footprint". A plural with "s" matches too.
    """
    whole = _whole(pattern)
    for name in names:
        words = words_of(name)
        pairs = (f"{one}_{other}" for one, other in itertools.pairwise(words))
        if any(whole.fullmatch(each) for each in (*words, *pairs)):
            return True
    return False


@cache
def _whole(pattern: str) -> re.Pattern[str]:
    return re.compile(f"(?:{pattern})s?")


def sliding_axis(model: pin.Model, data: pin.Data, joint: int) -> np.ndarray:
    """Linear part (3,) of the Jacobian column, in the world axes, of a joint with one degree of freedom."""
    return _column(model, data, joint)[:3]


def turning_axis(model: pin.Model, data: pin.Data, joint: int) -> np.ndarray:
    """Rotation axis in the world frame (3,) of a joint with one degree of freedom; zero for a prismatic joint."""
    return _column(model, data, joint)[3:]


def _column(model: pin.Model, data: pin.Data, joint: int) -> np.ndarray:
    jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
    column: np.ndarray = jacobian.reshape(6, model.nv)[:, model.joints[joint].idx_v]  # (6,), also if nv is 1
    return column


def body_frame(robot: Robot, joint: int) -> str:
    """Name of the body frame at the joint's placement, or of the joint's own frame if there is none."""
    frames = [frame for frame in robot.model.frames if frame.parentJoint == joint]
    for frame in frames:
        if frame.type == pin.FrameType.BODY and np.allclose(frame.placement.translation, 0.0):
            return str(frame.name)
    return str(robot.model.names[joint])


def joint_limits(robot: Robot, name: str) -> tuple[float, float]:
    """Position limits of a joint [rad or m]; infinite if the file gives none."""
    joint = robot.model.joints[robot.joint_id(name)]
    if joint.nq != 1:
        return -np.inf, np.inf
    low, high = robot.model.lowerPositionLimit[joint.idx_q], robot.model.upperPositionLimit[joint.idx_q]
    return (float(low), float(high)) if low < high else (-np.inf, np.inf)


def joint_range(robot: Robot, name: str, leaders: tuple[str, ...] = ()) -> tuple[float, float]:
    """Position limits of a joint at which its mimic joints are within their limits too [rad or m].

    The lower value is above the upper one if there is no such position. ``leaders`` are joints that it mimics itself.
    """
    low, high = joint_limits(robot, name)
    leaders = (*leaders, name)
    for follower in robot.mimics:
        if follower.of == name and follower.multiplier and follower.joint not in leaders:
            reach = joint_range(robot, follower.joint, leaders)
            ends = [(end - follower.offset) / follower.multiplier for end in reach]
            first, last = ends if follower.multiplier > 0 else reversed(ends)
            low, high = max(low, first), min(high, last)
    return low, high


def effort_limit(robot: Robot, name: str) -> float:
    """Effort limit of a joint with one degree of freedom [N or N m]; 0 if the file gives none."""
    return float(robot.model.upperEffortLimit[robot.velocity_indices(name).start])


def is_revolute(robot: Robot, name: str) -> bool:
    """True if a joint with one degree of freedom is revolute, False if it is prismatic."""
    return robot.velocity_units[robot.velocity_indices(name).start] == "rad/s"
