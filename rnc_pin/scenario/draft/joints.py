"""Facts of single joints: their axes, ranges and efforts, the links they carry, where they start."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.robots.robot import Robot


def sliding_axis(model: pin.Model, data: pin.Data, joint: int) -> np.ndarray:
    """Direction in the world (3,) in which a joint with one degree of freedom moves its origin."""
    return _column(model, data, joint)[:3]


def turning_axis(model: pin.Model, data: pin.Data, joint: int) -> np.ndarray:
    """Axis in the world (3,) of a joint with one degree of freedom; zero where it slides."""
    return _column(model, data, joint)[3:]


def _column(model: pin.Model, data: pin.Data, joint: int) -> np.ndarray:
    jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
    column: np.ndarray = jacobian.reshape(6, model.nv)[:, model.joints[joint].idx_v]  # (6,) where nv is 1
    return column


def body_frame(robot: Robot, joint: int) -> str:
    """The frame of the link behind a joint, or the joint's own, which is at the same place."""
    frames = [frame for frame in robot.model.frames if frame.parentJoint == joint]
    for frame in frames:
        if frame.type == pin.FrameType.BODY and np.allclose(frame.placement.translation, 0.0):
            return str(frame.name)
    return str(robot.model.names[joint])


def joint_limits(robot: Robot, name: str) -> tuple[float, float]:
    """Range of a joint [rad or m], infinite where the file gives none."""
    joint = robot.model.joints[robot.joint_id(name)]
    if joint.nq != 1:
        return -np.inf, np.inf
    low, high = robot.model.lowerPositionLimit[joint.idx_q], robot.model.upperPositionLimit[joint.idx_q]
    return (float(low), float(high)) if low < high else (-np.inf, np.inf)


def effort_limit(robot: Robot, name: str) -> float:
    """Largest force or torque of a joint with one degree of freedom [N or N m]; 0 where the file gives none."""
    return float(robot.model.upperEffortLimit[robot.velocity_indices(name).start])


def turns(robot: Robot, name: str) -> bool:
    """Whether a joint with one degree of freedom turns; else it slides."""
    return robot.velocity_units[robot.velocity_indices(name).start] == "rad/s"


def start_values(robot: Robot) -> dict[str, float]:
    """Joints of one degree of freedom: at zero, or where that is not well inside their range, in its middle.

    Joints that mimic others are where those put them.
    """
    start = {}
    for index, name in enumerate(robot.joint_names, start=1):
        if robot.model.joints[index].nv != 1:
            continue
        low, high = joint_limits(robot, name)
        margin = 0.02 * (high - low) if np.isfinite(high - low) else 0.0
        inside = low + margin < 0 < high - margin or low >= high
        start[name] = 0.0 if inside else round(float((low + high) / 2), 4)
    for _ in robot.mimics:  # chains of them
        for joint, of, multiplier, offset in robot.mimics:
            if joint in start:
                start[joint] = round(multiplier * start.get(of, 0.0) + offset, 9) + 0.0
    return start
