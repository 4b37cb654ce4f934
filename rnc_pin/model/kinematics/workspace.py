"""Pinocchio's model and data, and the state for which the data are current."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np
import pinocchio as pin

from rnc_pin.model.kinematics.quantities import Placement, over_states
from rnc_pin.robots.robot import Robot


class Workspace:
    """A model and its Pinocchio data; serves one thread at a time.

    Args:
        robot: the robot.
        joints: joints whose placements are computed in advance for batches.
    """

    def __init__(self, robot: Robot, joints: Iterable[int] = ()) -> None:
        self._robot = robot
        self.model, self.data = robot.model, robot.model.createData()
        self.nq, self.nv = robot.nq, robot.nv
        self.zero = np.zeros(robot.nv)
        self.joints = tuple(sorted({*joints} - {0}))
        # Views of Pinocchio's memory: each call to Pinocchio changes their values.
        self.J, self.dJ = (self.by_columns(block) for block in (self.data.J, self.data.dJ))
        places = {joint: self.data.oMi[joint] for joint in range(robot.model.njoints)}
        self.places = {joint: Placement(place.rotation, place.translation) for joint, place in places.items()}
        self._supports: dict[int, np.ndarray] = {}
        # Arrays for which the data are current. A state compares them by identity and updates the data if they differ.
        self.q: np.ndarray | None = None
        self.v: np.ndarray | None = None
        self._rated: np.ndarray | None = None
        self._graded: np.ndarray | None = None

    def __reduce__(self) -> tuple[type[Workspace], tuple[Robot, tuple[int, ...]]]:
        """Create new Pinocchio data for a copy or a pickle: the views here refer to this workspace's memory."""
        return type(self), (self._robot, self.joints)

    def update_position(self, q: np.ndarray) -> None:
        """Update placements and joint Jacobians to q (nq,)."""
        if self.q is not q:
            pin.computeJointJacobians(self.model, self.data, q)
            self.position_is_current(q)

    def update_velocity(self, q: np.ndarray, v: np.ndarray) -> None:
        """Update velocities and accelerations too, to v (nv,)."""
        self.update_position(q)
        if self.v is not v:
            pin.forwardKinematics(self.model, self.data, q, v, self.zero)
            self.v = v
            self._rated = self._graded = None  # rates and derivatives overwrite each other

    def update_rates(self, q: np.ndarray, v: np.ndarray) -> None:
        """Update time variations of joint Jacobians too."""
        self.update_velocity(q, v)
        if self._rated is not v:
            pin.computeJointJacobiansTimeVariation(self.model, self.data, q, v)
            self._rated = v

    def update_derivatives(self, q: np.ndarray, v: np.ndarray) -> None:
        """Update derivatives of velocities and accelerations with respect to q too."""
        self.update_velocity(q, v)
        if self._graded is not v:
            pin.computeForwardKinematicsDerivatives(self.model, self.data, q, v, self.zero)
            self._graded = v

    def coriolis(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The Coriolis matrix (nv, nv)."""
        self.invalidate()
        return pin.computeCoriolisMatrix(self.model, self.data, q, v)

    def potential_energy(self, q: np.ndarray) -> np.ndarray | float:
        """Potential energy (...) at configurations (..., nq) [J]."""
        self.invalidate()
        energy = over_states(partial(pin.computePotentialEnergy, self.model, self.data), (), q)
        return energy if q.ndim > 1 else float(energy)

    def invalidate(self) -> None:
        """Mark the data as current for no state, before a call that overwrites them."""
        self.q = self.v = self._rated = self._graded = None

    def position_is_current(self, q: np.ndarray) -> None:
        """Mark placements and joint Jacobians as current for q (nq,)."""
        self.q = q
        self.v = self._rated = self._graded = None

    def by_columns(self, matrix: np.ndarray) -> np.ndarray:
        """Matrix (6, nv) from Pinocchio, which returns (6,) for a robot with one degree of freedom."""
        return matrix.reshape(6, self.nv) if self.nv == 1 else matrix

    def support(self, frame: int) -> np.ndarray:
        """Mask (nv,): one for entries of v whose joints support a frame, zero for the others."""
        if frame not in self._supports:
            columns = self._supports[frame] = np.zeros(self.nv)
            for joint in self.model.supports[self.frame(frame)[0]]:
                where = self.model.joints[joint]
                columns[where.idx_v : where.idx_v + where.nv] = 1.0
        return self._supports[frame]

    def frame(self, frame: int) -> tuple[int, pin.SE3]:
        """Joint that supports a frame, and the frame's placement on this joint."""
        found = self.model.frames[frame]
        return found.parentJoint, found.placement
