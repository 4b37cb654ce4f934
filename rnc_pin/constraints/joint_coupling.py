"""Coupling of two joints, e.g. by gears or belts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.model.coupling import CouplingRow
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class JointCoupling:
    """Coupling ``q_joint = ratio * q_driver + offset``, as a holonomic row ``v_joint - ratio * v_driver = 0``.

    The system adds the couplings of the robot's file, e.g. ``<mimic>``, itself: see ``NonholonomicSystem``. Both joints
    have one degree of freedom. A continuous joint is stored as (cos, sin), without its number of full turns. Therefore
    positions are compared modulo the effect of full turns of both joints, e.g. a third of a turn for ratio 1/3. If a
    continuous driver has a ratio that is not a fraction of small integers, the row holds only at velocity level.

    Args:
        joint: the joint that follows.
        driver: the joint that leads.
        ratio: motion of the joint for unit motion of the driver, not zero.
        offset: position of the joint if the driver is at zero [rad or m].

    Raises:
        ModelError: unknown joint, or a joint with several degrees of freedom.
        ConstraintError: a joint coupled to itself, a ratio that is zero or not finite, or an offset that is not finite.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> gear = rnc.JointCoupling("joint_2", driver="joint_1", ratio=-0.5, offset=0.1)
        >>> system = rnc.NonholonomicSystem(robot, [gear], ["joint_1"])
        >>> q = system.assembled(robot.configuration({"joint_1": 0.4}), hold=["joint_1"])
        >>> round(robot.joint_values(q)["joint_2"], 3)
        -0.1
    """

    joint: str
    driver: str
    ratio: float = 1.0
    offset: float = 0.0

    def bind(self, robot: Robot) -> Rows:
        if self.joint == self.driver:
            raise ConstraintError(f"joint '{self.joint}' cannot be coupled to itself")
        if not (np.isfinite(self.ratio) and self.ratio != 0 and np.isfinite(self.offset)):
            raise ConstraintError(
                f"coupling of '{self.joint}' to '{self.driver}' needs a ratio other than zero and a finite offset, "
                f"found {self.ratio} and {self.offset}"
            )
        return CouplingRow(robot, self.joint, self.driver, self.ratio, self.offset)
