"""Two joints that turn together: gears, belts, URDF's ``<mimic>``."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError, ModelError
from rnc_pin.model.kinematics import Position
from rnc_pin.model.rows import ConstantRows, Rows
from rnc_pin.robots.robot import Robot

_LARGEST_DENOMINATOR = 1000


@dataclass(frozen=True)
class JointCoupling:
    """``q_joint = ratio * q_driver + offset``, as a row ``v_joint - ratio * v_driver = 0``. It is holonomic.

    Both joints have one degree of freedom. A continuous joint is stored as (cos, sin) and forgets its full turns, so
    its positions are compared up to what the turns of both joints can make up: with ratio 1/3, up to a third of a
    turn. Where a continuous driver has a ratio that is no fraction of small integers, every position is reached by
    some number of turns: then the row holds at velocity level alone.

    Args:
        joint: the joint that follows.
        driver: the joint that it follows.
        ratio: motion of the joint for unit motion of the driver, not zero.
        offset: position of the joint where the driver's is zero [rad or m].

    Raises:
        ModelError: no such joint, or it has several degrees of freedom.
        ConstraintError: a joint coupled to itself, or a ratio or offset that makes no sense.

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
        return _CouplingRow(self, robot)


class _CouplingRow(ConstantRows):
    def __init__(self, kind: JointCoupling, robot: Robot) -> None:
        joint, driver = _single(kind.joint, robot), _single(kind.driver, robot)
        self.names = (f"coupling({kind.joint}, {kind.driver})",)
        self.units = ("rad/s" if joint.shortname().startswith("JointModelR") else "m/s",)
        self._joint, self._driver = joint, driver
        self._ratio, self._offset = kind.ratio, kind.offset
        self.matrix = np.zeros((1, robot.nv))
        self.matrix[0, joint.idx_v], self.matrix[0, driver.idx_v] = 1.0, -kind.ratio
        period = _period(joint.nq == 2, driver.nq == 2, kind.ratio)
        self.holonomic = (period is not None,)
        self._period = period or 0.0

    def residual(self, at: Position) -> np.ndarray:
        if not self.holonomic[0]:
            return super().residual(at)
        gap = _position(self._joint, at.q) - self._ratio * _position(self._driver, at.q) - self._offset
        if self._period:
            gap = gap - self._period * np.round(gap / self._period)
        return gap[..., None]


def _single(name: str, robot: Robot) -> pin.JointModel:
    joint = robot.model.joints[robot.joint_id(name)]
    if joint.nv != 1:
        raise ModelError(f"joint '{name}' has {joint.nv} degrees of freedom: only joints with one can be coupled")
    return joint


def _position(joint: pin.JointModel, q: np.ndarray) -> np.ndarray:
    i = joint.idx_q
    return np.asarray(np.arctan2(q[..., i + 1], q[..., i]) if joint.nq == 2 else q[..., i])


def _period(joint_turns: bool, driver_turns: bool, ratio: float) -> float | None:
    """What full turns that were forgotten add to the gap: multiples of this. Zero if nothing, None if anything."""
    if not driver_turns:
        return 2 * np.pi if joint_turns else 0.0
    if not joint_turns:
        return 2 * np.pi * abs(ratio)
    fraction = Fraction(ratio).limit_denominator(_LARGEST_DENOMINATOR)
    if abs(float(fraction) - ratio) > 1e-12 * abs(ratio):
        return None
    return 2 * np.pi / fraction.denominator
