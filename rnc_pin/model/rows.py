"""Rows: a Jacobian on the tangent space and its rate. Constraints and outputs are both made of them.

What a user writes (``NoSideSlip("axle")``) is a *kind*: a description that knows no robot. Bound to
one, it becomes ``Rows``, with every name resolved.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from rnc_pin.errors import InputError
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.robots.robot import Robot


class Rows(ABC):
    """k linear forms on the velocity, with everything a reduction needs to know of them.

    Constraint rows demand ``J v = mu``, with mu = 0 unless they are ``affine``.

    Attributes:
        names: one name for each row, (k,).
        units: unit of each row's rate, (k,).
        constant: whether the rows are the same at every configuration, so that their rate is zero; not if ``affine``.
        conserved: where in ``v`` no actuator may act for the rows to hold (momenta), else None.
        affine: whether mu is not zero.
        holonomic: which rows keep a function of q at zero, (k,), whose value ``residual`` knows. Empty if none
            does. A row that says False may still be integrable together with others.
        on_ground: whether a holonomic row that no joint can move is to be left alone, as the height of a wheel is
            over a base that moves in the plane. Others have to be satisfied.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    constant: bool = False
    conserved: slice | None = None
    affine: bool = False
    holonomic: tuple[bool, ...] = ()
    on_ground: bool = False

    @abstractmethod
    def jacobian(self, state: Kinematics) -> np.ndarray:
        """The rows J(q), (k, nv). Needs ``set_position``."""

    @abstractmethod
    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        """Their rate along v, (k, nv). Needs ``set_rates``."""

    @abstractmethod
    def drift(self, state: Kinematics) -> np.ndarray:
        """``Jdot v - mudot``, (k,), for a velocity that satisfies the constraints.

        Needs ``set_velocity`` only: placements, velocities and accelerations of frames, ``bias``, q and v.
        """

    def rate(self, state: Kinematics) -> np.ndarray:
        """What ``J v`` has to be: mu(q), (k,). Needs ``set_position``."""
        return np.zeros(len(self.names))

    def rate_dot(self, state: Kinematics) -> np.ndarray:
        """Rate of mu along v, (k,). Needs ``set_rates``."""
        return np.zeros(len(self.names))

    def residual(self, state: Kinematics) -> np.ndarray:
        """How far q is from satisfying the holonomic rows, (k,) [m or rad]; zero at the others.

        Its rate is ``J v`` where it is zero. Needs ``set_position``.
        """
        return np.zeros(len(self.names))

    def drift_gradient(self, state: Kinematics) -> np.ndarray | None:
        """Derivative of ``Jdot(q, v) v`` with respect to q, v fixed, (k, nv); None where there is no closed form.

        Needs ``set_gradients``. Only a linearisation about a motion asks for it, and takes differences for None and
        for rows that are ``affine``.
        """
        return np.zeros((len(self.names), state.model.nv)) if self.constant else None

    def lines_of_action(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray] | None:
        """Where in the world the rows act and along what, to be drawn.

        Returns:
            Points (k, 3) [m] and unit vectors (k, 3); None for rows that act on no point, such as a momentum.
            Needs ``set_position``.
        """
        return None


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

    @abstractmethod
    def value(self, state: Kinematics) -> np.ndarray:
        """The coordinates, (k,) [m or rad]; zeros where ``quasi``. Needs ``set_position``."""


@runtime_checkable
class ConstraintKind(Protocol):
    """A description of constraint rows that can be bound to a robot."""

    def bind(self, robot: Robot) -> Rows: ...


@runtime_checkable
class OutputKind(Protocol):
    """A description of outputs that can be bound to a robot."""

    def bind(self, robot: Robot) -> OutputRows: ...


class RowStack:
    """Some rows of several blocks, one under the other.

    Args:
        blocks: the bound rows.
        kept: for each block the indices of the rows that count; all of them by default.
    """

    def __init__(self, blocks: Sequence[Rows], kept: Sequence[Sequence[int]] | None = None) -> None:
        chosen = [tuple(range(len(block.names))) for block in blocks] if kept is None else list(kept)
        self.names = tuple(b.names[i] for b, rows in zip(blocks, chosen, strict=True) for i in rows)
        self.units = tuple(b.units[i] for b, rows in zip(blocks, chosen, strict=True) for i in rows)
        self.size = len(self.names)
        # (rows, where they go, which of them; None for all, which saves a copy on the hot path)
        self.places: list[tuple[Rows, slice, list[int] | None]] = []
        start = 0
        for block, rows in zip(blocks, chosen, strict=True):
            if rows:
                selection = None if len(rows) == len(block.names) else list(rows)
                self.places.append((block, slice(start, start + len(rows)), selection))
            start += len(rows)

        self._varying = [place for place in self.places if not place[0].constant]

    @classmethod
    def joined(cls, *stacks: RowStack) -> RowStack:
        """Several stacks as one."""
        whole = cls([])
        for stack in stacks:
            shifted = [
                (block, slice(place.start + whole.size, place.stop + whole.size), selection)
                for block, place, selection in stack.places
            ]
            whole.places += shifted
            whole.names += stack.names
            whole.units += stack.units
            whole.size += stack.size
        whole._varying = [place for place in whole.places if not place[0].constant]
        return whole

    def prepare(self, state: Kinematics, jacobian: np.ndarray, drift: np.ndarray) -> None:
        """Write what never changes into ``jacobian`` (..., size, nv) and ``drift`` (..., size)."""
        for block, place, selection in self.places:
            if block.constant:
                rows = block.jacobian(state)
                jacobian[..., place, :] = rows if selection is None else rows[selection]
                drift[..., place] = 0.0

    def jacobian(self, state: Kinematics, out: np.ndarray) -> None:
        """Write the rows of J(q) that vary into ``out`` (size, nv), which ``prepare`` has seen."""
        for block, place, selection in self._varying:
            rows = block.jacobian(state)
            out[place] = rows if selection is None else rows[selection]

    def drift(self, state: Kinematics, out: np.ndarray) -> None:
        """Write the entries of ``Jdot v`` that vary into ``out`` (size,), which ``prepare`` has seen."""
        for block, place, selection in self._varying:
            rows = block.drift(state)
            out[place] = rows if selection is None else rows[selection]

    def jacobian_dot(self, state: Kinematics, out: np.ndarray) -> None:
        """Write Jdot(q, v) into ``out`` (size, nv)."""
        self._gather(out, lambda block: block.jacobian_dot(state))

    @property
    def affine(self) -> bool:
        """Whether some row demands a velocity that is not zero."""
        return any(block.affine for block, _, _ in self.places)

    @property
    def holonomic(self) -> tuple[bool, ...]:
        """Which rows keep a function of the configuration at zero, (size,)."""
        flags: list[bool] = []
        for block, _, selection in self.places:
            own = block.holonomic or (False,) * len(block.names)
            flags += own if selection is None else [own[row] for row in selection]
        return tuple(flags)

    def rate(self, state: Kinematics, out: np.ndarray) -> None:
        """Write mu(q) into ``out`` (size,)."""
        self._gather(out, lambda block: block.rate(state))

    def rate_dot(self, state: Kinematics, out: np.ndarray) -> None:
        """Write the rate of mu into ``out`` (size,)."""
        self._gather(out, lambda block: block.rate_dot(state))

    def evaluate(self, state: Kinematics) -> np.ndarray:
        """J(q), (size, nv), in a new array."""
        out = np.empty((self.size, state.model.nv))
        self._gather(out, lambda block: block.jacobian(state))
        return out

    def _gather(self, out: np.ndarray, of: Callable[[Rows], np.ndarray]) -> None:
        """Write what every block says, cut down to its rows that count, into ``out`` (size, ...)."""
        for block, place, selection in self.places:
            rows = of(block)
            out[place] = rows if selection is None else rows[selection]

    def lines_of_action(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray]:
        """Points and unit vectors, (size, 3) each; NaN for rows that act on no point."""
        points, directions = np.full((2, self.size, 3), np.nan)
        for block, place, selection in self.places:
            lines = block.lines_of_action(state)
            if lines is not None:
                chosen = slice(None) if selection is None else selection
                points[place], directions[place] = lines[0][chosen], lines[1][chosen]
        return points, directions


class OutputStack(RowStack):
    """Outputs one under the other, with their values.

    Args:
        blocks: the bound outputs.
    """

    def __init__(self, blocks: Sequence[OutputRows]) -> None:
        super().__init__(blocks)
        self.angular = np.array([angle for block in blocks for angle in block.angular], dtype=bool)
        self.quasi = np.array([block.quasi for block in blocks for _ in block.names], dtype=bool)
        self._outputs = list(blocks)
        rotations = [place.start for block, place, _ in self.places if isinstance(block, OutputRows) and block.rotation]
        self.coordinates = Coordinates(self.angular, rotations)

    def value(self, state: Kinematics, out: np.ndarray) -> None:
        """Write the coordinates into ``out`` (size,)."""
        for (_, place, _), block in zip(self.places, self._outputs, strict=True):
            out[place] = block.value(state)


def checked_rows(rows: object, expected: tuple[int, ...], what: str) -> np.ndarray:
    """An array that a user's function returned, refused with its name when it has the wrong shape."""
    array = np.asarray(rows, dtype=float)
    if array.shape != expected:
        raise InputError(f"{what} returned shape {array.shape}, expected {expected}")
    return array
