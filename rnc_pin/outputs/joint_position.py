"""Position of a joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.model.kernel_rows import Form, KernelRow, Value
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.rows import ConstantRows, OutputRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class JointPosition:
    """Angle [rad] or displacement [m] of a joint with one degree of freedom.

    Args:
        joint: name of the joint. The value of a continuous joint is in (-pi, pi].

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> joints = ["joint_1", "joint_2", "joint_3"]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], joints)
        >>> reduced = system.reduce([rnc.JointPosition(name) for name in joints], [rnc.JointPosition("platform")])
        >>> reduced.at(robot.configuration()).A_star.round(3)  # how far the platform turns for each joint
        array([[-0.933, -0.533, -0.2  ]])
    """

    joint: str

    def bind(self, robot: Robot) -> OutputRows:
        return _JointRow(self, robot)


class _JointRow(ConstantRows, OutputRows):
    def __init__(self, kind: JointPosition, robot: Robot) -> None:
        joint = robot.single_joint(kind.joint, "use outputs of a frame (FramePosition, FrameYaw, FrameSpeed) for it")
        self.names, self.units, self.angular = (kind.joint,), (joint.unit,), (joint.continuous,)
        self._joint = joint
        self.matrix = np.zeros((1, robot.nv))
        self.matrix[0, joint.idx_v] = 1.0

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        value = Value.CONTINUOUS_JOINT if self.angular[0] else Value.JOINT
        return [KernelRow(Form.CONSTANT, value=(value, self._joint.idx_q))]

    def value(self, at: PositionKinematics) -> np.ndarray:
        return self._joint.position(at.q)[..., None]
