"""Types of the kinematic quantities at (q), at (q, v), and with rates: a formula reads only what its argument has.

``frame`` is an index. "World axes" are parallel to the world's axes, at the frame's own origin.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
OWN_AXES = pin.ReferenceFrame.LOCAL

Components = slice | list[int]
ALL = slice(0, 6)
"""All components of a spatial motion: linear x, y, z, then angular x, y, z."""


class Placement(NamedTuple):
    """Placement of a frame in the world."""

    rotation: np.ndarray
    """(..., 3, 3)"""
    translation: np.ndarray
    """(..., 3) [m]"""


class PositionKinematics(ABC):
    """Kinematics at configurations.

    Attributes:
        q: (..., nq).
        M: inertia matrices H* (..., nv, nv).
    """

    q: np.ndarray
    M: np.ndarray

    @abstractmethod
    def placement(self, frame: int) -> Placement:
        """Placement of a frame in the world."""

    @abstractmethod
    def rotation(self, frame: int) -> np.ndarray:
        """Rotation of a frame, (..., 3, 3)."""

    @abstractmethod
    def joint_placement(self, joint: int) -> Placement:
        """Placement of the frame that moves with a joint."""

    @abstractmethod
    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        """Frame Jacobian (..., 6, nv) at the frame's origin, or some of its rows; linear rows come first."""

    @abstractmethod
    def with_velocity(self, v: np.ndarray) -> VelocityKinematics:
        """The same configurations with velocities (..., nv)."""


class VelocityKinematics(PositionKinematics):
    """Kinematics at configurations and velocities.

    Attributes:
        v: (..., nv).
        bias: nonlinear effects ``C* v + g*``, (..., nv).
    """

    v: np.ndarray
    bias: np.ndarray

    @abstractmethod
    def velocity(self, frame: int) -> np.ndarray:
        """Velocity of a frame's origin and angular velocity, (..., 6), in world axes."""

    @abstractmethod
    def joint_velocity(self, joint: int) -> np.ndarray:
        """Spatial velocity (..., 6) of the body that moves with a joint, in its own axes."""

    @abstractmethod
    def acceleration(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        """Rate (..., 6), or some of its rows, of the frame's velocity components along ``axes``, at zero ``vdot``."""

    @abstractmethod
    def rates(self) -> RateKinematics:
        """The same states with the rates of Jacobians and of the inertia matrix."""


class RateKinematics(VelocityKinematics):
    """Kinematics at configurations and velocities, with rates along the velocity.

    Attributes:
        C: Coriolis matrices C* (..., nv, nv), with ``Hdot* = C* + C*^T``.
    """

    C: np.ndarray

    @abstractmethod
    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        """Time derivative of ``jacobian``, (..., 6, nv)."""


def over_states(function: Callable[..., object], shape: tuple[int, ...], *arrays: np.ndarray) -> np.ndarray:
    """Apply a function of single states over the leading axes of arrays (..., size); return (..., *shape)."""
    batch = arrays[0].shape[:-1]
    if not batch:
        return np.asarray(function(*arrays), dtype=float)
    out = np.empty((*batch, *shape))
    for i in np.ndindex(batch):
        out[i] = function(*(each[i] for each in arrays))
    return out
