"""Coupling rows between two joints, including the mimic joints of a robot's file."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.rows import ConstantRows, JointCoupler, Phrases, Rows
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.description import Mimic

COUPLED = Phrases(prevents="move coupled joints by themselves")

_LARGEST_DENOMINATOR = 1000


class CouplingRow(ConstantRows):
    """Row ``v_joint - ratio * v_driver = 0``; holonomic if ``q_joint = ratio * q_driver + offset`` is well defined.

    Args:
        robot: the robot that has the joints.
        joint: the joint that follows.
        driver: the joint that leads; None if it does not move, so that the joint stays at the offset.
        ratio: motion of the joint for unit motion of the driver.
        offset: position of the joint if the driver is at zero [rad or m].
        name: name of the row; made from the names of the joints by default.

    Raises:
        ModelError: unknown joint, or a joint with several degrees of freedom.
    """

    def __init__(
        self, robot: Robot, joint: str, driver: str | None, ratio: float, offset: float, name: str | None = None
    ) -> None:
        self.pair = frozenset({joint, driver})
        """The coupled joints."""
        self.joint, self.driver = joint, driver
        remedy = "only joints with one can be coupled"
        self._joint = robot.single_joint(joint, remedy)
        self._driver = None if driver is None else robot.single_joint(driver, remedy)
        self.ratio, self.offset = ratio, offset
        self.names = (name or f"coupling({joint}, {driver})",)
        self.units = (self._joint.unit,)
        self.matrix = np.zeros((1, robot.nv))
        self.matrix[0, self._joint.idx_v] = 1.0
        if self._driver is not None:
            self.matrix[0, self._driver.idx_v] = -ratio
        period = _period(self._joint.continuous, self._driver is not None and self._driver.continuous, ratio)
        self.holonomic = (period is not None,)
        self._period = period or 0.0

    def residual(self, at: PositionKinematics) -> np.ndarray:
        if not self.holonomic[0]:
            return super().residual(at)
        gap = self._joint.position(at.q) - self.offset
        if self._driver is not None:
            gap = gap - self.ratio * self._driver.position(at.q)
        if self._period:
            gap = gap - self._period * np.round(gap / self._period)
        return gap[..., None]

    def mechanisms(self) -> tuple[JointCoupler]:
        return (JointCoupler(self.joint, self.driver, 0.0 if self.driver is None else self.ratio),)

    def phrases(self) -> Phrases:
        return COUPLED


def mimic_rows(robot: Robot, blocks: Sequence[Rows]) -> list[CouplingRow]:
    """Rows for the mimic joints of the robot's file, except those that ``blocks`` already couple.

    If one of the two joints is locked, the row holds the other at the position that follows from the coupling.

    Args:
        robot: the robot with its ``mimics``.
        blocks: bound rows of the given constraints.
    """
    given = [block for block in blocks if isinstance(block, CouplingRow)]
    rows: dict[str, CouplingRow] = {}
    for mimic in robot.mimics:
        row = mimic_row(robot, mimic)
        if row and not any(row.joint == other.joint or row.pair == other.pair for other in given):
            rows.setdefault(row.names[0], row)
    return list(rows.values())


def mimic_row(robot: Robot, mimic: Mimic) -> CouplingRow | None:
    """Row of one mimic joint; None if it constrains nothing, e.g. for a joint that the file fixes."""
    joint, of, multiplier, offset = mimic
    moving = {name for name in robot.joint_names if robot.model.joints[robot.joint_id(name)].nv == 1}
    name = f"coupling({joint}, {of})"
    if joint in moving and (of not in robot.joint_names or multiplier == 0):
        return CouplingRow(robot, joint, None, 1.0, multiplier * robot.locked.get(of, 0.0) + offset, name)
    if joint in moving and of in moving:
        return CouplingRow(robot, joint, of, multiplier, offset, name)
    if of in moving and joint in robot.locked and multiplier != 0:
        return CouplingRow(robot, of, None, 1.0, (robot.locked[joint] - offset) / multiplier, name)
    return None


def _period(joint_turns: bool, driver_turns: bool, ratio: float) -> float | None:
    """Period of the residual due to unknown full turns of continuous joints; 0 if none, None if it takes any value."""
    if not driver_turns:
        return 2 * np.pi if joint_turns else 0.0
    if not joint_turns:
        return 2 * np.pi * abs(ratio)
    fraction = Fraction(ratio).limit_denominator(_LARGEST_DENOMINATOR)
    if abs(float(fraction) - ratio) > 1e-12 * abs(ratio):
        return None
    return 2 * np.pi / fraction.denominator
