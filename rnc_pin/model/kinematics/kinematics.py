"""Entry point to the kinematics of states; rows and dynamics call Pinocchio only here."""

from __future__ import annotations

import numpy as np

from rnc_pin.model.kinematics.batch import BatchPositionKinematics
from rnc_pin.model.kinematics.quantities import PositionKinematics
from rnc_pin.model.kinematics.single_state import (
    KinematicDerivatives,
    SinglePositionKinematics,
    SingleVelocityKinematics,
)
from rnc_pin.model.kinematics.workspace import Workspace


class Kinematics(Workspace):
    """Kinematics of states over leading batch axes; serves one thread at a time.

    A single state reads frames from Pinocchio's workspace. Many states use the workspace once each, in a loop.

        position = kinematics.position(q)         # q (..., nq)
        velocity = position.with_velocity(v)      # v (..., nv)
        rates = velocity.rates()

    Args:
        robot: the robot.
        joints: joints whose placements are computed in advance for batches.
    """

    def position(self, q: np.ndarray) -> PositionKinematics:
        """Kinematics at configurations (..., nq)."""
        return SinglePositionKinematics(self, q) if q.ndim == 1 else BatchPositionKinematics(self, q)

    def gradients(self, q: np.ndarray, v: np.ndarray) -> KinematicDerivatives:
        """Kinematics of one state (nq,), (nv,), with its derivatives."""
        return KinematicDerivatives(SingleVelocityKinematics(SinglePositionKinematics(self, q), v))
