"""Rows: a Jacobian on the tangent space and its rate. Constraints and outputs are both made of them.

What a user writes (``NoSideSlip("axle")``) is a *kind*: a description that knows no robot. Bound to one, it becomes
``Rows``, with every name resolved. Rows are written over leading axes, so that one state and many are one formula.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol, runtime_checkable

import numpy as np

from rnc_pin.errors import InputError, SingularityError
from rnc_pin.math.components import Component, smallest
from rnc_pin.model.kinematics import KinematicDerivatives, PositionKinematics, RateKinematics, VelocityKinematics
from rnc_pin.robots.robot import Robot


class Rows(ABC):
    """k linear forms on the velocity, with everything a reduction needs to know of them.

    Constraint rows demand ``J v = mu``, with mu = 0 unless they are ``affine``. Of whatever a method is given it may
    read what that type has: a position knows no velocity.

    Attributes:
        names: one name for each row, (k,).
        units: unit of each row's rate, (k,).
        joints: joints whose placements the rows ask for, directly or by frames on them.
        conserved: entries of ``v`` on which no actuator and no reaction may act for the rows to hold (momenta), else
            None. Such rows have no reaction of their own.
        affine: whether mu is not zero.
        holonomic: which rows keep a function of q at zero, (k,), whose value ``residual`` knows. Empty if none
            does. A row that says False may still be integrable together with others.
        on_ground: whether a holonomic row that no joint can move is to be left alone, as the height of a wheel is
            over a base that moves in the plane. Others have to be satisfied.
        unnamed: whether nobody gave the rows names, so that a system numbers them through.
        kind: the description that was bound, for those who make the same thing of other means, such as a simulator;
            None for rows that a system adds itself.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    joints: tuple[int, ...] = ()
    conserved: slice | None = None
    affine: bool = False
    holonomic: tuple[bool, ...] = ()
    on_ground: bool = False
    unnamed: bool = False
    kind: ConstraintKind | None = None

    @abstractmethod
    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        """The rows J(q), (..., k, nv)."""

    @abstractmethod
    def jacobian_dot(self, at: RateKinematics) -> np.ndarray:
        """Their rate along v, (..., k, nv)."""

    @abstractmethod
    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        """``Jdot v - mudot``, (..., k), for a velocity that satisfies the constraints."""

    def rate(self, at: PositionKinematics) -> np.ndarray:
        """What ``J v`` has to be: mu(q), (..., k)."""
        return self._zeros(at)

    def rate_dot(self, at: RateKinematics) -> np.ndarray:
        """Rate of mu along v, (..., k)."""
        return self._zeros(at)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        """How far q is from satisfying the holonomic rows, (..., k) [m or rad]; zero at the others.

        Its rate is ``J v`` where it is zero.
        """
        return self._zeros(at)

    def bias_acceleration_gradient(self, at: KinematicDerivatives) -> np.ndarray | None:
        """Derivative of ``Jdot(q, v) v`` with respect to q, v fixed, (k, nv); None where there is no closed form.

        Only a linearisation about a motion asks for it, at one state, and takes differences for None and for rows that
        are ``affine``.
        """
        return None

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray] | None:
        """Where in the world the rows act and along what, to be drawn.

        Returns:
            Points (..., k, 3) [m] and unit vectors (..., k, 3); None for rows that act on no point, such as a momentum.
        """
        return None

    def _zeros(self, at: PositionKinematics) -> np.ndarray:
        return np.zeros((*at.q.shape[:-1], len(self.names)))


class ConstantRows(Rows):
    """Rows that are the same at every configuration, so that their rate is zero.

    Attributes:
        matrix: (k, nv).
    """

    matrix: np.ndarray

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return np.broadcast_to(self.matrix, (*at.q.shape[:-1], *self.matrix.shape))

    def jacobian_dot(self, at: RateKinematics) -> np.ndarray:
        return np.zeros((*at.q.shape[:-1], *self.matrix.shape))

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return self._zeros(at)

    def bias_acceleration_gradient(self, at: KinematicDerivatives) -> np.ndarray:
        return np.zeros(self.matrix.shape)


class OutputRows(Rows):
    """Rows that are the rate of a coordinate, or of a quasi-coordinate that has no value of its own.

    Attributes:
        angular: which values are angles, compared modulo a full turn, (k,).
        quasi: whether only the rate exists (a quasi-velocity), so that the value is its integral.
        rotation: whether the three values are a rotation vector, and the rates an angular velocity in world axes.
    """

    angular: tuple[bool, ...]
    quasi: bool = False
    rotation: bool = False

    def value(self, at: PositionKinematics) -> np.ndarray:
        """The coordinates, (..., k) [m or rad]; zeros where ``quasi``."""
        return self._zeros(at)


@runtime_checkable
class ConstraintKind(Protocol):
    """A description of constraint rows that can be bound to a robot."""

    def bind(self, robot: Robot) -> Rows: ...


@runtime_checkable
class OutputKind(Protocol):
    """A description of outputs that can be bound to a robot."""

    def bind(self, robot: Robot) -> OutputRows: ...


def check_defined(what: str, at: PositionKinematics, sizes: Component, limit: float, names: tuple[str, ...]) -> None:
    """Refuse states at which rows have no meaning, because something in them is too small.

    Args:
        what: why, in words.
        at: the states.
        sizes: what has to be larger than the limit, a number or one for each state.
        limit: the limit.
        names: of the rows.

    Raises:
        SingularityError: with the first such state.
    """
    if smallest(sizes) >= limit:
        return
    flat = np.broadcast_to(sizes, at.q.shape[:-1]).reshape(-1)
    first = int(np.argmax(~(flat >= limit)))
    if np.isnan(flat[first]):
        return  # a configuration that is not finite has an error of its own
    q = at.q.reshape(-1, at.q.shape[-1])[first].copy()
    raise SingularityError(what, q=q, condition=1 / max(float(flat[first]), 1e-300), rows=names)


def admit_rows(rows: object, expected: tuple[int, ...], what: str) -> np.ndarray:
    """An array that a user's function returned, refused with its name when it has the wrong shape."""
    array = np.asarray(rows, dtype=float)
    if array.shape != expected:
        raise InputError(f"{what} returned shape {array.shape}, expected {expected}")
    return array
