"""A joint's own coordinate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ModelError
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class JointPosition:
    """Angle [rad] or displacement [m] of a joint with one degree of freedom.

    Args:
        joint: name of the joint. Of a continuous joint the value is in (-pi, pi].
    """

    joint: str

    def bind(self, robot: Robot) -> OutputRows:
        return _JointRow(self, robot)


class _JointRow(OutputRows):
    constant = True

    def __init__(self, kind: JointPosition, robot: Robot) -> None:
        joint = robot.model.joints[robot.joint_id(kind.joint)]
        if joint.nv != 1:
            raise ModelError(
                f"joint '{kind.joint}' has {joint.nv} degrees of freedom: use outputs of a frame "
                "(FramePosition, FrameYaw, FrameSpeed) for it"
            )
        turns = joint.shortname().startswith(("JointModelR", "JointModelRUB"))
        self.names = (kind.joint,)
        self.units = ("rad/s" if turns else "m/s",)
        self.angular = (joint.nq == 2,)  # a continuous joint is stored as (cos, sin)
        self._q = joint.idx_q
        self._row = np.zeros((1, robot.nv))
        self._row[0, joint.idx_v] = 1.0
        self._zero_rows = np.zeros((1, robot.nv))
        self._zero = np.zeros(1)

    def value(self, state: Kinematics) -> np.ndarray:
        if self.angular[0]:
            return np.array([np.arctan2(state.q[self._q + 1], state.q[self._q])])
        return state.q[self._q : self._q + 1]

    def jacobian(self, state: Kinematics) -> np.ndarray:
        return self._row

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        return self._zero_rows

    def drift(self, state: Kinematics) -> np.ndarray:
        return self._zero
