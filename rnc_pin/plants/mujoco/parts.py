"""Joints in both worlds: where each stands in Pinocchio's vectors and in MuJoCo's, and how one becomes the other.

Pinocchio writes quaternions as (x, y, z, w), a continuous joint as (cos, sin), and velocities of planar and free joints
along the axes of the moving body. MuJoCo writes (w, x, y, z), a plain angle, and the linear velocity of a free joint
along the axes of the world. Generalized forces go the way of velocities, transposed: power is the same in both.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin


class State(NamedTuple):
    """A configuration and a velocity, in either world."""

    q: np.ndarray
    v: np.ndarray


@dataclass(frozen=True)
class Part(ABC):
    """One joint.

    Attributes:
        name: of the joint.
        q, v: where it begins in Pinocchio's vectors.
        nv: its degrees of freedom there.
        qpos, dof: where it begins in MuJoCo's.
    """

    name: str
    q: int
    v: int
    nv: int
    qpos: int
    dof: int

    @abstractmethod
    def write(self, here: State, there: State) -> None:
        """Pinocchio's state, as MuJoCo's."""

    @abstractmethod
    def read(self, there: State, here: State) -> None:
        """MuJoCo's state, as Pinocchio's."""

    @abstractmethod
    def push(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        """A generalized force as Pinocchio has it (nv,), added to MuJoCo's."""


@dataclass(frozen=True)
class Straight(Part):
    """One that both write alike: hinges, slides, and stacks of them."""

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
    """A hinge without end: (cos, sin) here, an angle that counts its turns there."""

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
    """A ball joint: both have its spin along the axes of the moving body."""

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
    """A base on a plane: two slides and a hinge there; with ``lifted``, a third slide, up, before the hinge."""

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
    """A free base. ``placement`` is that of its joint in the world."""

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
    """A planar base that stands in all six degrees of freedom: x, y and heading are read of it.

    Its height and its lean stay what they are where a planar state is written.
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
    """All joints of a robot.

    Args:
        parts: one for each joint.
        nq, nv: sizes of Pinocchio's vectors.
    """

    def __init__(self, parts: Sequence[Part], nq: int, nv: int) -> None:
        self._parts, self._nq, self._nv = parts, nq, nv
        plain = [part for part in parts if isinstance(part, Straight | Continuous | Ball)]
        self._turning = [part for part in parts if part not in plain]
        self._v = np.array([part.v + k for part in plain for k in range(part.nv)], dtype=int)
        self._dof = np.array([part.dof + k for part in plain for k in range(part.nv)], dtype=int)

    def write(self, q: np.ndarray, v: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """A state as MuJoCo's."""
        for part in self._parts:
            part.write(State(q, v), State(qpos, qvel))

    def read(self, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """MuJoCo's state as q (nq,) and v (nv,)."""
        here = State(np.zeros(self._nq), np.zeros(self._nv))
        for part in self._parts:
            part.read(State(qpos, qvel), here)
        return here

    def dof(self, index: int) -> int | None:
        """Place in MuJoCo's velocities of an entry of v that both write alike; None for the others."""
        found = np.flatnonzero(self._v == index)
        return int(self._dof[found[0]]) if len(found) else None

    def push(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        """A generalized force (nv,), added to MuJoCo's."""
        applied[self._dof] += force[self._v]
        for part in self._turning:
            if force[part.v : part.v + part.nv].any():
                part.push(qpos, force, applied)


def scalar_first(quaternion: np.ndarray) -> np.ndarray:
    """Pinocchio's (x, y, z, w) as MuJoCo's (w, x, y, z)."""
    return quaternion[[3, 0, 1, 2]]


def _scalar_last(quaternion: np.ndarray) -> np.ndarray:
    return quaternion[[1, 2, 3, 0]]


def _pose(values: np.ndarray) -> pin.SE3:
    return pin.XYZQUATToSE3(np.concatenate([values[:3], _scalar_last(values[3:7])]))


def _write_pose(pose: pin.SE3, velocity: np.ndarray, spin: np.ndarray, part: Part, there: State) -> None:
    """A pose and its velocities along the body's axes."""
    values = pin.SE3ToXYZQUAT(pose)
    there.q[part.qpos : part.qpos + 3] = values[:3]
    there.q[part.qpos + 3 : part.qpos + 7] = scalar_first(values[3:])
    there.v[part.dof : part.dof + 3] = pose.rotation @ velocity
    there.v[part.dof + 3 : part.dof + 6] = spin
