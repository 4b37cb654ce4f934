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


class State(NamedTuple):
    """Configuration and velocity, in Pinocchio or MuJoCo coordinates."""

    q: np.ndarray
    v: np.ndarray


@dataclass(frozen=True)
class Part(ABC):
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
    def write(self, here: State, there: State) -> None:
        """Write the Pinocchio state ``here`` to the MuJoCo state ``there``."""

    @abstractmethod
    def read(self, there: State, here: State) -> None:
        """Write the MuJoCo state ``there`` to the Pinocchio state ``here``."""

    @abstractmethod
    def push(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        """Add a generalized force of Pinocchio (nv,) to the applied force of MuJoCo."""


@dataclass(frozen=True)
class Straight(Part):
    """Joint with equal coordinates in both: hinges, slides, and stacks of them."""

    def write(self, here: State, there: State) -> None:
        there.q[self.qpos : self.qpos + self.nv] = here.q[self.q : self.q + self.nv]
        there.v[self.dof : self.dof + self.nv] = here.v[self.v : self.v + self.nv]

    def read(self, there: State, here: State) -> None:
        here.q[self.q : self.q + self.nv] = there.q[self.qpos : self.qpos + self.nv]
        here.v[self.v : self.v + self.nv] = there.v[self.dof : self.dof + self.nv]

    def push(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        applied[self.dof : self.dof + self.nv] += force[self.v : self.v + self.nv]


@dataclass(frozen=True)
class Continuous(Part):
    """Continuous hinge: (cos, sin) in Pinocchio, an unwrapped angle in MuJoCo."""

    def write(self, here: State, there: State) -> None:
        there.q[self.qpos] = np.arctan2(here.q[self.q + 1], here.q[self.q])
        there.v[self.dof] = here.v[self.v]

    def read(self, there: State, here: State) -> None:
        here.q[self.q], here.q[self.q + 1] = np.cos(there.q[self.qpos]), np.sin(there.q[self.qpos])
        here.v[self.v] = there.v[self.dof]

    def push(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        applied[self.dof] += force[self.v]


@dataclass(frozen=True)
class Ball(Part):
    """Ball joint: both have its angular velocity in the body frame."""

    def write(self, here: State, there: State) -> None:
        there.q[self.qpos : self.qpos + 4] = scalar_first(here.q[self.q : self.q + 4])
        there.v[self.dof : self.dof + 3] = here.v[self.v : self.v + 3]

    def read(self, there: State, here: State) -> None:
        here.q[self.q : self.q + 4] = _scalar_last(there.q[self.qpos : self.qpos + 4])
        here.v[self.v : self.v + 3] = there.v[self.dof : self.dof + 3]

    def push(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        applied[self.dof : self.dof + 3] += force[self.v : self.v + 3]


@dataclass(frozen=True)
class Planar(Part):
    """Planar base: two slides and a hinge in MuJoCo; ``lifted`` adds a vertical slide before the hinge."""

    lifted: bool = False

    @property
    def _turn(self) -> int:
        return 3 if self.lifted else 2

    def write(self, here: State, there: State) -> None:
        x, y, c, s = here.q[self.q : self.q + 4]
        vx, vy, w = here.v[self.v : self.v + 3]
        there.q[self.qpos : self.qpos + 2] = x, y
        there.q[self.qpos + self._turn] = np.arctan2(s, c)
        there.v[self.dof : self.dof + 2] = c * vx - s * vy, s * vx + c * vy
        there.v[self.dof + self._turn] = w

    def read(self, there: State, here: State) -> None:
        angle = there.q[self.qpos + self._turn]
        c, s = np.cos(angle), np.sin(angle)
        vx, vy = there.v[self.dof : self.dof + 2]
        here.q[self.q : self.q + 4] = *there.q[self.qpos : self.qpos + 2], c, s
        here.v[self.v : self.v + 3] = c * vx + s * vy, c * vy - s * vx, there.v[self.dof + self._turn]

    def push(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        angle = qpos[self.qpos + self._turn]
        c, s = np.cos(angle), np.sin(angle)
        fx, fy, turning = force[self.v : self.v + 3]
        applied[self.dof] += c * fx - s * fy
        applied[self.dof + 1] += s * fx + c * fy
        applied[self.dof + self._turn] += turning


@dataclass(frozen=True)
class Free(Part):
    """Free base. ``placement`` is the joint placement in the world."""

    placement: pin.SE3

    def write(self, here: State, there: State) -> None:
        pose = self.placement * pin.XYZQUATToSE3(here.q[self.q : self.q + 7])
        _write_pose(pose, here.v[self.v : self.v + 3], here.v[self.v + 3 : self.v + 6], self, there)

    def read(self, there: State, here: State) -> None:
        pose = _pose(there.q[self.qpos : self.qpos + 7])
        here.q[self.q : self.q + 7] = pin.SE3ToXYZQUAT(self.placement.actInv(pose))
        here.v[self.v : self.v + 3] = pose.rotation.T @ there.v[self.dof : self.dof + 3]
        here.v[self.v + 3 : self.v + 6] = there.v[self.dof + 3 : self.dof + 6]

    def push(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        rotation = _pose(qpos[self.qpos : self.qpos + 7]).rotation
        applied[self.dof : self.dof + 3] += rotation @ force[self.v : self.v + 3]
        applied[self.dof + 3 : self.dof + 6] += force[self.v + 3 : self.v + 6]


@dataclass(frozen=True)
class Standing(Part):
    """Planar base that has six degrees of freedom in MuJoCo; only x, y and heading are read.

    Writing a planar state keeps height, roll and pitch.
    """

    placement: pin.SE3

    def write(self, here: State, there: State) -> None:
        x, y, c, s = here.q[self.q : self.q + 4]
        vx, vy, w = here.v[self.v : self.v + 3]
        now = self.placement.actInv(_pose(there.q[self.qpos : self.qpos + 7]))
        heading = np.arctan2(now.rotation[1, 0], now.rotation[0, 0])
        turned = pin.utils.rotate("z", np.arctan2(s, c) - heading) @ now.rotation
        pose = self.placement * pin.SE3(turned, np.array([x, y, now.translation[2]]))
        velocity = turned.T @ np.array([c * vx - s * vy, s * vx + c * vy, 0.0])
        _write_pose(pose, velocity, turned.T @ np.array([0.0, 0.0, w]), self, there)

    def read(self, there: State, here: State) -> None:
        pose = self.placement.actInv(_pose(there.q[self.qpos : self.qpos + 7]))
        along = self.placement.rotation.T @ there.v[self.dof : self.dof + 3]
        forward = pose.rotation[:, 0]
        spin = pose.rotation @ there.v[self.dof + 3 : self.dof + 6]
        turning = np.cross(spin, forward)
        length = np.hypot(forward[0], forward[1])
        c, s = forward[0] / length, forward[1] / length
        here.q[self.q : self.q + 4] = pose.translation[0], pose.translation[1], c, s
        rate = (c * turning[1] - s * turning[0]) / length
        here.v[self.v : self.v + 3] = c * along[0] + s * along[1], c * along[1] - s * along[0], rate

    def push(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        pose = _pose(qpos[self.qpos : self.qpos + 7])
        forward = self.placement.rotation.T @ pose.rotation[:, 0]
        heading = np.arctan2(forward[1], forward[0])
        c, s = np.cos(heading), np.sin(heading)
        fx, fy, turning = force[self.v : self.v + 3]
        applied[self.dof : self.dof + 3] += self.placement.rotation @ np.array([c * fx - s * fy, s * fx + c * fy, 0.0])
        up = pose.rotation.T @ self.placement.rotation[:, 2]
        applied[self.dof + 3 : self.dof + 6] += turning * up


class Joints:
    """Conversion of all joints of a robot.

    Args:
        parts: conversion of each joint.
        nq, nv: sizes of Pinocchio's vectors.
    """

    def __init__(self, parts: Sequence[Part], nq: int, nv: int) -> None:
        self._parts, self._nq, self._nv = parts, nq, nv
        plain = [part for part in parts if isinstance(part, Straight | Continuous | Ball)]
        self._turning = [part for part in parts if part not in plain]
        self._v = np.array([part.v + k for part in plain for k in range(part.nv)], dtype=int)
        self._dof = np.array([part.dof + k for part in plain for k in range(part.nv)], dtype=int)

    def write(self, q: np.ndarray, v: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Write a Pinocchio state to MuJoCo's vectors."""
        for part in self._parts:
            part.write(State(q, v), State(qpos, qvel))

    def read(self, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return MuJoCo's state as q (nq,) and v (nv,) of Pinocchio."""
        here = State(np.zeros(self._nq), np.zeros(self._nv))
        for part in self._parts:
            part.read(State(qpos, qvel), here)
        return here

    def dof(self, index: int) -> int | None:
        """Return the MuJoCo index of an entry of v with equal coordinates in both; None for other entries."""
        found = np.flatnonzero(self._v == index)
        return int(self._dof[found[0]]) if len(found) else None

    def push(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        """Add a generalized force (nv,) to the applied force of MuJoCo."""
        applied[self._dof] += force[self._v]
        for part in self._turning:
            if force[part.v : part.v + part.nv].any():
                part.push(qpos, force, applied)


def scalar_first(quaternion: np.ndarray) -> np.ndarray:
    """Convert a quaternion (x, y, z, w) of Pinocchio to (w, x, y, z) of MuJoCo."""
    return quaternion[[3, 0, 1, 2]]


def _scalar_last(quaternion: np.ndarray) -> np.ndarray:
    return quaternion[[1, 2, 3, 0]]


def _pose(values: np.ndarray) -> pin.SE3:
    return pin.XYZQUATToSE3(np.concatenate([values[:3], _scalar_last(values[3:7])]))


def _write_pose(pose: pin.SE3, velocity: np.ndarray, spin: np.ndarray, part: Part, there: State) -> None:
    """Write a pose with its linear and angular velocity in the body frame to MuJoCo's state."""
    values = pin.SE3ToXYZQUAT(pose)
    there.q[part.qpos : part.qpos + 3] = values[:3]
    there.q[part.qpos + 3 : part.qpos + 7] = scalar_first(values[3:])
    there.v[part.dof : part.dof + 3] = pose.rotation @ velocity
    there.v[part.dof + 3 : part.dof + 6] = spin
