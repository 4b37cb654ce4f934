"""Conversion of joint states and forces between Pinocchio and MuJoCo.

Pinocchio has quaternions (x, y, z, w), (cos, sin) for continuous joints, and velocities of planar and free joints in
the body frame. MuJoCo has (w, x, y, z), a plain angle, and the linear velocity of a free joint in the world frame.
Generalized forces transform by the transpose of the velocity map, since power is the same in both.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.model.coordinates import heading_of


class JointState(NamedTuple):
    """Configuration and velocity, in Pinocchio or MuJoCo coordinates."""

    q: np.ndarray
    v: np.ndarray


@dataclass(frozen=True)
class JointCoordinates(ABC):
    """Conversion of one joint.

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

    @abstractmethod
    def write(self, pinocchio: JointState, mujoco: JointState) -> None:
        """Write a Pinocchio state to MuJoCo's; ``RobotCoordinates`` writes equal velocities.

        Args:
            pinocchio: state of the robot.
            mujoco: state that receives the joint.
        """

    @abstractmethod
    def read(self, mujoco: JointState, pinocchio: JointState) -> None:
        """Write a MuJoCo state to Pinocchio's; ``RobotCoordinates`` reads equal velocities.

        Args:
            mujoco: state of the robot.
            pinocchio: state that receives the joint.
        """


@dataclass(frozen=True)
class EqualCoordinates(JointCoordinates):
    """Joint with equal coordinates in both: hinges, slides, and stacks of them."""

    def write(self, pinocchio: JointState, mujoco: JointState) -> None:
        mujoco.q[self.qpos : self.qpos + self.nv] = pinocchio.q[self.q : self.q + self.nv]

    def read(self, mujoco: JointState, pinocchio: JointState) -> None:
        pinocchio.q[self.q : self.q + self.nv] = mujoco.q[self.qpos : self.qpos + self.nv]


@dataclass(frozen=True)
class ContinuousHinge(JointCoordinates):
    """Continuous hinge: (cos, sin) in Pinocchio, an unwrapped angle in MuJoCo."""

    def write(self, pinocchio: JointState, mujoco: JointState) -> None:
        mujoco.q[self.qpos] = np.arctan2(pinocchio.q[self.q + 1], pinocchio.q[self.q])

    def read(self, mujoco: JointState, pinocchio: JointState) -> None:
        pinocchio.q[self.q], pinocchio.q[self.q + 1] = np.cos(mujoco.q[self.qpos]), np.sin(mujoco.q[self.qpos])


@dataclass(frozen=True)
class BallJoint(JointCoordinates):
    """Ball joint: both have its angular velocity in the body frame."""

    def write(self, pinocchio: JointState, mujoco: JointState) -> None:
        mujoco.q[self.qpos : self.qpos + 4] = scalar_first(pinocchio.q[self.q : self.q + 4])

    def read(self, mujoco: JointState, pinocchio: JointState) -> None:
        pinocchio.q[self.q : self.q + 4] = _scalar_last(mujoco.q[self.qpos : self.qpos + 4])


class BaseCoordinates(JointCoordinates):
    """Conversion of a planar or free base, whose velocities differ."""

    @abstractmethod
    def add_force(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        """Add a generalized force of Pinocchio (nv,) to the applied force of MuJoCo.

        Args:
            qpos: positions of MuJoCo.
            force: generalized force (nv,).
            applied: applied force of MuJoCo, which receives it.
        """


@dataclass(frozen=True)
class PlanarBase(BaseCoordinates):
    """Planar base: two slides and a hinge in MuJoCo; ``lifted`` adds a vertical slide before the hinge."""

    lifted: bool = False

    @property
    def _turn(self) -> int:
        return 3 if self.lifted else 2

    def write(self, pinocchio: JointState, mujoco: JointState) -> None:
        x, y, c, s = pinocchio.q[self.q : self.q + 4]
        vx, vy, w = pinocchio.v[self.v : self.v + 3]
        mujoco.q[self.qpos : self.qpos + 2] = x, y
        mujoco.q[self.qpos + self._turn] = np.arctan2(s, c)
        mujoco.v[self.dof : self.dof + 2] = c * vx - s * vy, s * vx + c * vy
        mujoco.v[self.dof + self._turn] = w

    def read(self, mujoco: JointState, pinocchio: JointState) -> None:
        angle = mujoco.q[self.qpos + self._turn]
        c, s = np.cos(angle), np.sin(angle)
        vx, vy = mujoco.v[self.dof : self.dof + 2]
        pinocchio.q[self.q : self.q + 4] = *mujoco.q[self.qpos : self.qpos + 2], c, s
        pinocchio.v[self.v : self.v + 3] = c * vx + s * vy, c * vy - s * vx, mujoco.v[self.dof + self._turn]

    def add_force(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        angle = qpos[self.qpos + self._turn]
        c, s = np.cos(angle), np.sin(angle)
        fx, fy, torque = force[self.v : self.v + 3]
        applied[self.dof] += c * fx - s * fy
        applied[self.dof + 1] += s * fx + c * fy
        applied[self.dof + self._turn] += torque


@dataclass(frozen=True)
class FreeBase(BaseCoordinates):
    """Free base. ``placement`` is the joint placement in the world."""

    placement: pin.SE3

    def write(self, pinocchio: JointState, mujoco: JointState) -> None:
        pose = self.placement * pin.XYZQUATToSE3(pinocchio.q[self.q : self.q + 7])
        _write_pose(pose, pinocchio.v[self.v : self.v + 3], pinocchio.v[self.v + 3 : self.v + 6], self, mujoco)

    def read(self, mujoco: JointState, pinocchio: JointState) -> None:
        pose = _pose(mujoco.q[self.qpos : self.qpos + 7])
        pinocchio.q[self.q : self.q + 7] = pin.SE3ToXYZQUAT(self.placement.actInv(pose))
        pinocchio.v[self.v : self.v + 3] = pose.rotation.T @ mujoco.v[self.dof : self.dof + 3]
        pinocchio.v[self.v + 3 : self.v + 6] = mujoco.v[self.dof + 3 : self.dof + 6]

    def add_force(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        rotation = _pose(qpos[self.qpos : self.qpos + 7]).rotation
        applied[self.dof : self.dof + 3] += rotation @ force[self.v : self.v + 3]
        applied[self.dof + 3 : self.dof + 6] += force[self.v + 3 : self.v + 6]


@dataclass(frozen=True)
class FreePlanarBase(BaseCoordinates):
    """Planar base that has six degrees of freedom in MuJoCo; only x, y and heading are read.

    Writing a planar state keeps height, roll and pitch.
    """

    placement: pin.SE3

    def write(self, pinocchio: JointState, mujoco: JointState) -> None:
        x, y, c, s = pinocchio.q[self.q : self.q + 4]
        vx, vy, w = pinocchio.v[self.v : self.v + 3]
        now = self.placement.actInv(_pose(mujoco.q[self.qpos : self.qpos + 7]))
        # About the vertical only: the body keeps the lean that its load gives it.
        turned = pin.utils.rotate("z", np.arctan2(s, c) - heading_of(now.rotation)) @ now.rotation
        pose = self.placement * pin.SE3(turned, np.array([x, y, now.translation[2]]))
        velocity = turned.T @ np.array([c * vx - s * vy, s * vx + c * vy, 0.0])
        _write_pose(pose, velocity, turned.T @ np.array([0.0, 0.0, w]), self, mujoco)

    def read(self, mujoco: JointState, pinocchio: JointState) -> None:
        pose = self.placement.actInv(_pose(mujoco.q[self.qpos : self.qpos + 7]))
        along = self.placement.rotation.T @ mujoco.v[self.dof : self.dof + 3]
        forward = pose.rotation[:, 0]
        angular_velocity = pose.rotation @ mujoco.v[self.dof + 3 : self.dof + 6]
        forward_rate = np.cross(angular_velocity, forward)
        # The heading is the direction of the body's x axis along the ground, also of a body that leans.
        length = np.hypot(forward[0], forward[1])
        c, s = forward[0] / length, forward[1] / length
        pinocchio.q[self.q : self.q + 4] = pose.translation[0], pose.translation[1], c, s
        rate = (c * forward_rate[1] - s * forward_rate[0]) / length
        pinocchio.v[self.v : self.v + 3] = c * along[0] + s * along[1], c * along[1] - s * along[0], rate

    def add_force(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        pose = _pose(qpos[self.qpos : self.qpos + 7])
        forward = self.placement.rotation.T @ pose.rotation[:, 0]
        heading = np.arctan2(forward[1], forward[0])
        c, s = np.cos(heading), np.sin(heading)
        fx, fy, torque = force[self.v : self.v + 3]
        applied[self.dof : self.dof + 3] += self.placement.rotation @ np.array([c * fx - s * fy, s * fx + c * fy, 0.0])
        # MuJoCo has torques of free bodies in their own axes.
        up = pose.rotation.T @ self.placement.rotation[:, 2]
        applied[self.dof + 3 : self.dof + 6] += torque * up


class RobotCoordinates:
    """Conversion of all joints of a robot.

    Args:
        joints: conversion of each joint.
        nq, nv: sizes of Pinocchio's vectors.
    """

    def __init__(self, joints: Sequence[JointCoordinates], nq: int, nv: int) -> None:
        self._joints, self._nq, self._nv = joints, nq, nv
        self._bases = [joint for joint in joints if isinstance(joint, BaseCoordinates)]
        equal = [joint for joint in joints if not isinstance(joint, BaseCoordinates)]
        # In one call for all joints but bases: they are read and written at each step.
        self._v = np.array([joint.v + k for joint in equal for k in range(joint.nv)], dtype=int)
        self._dof = np.array([joint.dof + k for joint in equal for k in range(joint.nv)], dtype=int)

    def write(self, q: np.ndarray, v: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Write a Pinocchio state to MuJoCo's vectors.

        Args:
            q: configuration (nq,).
            v: velocity (nv,).
            qpos, qvel: vectors of MuJoCo, which receive the state.
        """
        qvel[self._dof] = v[self._v]
        for joint in self._joints:
            joint.write(JointState(q, v), JointState(qpos, qvel))

    def read(self, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return MuJoCo's state as q (nq,) and v (nv,) of Pinocchio.

        Args:
            qpos, qvel: vectors of MuJoCo.
        """
        pinocchio = JointState(np.zeros(self._nq), np.zeros(self._nv))
        pinocchio.v[self._v] = qvel[self._dof]
        for joint in self._joints:
            joint.read(JointState(qpos, qvel), pinocchio)
        return pinocchio

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


def scalar_first(quaternion: np.ndarray) -> np.ndarray:
    """Convert a quaternion (x, y, z, w) of Pinocchio to (w, x, y, z) of MuJoCo.

    Args:
        quaternion: four numbers (4,).
    """
    return quaternion[[3, 0, 1, 2]]


def _scalar_last(quaternion: np.ndarray) -> np.ndarray:
    return quaternion[[1, 2, 3, 0]]


def _pose(values: np.ndarray) -> pin.SE3:
    return pin.XYZQUATToSE3(np.concatenate([values[:3], _scalar_last(values[3:7])]))


def _write_pose(
    pose: pin.SE3, velocity: np.ndarray, angular_velocity: np.ndarray, joint: JointCoordinates, mujoco: JointState
) -> None:
    """Write a pose with its linear and angular velocity in the body frame to MuJoCo's state."""
    values = pin.SE3ToXYZQUAT(pose)
    mujoco.q[joint.qpos : joint.qpos + 3] = values[:3]
    mujoco.q[joint.qpos + 3 : joint.qpos + 7] = scalar_first(values[3:])
    mujoco.v[joint.dof : joint.dof + 3] = pose.rotation @ velocity
    mujoco.v[joint.dof + 3 : joint.dof + 6] = angular_velocity
