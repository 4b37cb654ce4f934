"""Forces f(q, v) that follow from the state, such as those of springs and dampers.

    B T + f(q, v) = H* vdot + C* v + g* + A^T lambda

A *kind* such as ``Spring(output, stiffness)`` is a description without a robot. ``bind(robot)`` resolves its names.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from rnc_pin.errors import ConstraintError, InputError
from rnc_pin.model.kinematics import Kinematics, PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot

_ACTS = 1e-9  # force on a conserved momentum that rounding does not explain, relative to the largest force


class ForceGradient(NamedTuple):
    """Derivatives of a generalized force at one state, along the tangent space at q and by v."""

    q: np.ndarray
    """(nv, nv); the last index is the direction."""
    v: np.ndarray
    """(nv, nv)."""
    error: float
    """Estimated error of finite differences; 0.0 if both are in closed form."""


class PassiveForce(ABC):
    """Generalized force that follows from the state, bound to a robot.

    Attributes:
        name: name in messages and summaries.
        conservative: True if the force is the negative gradient of ``potential``. The work of other forces counts as
            work done on the system.
    """

    name: str
    conservative: bool = False

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
        names: name of each force.

    Raises:
        ConstraintError: an entry is no force.
    """

    def __init__(self, kinds: Sequence[ForceKind], robot: Robot) -> None:
        for place, kind in enumerate(kinds):
            if not isinstance(kind, ForceKind) or isinstance(kind, type):
                raise ConstraintError(f"forces[{place}]: expected an object with bind(robot), found {kind!r}")
        self._forces = [kind.bind(robot) for kind in kinds]
        for kind, force in zip(kinds, self._forces, strict=True):
            if not isinstance(force, PassiveForce):
                raise ConstraintError(f"forces: {kind!r} is no force: expected a kind from rnc_pin.forces")
        self._nv = robot.nv
        self.names = tuple(force.name for force in self._forces)

    def __bool__(self) -> bool:
        return bool(self._forces)

    def total(self, at: VelocityKinematics) -> np.ndarray:
        """Sum of all forces (..., nv)."""
        return self._sum(self._forces, at)

    def without_potential(self, at: VelocityKinematics) -> np.ndarray:
        """Sum of the forces that are not conservative, (..., nv)."""
        return self._sum([each for each in self._forces if not each.conservative], at)

    def _sum(self, forces: Sequence[PassiveForce], at: VelocityKinematics) -> np.ndarray:
        total = np.zeros((*at.q.shape[:-1], self._nv))
        for each in forces:
            total += each.force(at)
        return total

    def potential(self, at: PositionKinematics) -> np.ndarray:
        """Potential energy of all conservative forces (...) [J]."""
        return np.sum([each.potential(at) for each in self._forces], axis=0)

    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        """Derivatives of ``total`` at one state; arguments as of ``PassiveForce.gradient``."""
        q, v, error = np.zeros((self._nv, self._nv)), np.zeros((self._nv, self._nv)), 0.0
        for each in self._forces:
            found = each.gradient(at, along)
            q, v, error = q + found.q, v + found.v, error + found.error
        return ForceGradient(q, v, error)

    def check_conserved(self, blocks: Collection[Rows], kinematics: Kinematics, samples: np.ndarray) -> None:
        """Raise an error if a force acts on a momentum that is declared as conserved.

        Args:
            blocks: bound rows of all constraints.
            kinematics: kinematics of the robot.
            samples: configurations (samples, nq).

        Raises:
            ConstraintError: names the force and the momentum.
        """
        conserved = [block for block in blocks if block.conserved is not None]
        generator = np.random.default_rng(0)
        for q in samples if conserved else ():
            at = kinematics.position(q).with_velocity(generator.uniform(-1.0, 1.0, self._nv))
            for each in self._forces:
                force = np.abs(each.force(at))
                for block in conserved:
                    if force[block.conserved].max() > _ACTS * max(1.0, float(force.max())):
                        raise ConstraintError(f"{each.name} acts on {block.names[0]}, which is declared as conserved")


def admit_coefficients(values: float | Sequence[float], size: int, what: str) -> np.ndarray:
    """Convert one number, or one for each row of an output, to an array (size,).

    Raises:
        InputError: the numbers are not finite, or not as many as the rows.
    """
    found = np.asarray(values, dtype=float)
    if found.ndim > 1 or (found.ndim == 1 and len(found) != size) or not np.isfinite(found).all():
        many = f" or {size}" if size > 1 else ""
        raise InputError(f"{what} {values!r}: expected one finite number{many}")
    return np.array(np.broadcast_to(found, (size,)))
