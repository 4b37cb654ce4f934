"""Conversion of joint states and forces between Pinocchio and MuJoCo.

Pinocchio has quaternions (x, y, z, w), (cos, sin) for continuous joints, and velocities of planar and free joints in
the body frame. MuJoCo has (w, x, y, z), a plain angle, and the linear velocity of a free joint in the world frame.
Generalized forces transform by the transpose of the velocity map, since power is the same in both.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.model.coordinates import heading_of


@dataclass(frozen=True)
class JointCoordinates:
    """Place of one joint in the vectors of Pinocchio and of MuJoCo, where its velocities are equal.

    Attributes:
        name: joint name.
        q, v: first indices in Pinocchio's vectors.
        nv: degrees of freedom in Pinocchio.
        qpos, dof: first indices in MuJoCo's vectors.
    """

    name: str
    q: int
    v: int
    nv: int
    qpos: int
    dof: int


@dataclass(frozen=True)
class EqualCoordinates(JointCoordinates):
    """Joint with equal numbers in both: hinges, slides, stacks of them, and quaternions of ball joints."""

    order: tuple[int, ...]
    """Entry in q of each entry in MuJoCo's positions."""


class ContinuousHinge(JointCoordinates):
    """Continuous hinge: (cos, sin) in Pinocchio, an unwrapped angle in MuJoCo."""


@dataclass(frozen=True)
class BaseCoordinates(JointCoordinates, ABC):
    """Conversion of a planar or free base, whose velocities differ: MuJoCo has ``velocity_map(qpos) @ v``."""

    def write(self, q: np.ndarray, v: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Write a Pinocchio state to MuJoCo's.

        Args:
            q: configuration (nq,).
            v: velocity (nv,).
            qpos, qvel: vectors of MuJoCo, which receive the base.
        """
        self.write_pose(q[self.q :], qpos[self.qpos :])
        J = self.velocity_map(qpos[self.qpos :])
        qvel[self.dof : self.dof + len(J)] = J @ v[self.v : self.v + self.nv]

    def read(self, qpos: np.ndarray, qvel: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Write a MuJoCo state to Pinocchio's.

        Args:
            qpos, qvel: vectors of MuJoCo.
            q: configuration (nq,), which receives the base.
            v: velocity (nv,), which receives the base.
        """
        self.read_pose(qpos[self.qpos :], q[self.q :])
        J = self.velocity_map(qpos[self.qpos :])  # its columns are orthonormal
        v[self.v : self.v + self.nv] = qvel[self.dof : self.dof + len(J)] @ J

    def add_force(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        """Add a generalized force of Pinocchio (nv,) to the applied force of MuJoCo.

        Args:
            qpos: positions of MuJoCo.
            force: generalized force (nv,).
            applied: applied force of MuJoCo, which receives it.
        """
        J = self.velocity_map(qpos[self.qpos :])
        applied[self.dof : self.dof + len(J)] += J @ force[self.v : self.v + self.nv]

    @abstractmethod
    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        """Write the pose of Pinocchio to MuJoCo's; both begin with the base.

        Args:
            q: configuration.
            qpos: positions of MuJoCo, which receive it.
        """

    @abstractmethod
    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        """Write the pose of MuJoCo to Pinocchio's; both begin with the base.

        Args:
            qpos: positions of MuJoCo.
            q: configuration, which receives it.
        """

    @abstractmethod
    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        """Velocities of MuJoCo from those of Pinocchio, (k, nv).

        Args:
            qpos: positions of MuJoCo that begin with the base.
        """


@dataclass(frozen=True)
class PlanarBase(BaseCoordinates):
    """Planar base: two slides and a hinge in MuJoCo; ``lifted`` adds a vertical slide before the hinge."""

    lifted: bool = False

    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        qpos[:2], qpos[2 + self.lifted] = q[:2], np.arctan2(q[3], q[2])

    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        angle = qpos[2 + self.lifted]
        q[:4] = *qpos[:2], np.cos(angle), np.sin(angle)

    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        found = np.zeros((3 + self.lifted, 3))
        found[:2, :2], found[-1, 2] = pin.utils.rotate("z", qpos[2 + self.lifted])[:2, :2], 1.0
        return found


@dataclass(frozen=True)
class FreeBase(BaseCoordinates):
    """Free base. ``placement`` is the joint placement in the world."""

    placement: pin.SE3

    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        _write_pose(self.placement * pin.XYZQUATToSE3(q[:7]), qpos)

    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        q[:7] = pin.SE3ToXYZQUAT(self.placement.actInv(_pose(qpos)))

    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        return scipy.linalg.block_diag(_pose(qpos).rotation, np.eye(3))


@dataclass(frozen=True)
class FreePlanarBase(BaseCoordinates):
    """Planar base that has six degrees of freedom in MuJoCo; only x, y and heading are read.

    Writing a planar state keeps height, roll and pitch.
    """

    placement: pin.SE3

    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        now = self.placement.actInv(_pose(qpos))
        # About the vertical only: the body keeps the lean that its load gives it.
        turned = pin.utils.rotate("z", np.arctan2(q[3], q[2]) - heading_of(now.rotation)) @ now.rotation
        _write_pose(self.placement * pin.SE3(turned, np.array([*q[:2], now.translation[2]])), qpos)

    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        pose = self.placement.actInv(_pose(qpos))
        heading = heading_of(pose.rotation)
        q[:4] = *pose.translation[:2], np.cos(heading), np.sin(heading)

    def read(self, qpos: np.ndarray, qvel: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        super().read(qpos, qvel, q, v)
        rotation = self.placement.actInv(_pose(qpos[self.qpos :])).rotation
        forward = rotation[:, 0]
        rate = np.cross(rotation @ qvel[self.dof + 3 : self.dof + 6], forward)
        # The heading is the direction of the body's x axis along the ground, also of a body that leans.
        v[self.v + 2] = (forward[0] * rate[1] - forward[1] * rate[0]) / (forward[0] ** 2 + forward[1] ** 2)

    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        rotation, placed = _pose(qpos).rotation, self.placement.rotation
        heading = heading_of(placed.T @ rotation)
        # MuJoCo has the linear velocity in the world, and turns of free bodies in their own axes.
        along, up = placed @ pin.utils.rotate("z", heading)[:, :2], rotation.T @ placed[:, 2:]
        return scipy.linalg.block_diag(along, up)


class RobotCoordinates:
    """Conversion of all joints of a robot.

    Args:
        joints: conversion of each joint.
        nq, nv: sizes of Pinocchio's vectors.
    """

    def __init__(self, joints: Sequence[JointCoordinates], nq: int, nv: int) -> None:
        self._nq, self._nv = nq, nv
        self._bases = [joint for joint in joints if isinstance(joint, BaseCoordinates)]
        equal = [joint for joint in joints if isinstance(joint, EqualCoordinates)]
        turning = [joint for joint in joints if isinstance(joint, ContinuousHinge)]
        # In one call for all joints but bases: they are read and written at each step.
        self._v, self._dof = _paired((each.v + k, each.dof + k) for each in [*equal, *turning] for k in range(each.nv))
        self._q, self._qpos = _paired((each.q + i, each.qpos + k) for each in equal for k, i in enumerate(each.order))
        self._cosine, self._angle = _paired((each.q, each.qpos) for each in turning)

    def write(self, q: np.ndarray, v: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Write a Pinocchio state to MuJoCo's vectors.

        Args:
            q: configuration (nq,).
            v: velocity (nv,).
            qpos, qvel: vectors of MuJoCo, which receive the state.
        """
        qpos[self._qpos], qvel[self._dof] = q[self._q], v[self._v]
        qpos[self._angle] = np.arctan2(q[self._cosine + 1], q[self._cosine])
        for base in self._bases:
            base.write(q, v, qpos, qvel)

    def read(self, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return MuJoCo's state as q (nq,) and v (nv,) of Pinocchio.

        Args:
            qpos, qvel: vectors of MuJoCo.
        """
        q, v = np.zeros(self._nq), np.zeros(self._nv)
        q[self._q], v[self._v] = qpos[self._qpos], qvel[self._dof]
        q[self._cosine], q[self._cosine + 1] = np.cos(qpos[self._angle]), np.sin(qpos[self._angle])
        for base in self._bases:
            base.read(qpos, qvel, q, v)
        return q, v

    def add_force(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        """Add a generalized force (nv,) to the applied force of MuJoCo.

        Args:
            qpos: positions of MuJoCo.
            force: generalized force (nv,).
            applied: applied force of MuJoCo, which receives it.
        """
        applied[self._dof] += force[self._v]
        for joint in self._bases:
            # Most forces act on joints: a base is asked for its rotation only where one acts on it.
            if force[joint.v : joint.v + joint.nv].any():
                joint.add_force(qpos, force, applied)


def _paired(pairs: Iterable[tuple[int, int]]) -> np.ndarray:
    """Indices (2, k) of entries in the vectors of Pinocchio and of MuJoCo."""
    return np.array([*pairs], dtype=int).reshape(-1, 2).T


def scalar_first(quaternion: np.ndarray) -> np.ndarray:
    """Convert a quaternion (x, y, z, w) of Pinocchio to (w, x, y, z) of MuJoCo.

    Args:
        quaternion: four numbers (4,).
    """
    return quaternion[[3, 0, 1, 2]]


def _scalar_last(quaternion: np.ndarray) -> np.ndarray:
    return quaternion[[1, 2, 3, 0]]


def _pose(qpos: np.ndarray) -> pin.SE3:
    return pin.XYZQUATToSE3(np.concatenate([qpos[:3], _scalar_last(qpos[3:7])]))


def _write_pose(pose: pin.SE3, qpos: np.ndarray) -> None:
    values = pin.SE3ToXYZQUAT(pose)
    qpos[:3], qpos[3:7] = values[:3], scalar_first(values[3:])
