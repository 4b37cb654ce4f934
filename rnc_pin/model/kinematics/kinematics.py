"""Kinematics of states, from the one place where Pinocchio runs for rows and dynamics."""

from __future__ import annotations

import numpy as np

from rnc_pin.model.kinematics.batch import BatchPositions
from rnc_pin.model.kinematics.quantities import Position
from rnc_pin.model.kinematics.single_state import Gradients, SinglePosition, SingleVelocity
from rnc_pin.model.kinematics.workspace import Workspace


class Kinematics(Workspace):
    """Kinematics of states over leading axes; serves one thread at a time.

    A single state reads frames from Pinocchio's workspace. Many states go through it once, in a loop.

        position = kinematics.position(q)         # q (..., nq)
        velocity = position.moving(v)             # v (..., nv)
        rates = velocity.rates()

    Args:
        robot: the robot.
        joints: those whose placements batches need.
    """

    def position(self, q: np.ndarray) -> Position:
        """Kinematics at configurations (..., nq)."""
        return SinglePosition(self, q) if q.ndim == 1 else BatchPositions(self, q)

    def gradients(self, q: np.ndarray, v: np.ndarray) -> Gradients:
        """Kinematics of one state (nq,), (nv,), with its derivatives."""
        return Gradients(SingleVelocity(SinglePosition(self, q), v))
