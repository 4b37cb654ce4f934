"""Stacks of rows from several blocks, evaluated at one state or at many."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import EllipsisType
from typing import NamedTuple, TypeVar

import numpy as np

from rnc_pin.errors import DivergenceError
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import ConstantRows, OutputRows, Rows

Selection = slice | list[int]
_Value = TypeVar("_Value")


class Place(NamedTuple):
    """Block of rows with its position in a stack."""

    block: Rows
    where: slice
    """Position of the rows in the stack."""
    rows: Selection | None
    """Selected rows of the block; None for all."""

    def of(self, values: np.ndarray) -> np.ndarray:
        """Entries of the selected rows, from the entries (..., k) of all rows of the block."""
        return values if self.rows is None else values[..., self.rows]

    def of_matrix(self, values: np.ndarray) -> np.ndarray:
        """Selected rows, from all rows (..., k, l) of the block."""
        return values if self.rows is None else values[..., self.rows, :]


class _Varying(NamedTuple):
    """Block of rows that are not constant, with index expressions for arrays (..., size) and (..., size, nv)."""

    block: Rows
    rows: Selection | None
    entries: tuple[EllipsisType, slice]
    lines: tuple[EllipsisType, slice, slice]


class RowStack:
    """Vertical stack of selected rows of several blocks. Results have the leading axes of the states.

    Args:
        blocks: the bound rows.
        kept: indices of the selected rows among all rows, in increasing order; all rows by default.

    Attributes:
        names, units, holonomic: name, unit and holonomic flag of each row, (size,).
        size: number of rows.
        affine, rheonomic, turning: True if any block is.
        places: blocks with the positions of their rows.
    """

    def __init__(self, blocks: Sequence[Rows], kept: Sequence[int] | None = None) -> None:
        self.places: list[Place] = []
        start = first = 0
        for block in blocks:
            size = len(block.names)
            chosen = range(size) if kept is None else [row - first for row in kept if first <= row < first + size]
            if len(chosen):
                where = slice(start, start + len(chosen))
                rows = None if len(chosen) == size else _selection(list(chosen))
                self.places.append(Place(block, where, rows))
            start, first = start + len(chosen), first + size
        self.size = start
        self.names = tuple(name for block, _, rows in self.places for name in _of(block.names, rows))
        self.units = tuple(unit for block, _, rows in self.places for unit in _of(block.units, rows))
        self.holonomic = tuple(
            flag for block, _, rows in self.places for flag in _of(block.holonomic or (False,) * len(block.names), rows)
        )
        self.affine = any(place.block.affine for place in self.places)
        self.rheonomic = any(place.block.rheonomic for place in self.places)
        self.turning = any(place.block.turning for place in self.places)
        self._varying = _varying(self.places)
        self._constant: np.ndarray | None = None
        self._selected: dict[tuple[int, ...], RowStack] = {}

    def selected(self, kept: tuple[int, ...]) -> RowStack:
        """Stack of some rows of a stack with whole blocks, by increasing indices; the same object each time."""
        if kept not in self._selected:
            self._selected[kept] = RowStack([place.block for place in self.places], kept)
        return self._selected[kept]

    @classmethod
    def joined(cls, *stacks: RowStack) -> RowStack:
        """Concatenate several stacks."""
        whole = RowStack([])
        for stack in stacks:
            for block, where, rows in stack.places:
                whole.places.append(Place(block, slice(where.start + whole.size, where.stop + whole.size), rows))
            whole.names, whole.units = whole.names + stack.names, whole.units + stack.units
            whole.holonomic += stack.holonomic
            whole.size += stack.size
            whole.affine |= stack.affine
            whole.rheonomic |= stack.rheonomic
            whole.turning |= stack.turning
        whole._varying = _varying(whole.places)
        return whole

    def template(self, nv: int) -> np.ndarray:
        """Matrix (size, nv), stored by columns, with the values of the constant rows; do not write to it."""
        if self._constant is None:
            self._constant = np.zeros((self.size, nv), order="F")
            for place in self.places:
                if isinstance(place.block, ConstantRows):
                    self._constant[place.where] = place.of_matrix(place.block.matrix)
        return self._constant

    def write_jacobian(self, at: PositionKinematics, out: np.ndarray) -> None:
        """Write the rows of J(q) that are not constant into ``out`` (..., size, nv)."""
        for block, rows, _, lines in self._varying:
            values = block.jacobian(at)
            out[lines] = values if rows is None else values[..., rows, :]

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        """Jacobian J(q), (..., size, nv)."""
        template, batch = self.template(at.M.shape[-1]), at.q.shape[:-1]
        out = np.array(np.broadcast_to(template, (*batch, *template.shape))) if batch else template.copy()
        self.write_jacobian(at, out)
        return out

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        """Bias acceleration ``Jdot v - mudot``, (..., size)."""
        out = np.zeros((*at.q.shape[:-1], self.size))
        for block, rows, entries, _ in self._varying:
            values = block.bias_acceleration(at)
            out[entries] = values if rows is None else values[..., rows]
        return out

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        """Jacobian rate Jdot(q, v), (..., size, nv)."""
        out = np.zeros((*at.q.shape[:-1], self.size, at.M.shape[-1]))
        for block, rows, _, lines in self._varying:
            values = block.jacobian_dot(at)
            out[lines] = values if rows is None else values[..., rows, :]
        return out

    def rate(self, at: PositionKinematics) -> np.ndarray:
        """Right-hand side mu(q) of ``J v = mu``, (..., size)."""
        return self._gather(at, lambda block: block.rate(at))

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        """Rate of mu, (..., size)."""
        return self._gather(at, lambda block: block.rate_dot(at))

    def _gather(self, at: PositionKinematics, of: Callable[[Rows], np.ndarray]) -> np.ndarray:
        """Concatenate a quantity of all blocks, restricted to the selected rows, (..., size)."""
        out = np.empty((*at.q.shape[:-1], self.size))
        for place in self.places:
            out[..., place.where] = place.of(of(place.block))
        return out

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        """Points and unit vectors of the constraint forces, (..., size, 3) each; NaN for rows that act on no point."""
        points, directions = np.full((2, *at.q.shape[:-1], self.size, 3), np.nan)
        for place in self.places:
            lines = place.block.lines_of_action(at)
            if lines is not None:
                points[..., place.where, :], directions[..., place.where, :] = (place.of_matrix(each) for each in lines)
        return points, directions


class OutputStack(RowStack):
    """Vertical stack of outputs, with their values.

    Args:
        blocks: the bound outputs.

    Attributes:
        angular, quasi: masks of the angles and of the quasi-velocities, (size,); ``has_quasi``: True if there are some.
        coordinates: coordinate types of the outputs.
    """

    def __init__(self, blocks: Sequence[OutputRows]) -> None:
        super().__init__(blocks)
        self.angular = np.array([angle for block in blocks for angle in block.angular], dtype=bool)
        self.quasi = np.array([block.quasi for block in blocks for _ in block.names], dtype=bool)
        self.has_quasi = bool(self.quasi.any())
        self._values = [(block, where) for block, where, _ in self.places if isinstance(block, OutputRows)]
        self._generalized = any(block.generalized for block in blocks)
        rotations = [where.start for block, where in self._values if block.rotation]
        self.coordinates = Coordinates(self.angular, rotations, self.names)

    def value(self, at: PositionKinematics) -> np.ndarray:
        """Values of the outputs, (..., size)."""
        out = np.empty((*at.q.shape[:-1], self.size))
        for block, where in self._values:
            out[..., where] = block.value(at)
        return out

    def check(self, value: np.ndarray, *matrices: np.ndarray) -> None:
        """Raise ``DivergenceError`` if values (..., size) or rows (..., size, n) of a user's output are not finite."""
        if self._generalized:
            values = np.concatenate([value[..., None], *matrices], axis=-1)
            finite = np.isfinite(values).all(axis=-1) | self.quasi
            if not finite.all():
                name = self.names[int(finite.reshape(-1, self.size).all(axis=0).argmin())]
                raise DivergenceError(f"output '{name}' is not finite")


def rheonomic_names(stack: RowStack) -> list[str]:
    """Names of the rows that depend on time."""
    return [name for place in stack.places if place.block.rheonomic for name in _of(place.block.names, place.rows)]


def _varying(places: Sequence[Place]) -> list[_Varying]:
    return [
        _Varying(block, rows, (..., where), (..., where, slice(None)))
        for block, where, rows in places
        if not isinstance(block, ConstantRows)
    ]


def _selection(rows: list[int]) -> Selection:
    """Convert consecutive indices to a slice, which gives a view instead of a copy on the hot path."""
    first = rows[0]
    return slice(first, first + len(rows)) if rows == list(range(first, first + len(rows))) else rows


def _of(values: tuple[_Value, ...], rows: Selection | None) -> tuple[_Value, ...]:
    if rows is None:
        return values
    return values[rows] if isinstance(rows, slice) else tuple(values[row] for row in rows)
