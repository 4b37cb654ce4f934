"""Momentum of an unactuated base: paper (4)-(6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError
from rnc_pin.kinematics import Kinematics
from rnc_pin.robot import Robot
from rnc_pin.rows import Rows

_SAMPLES = 4
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class MomentumConservation:
    """The momentum conjugate to an unactuated, cyclic joint is zero, because the system starts at rest.

    A revolute platform gives one row, a planar base three, a free-flying base six.

    Args:
        joint: name of the joint, ``"root_joint"`` for a planar or free base.

    Raises:
        ModelError: no such joint.
        ConstraintError: the inertia depends on the joint's own position (it is not cyclic), or gravity
            acts along it, so that its momentum is not conserved.
    """

    joint: str

    def bind(self, robot: Robot) -> Rows:
        rows = robot.velocity_indices(self.joint)
        _check_symmetry(robot, self.joint, rows)
        return _MomentumRows(self.joint, rows)


class _MomentumRows(Rows):
    def __init__(self, joint: str, rows: slice) -> None:
        size = rows.stop - rows.start
        self.names = tuple(f"momentum({joint})" + (f"[{k}]" if size > 1 else "") for k in range(size))
        self.units = ("N m s",) if size == 1 else ("kg m/s",) * (size - size // 2) + ("N m s",) * (size // 2)
        if size == 3:  # planar: x, y, yaw
            self.units = ("kg m/s", "kg m/s", "N m s")
        self.conserved = self._rows = rows

    def jacobian(self, state: Kinematics) -> np.ndarray:
        return state.M[self._rows]

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        return state.C[self._rows] + state.C.T[self._rows]

    def drift(self, state: Kinematics) -> np.ndarray:
        # d/dt (M v) = bias + coadjoint action of v on M v, and the latter is zero where M v is; gravity
        # has no part along a cyclic joint.
        return state.bias[self._rows]


def _check_symmetry(robot: Robot, joint: str, rows: slice) -> None:
    """Moving the joint alone must change neither the inertia matrix nor the gravity forces."""
    data = robot.model.createData()
    generator = np.random.default_rng(0)
    for _ in range(_SAMPLES):
        q = robot.random_configuration(generator)
        shift = np.zeros(robot.nv)
        shift[rows] = generator.uniform(-1.0, 1.0, rows.stop - rows.start)
        moved = pin.integrate(robot.model, q, shift)
        inertia = pin.crba(robot.model, data, q)
        change = np.abs(pin.crba(robot.model, data, moved) - inertia).max() / np.abs(inertia).max()
        if change > _TOLERANCE:
            raise ConstraintError(
                f"momentum of joint '{joint}' is not conserved: the inertia matrix depends on its position "
                "(only a base joint, which turns the robot as a whole, is cyclic)"
            )
        weight = pin.computeGeneralizedGravity(robot.model, data, q)
        scale = pin.computeTotalMass(robot.model) * np.linalg.norm(robot.model.gravity.linear) + 1.0
        if np.abs(weight[rows]).max() > _TOLERANCE * scale:
            raise ConstraintError(
                f"momentum of joint '{joint}' is not conserved: gravity acts along it "
                "(load the robot with gravity=(0, 0, 0), or turn the joint's axis along gravity)"
            )
