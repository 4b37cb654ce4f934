"""Forces f(q, v) that follow from the state, such as those of springs and dampers.

    B T + f(q, v) = H* vdot + C* v + g* + A^T lambda

A *kind* such as ``Spring(output, stiffness)`` is a description without a robot. ``bind(robot)`` resolves its names.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from rnc_pin.errors import ConstraintError, InputError
from rnc_pin.model.kernel_rows import KernelForce, KernelRow
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.robots.robot import Robot


class ForceGradient(NamedTuple):
    """Derivatives of a generalized force at one state, along the tangent space at q and by v."""

    q: np.ndarray
    """(nv, nv); the last index is the direction."""
    v: np.ndarray
    """(nv, nv)."""
    error: float
    """Estimated error of finite differences; 0.0 if both are in closed form."""


class ForceSums(NamedTuple):
    """Sums of forces (..., nv)."""

    total: np.ndarray
    without_potential: np.ndarray
    """Sum of the forces that are not conservative."""


class PassiveForce(ABC):
    """Generalized force that follows from the state, bound to a robot.

    Attributes:
        name: name in messages and summaries.
        conservative: True if the force is the negative gradient of ``potential``. The work of other forces counts as
            work done on the system.
        generalized: True if it is a user's function of q and v, so that its wrench on the robot is unknown.
    """

    name: str
    conservative: bool = False
    generalized: bool = False

    @abstractmethod
    def force(self, at: VelocityKinematics) -> np.ndarray:
        """Generalized force (..., nv)."""

    @abstractmethod
    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        """Derivatives at one state.

        Args:
            at: the state.
            along: kinematics at the same configuration for each unit velocity, (nv,) states.
        """

    def potential(self, at: PositionKinematics) -> np.ndarray:
        """Potential energy (...) [J]; zero if not ``conservative``."""
        return np.zeros(at.q.shape[:-1])

    def kernel_forces(self) -> list[tuple[KernelRow, KernelForce]] | None:
        """Rows along which the force acts, with their laws, for the compiled kernel; None if Python evaluates it."""
        return None


@runtime_checkable
class ForceKind(Protocol):
    """Description of a force that can be bound to a robot."""

    def bind(self, robot: Robot) -> PassiveForce: ...


class PassiveForces:
    """All passive forces of a system.

    Args:
        kinds: descriptions.
        robot: the robot on which they act.

    Attributes:
        kinds: the descriptions.
        names: name of each force.

    Raises:
        ConstraintError: an entry is no force.
    """

    def __init__(self, kinds: Sequence[ForceKind], robot: Robot) -> None:
        self.kinds, self._forces = tuple(kinds), [kind.bind(robot) for kind in kinds]
        for kind, force in zip(kinds, self._forces, strict=True):
            if not isinstance(force, PassiveForce):
                raise ConstraintError(f"forces: {kind!r} is no force: expected a kind from rnc_pin.forces")
        self._nv = robot.nv
        self.names = tuple(force.name for force in self._forces)

    def __bool__(self) -> bool:
        return bool(self._forces)

    def __iter__(self) -> Iterator[PassiveForce]:
        return iter(self._forces)

    def sums(self, at: VelocityKinematics) -> ForceSums:
        """Sums of the forces at states."""
        total, without_potential = np.zeros((2, *at.q.shape[:-1], self._nv))
        for each in self._forces:
            force = each.force(at)
            total += force
            if not each.conservative:
                without_potential += force
        return ForceSums(total, without_potential)

    def kernel_forces(self) -> list[tuple[KernelRow, KernelForce]] | None:
        """Rows and laws of all forces for the compiled kernel; None if Python evaluates one of them."""
        found = [each.kernel_forces() for each in self._forces]
        known = [each for each in found if each is not None]
        return [pair for pairs in known for pair in pairs] if len(known) == len(found) else None

    def potential(self, at: PositionKinematics) -> np.ndarray:
        """Potential energy of all conservative forces (...) [J]."""
        return np.sum([each.potential(at) for each in self._forces], axis=0)

    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        """Derivatives of the total force at one state; arguments as of ``PassiveForce.gradient``."""
        q, v, error = np.zeros((self._nv, self._nv)), np.zeros((self._nv, self._nv)), 0.0
        for each in self._forces:
            found = each.gradient(at, along)
            q, v, error = q + found.q, v + found.v, error + found.error
        return ForceGradient(q, v, error)


def admit_coefficients(values: float | Sequence[float], size: int, what: str) -> np.ndarray:
    """Convert one number, or one for each row of an output, to an array (size,).

    Raises:
        InputError: the numbers are not finite, or not as many as the rows.
    """
    found = np.asarray(values, dtype=float)
    if found.shape not in ((), (size,)) or not np.isfinite(found).all():
        many = f" or {size}" if size > 1 else ""
        raise InputError(f"{what} {values!r}: expected one finite number{many}")
    return np.array(np.broadcast_to(found, (size,)))
