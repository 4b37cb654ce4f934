"""Rows that a user writes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.kinematics import Kinematics
from rnc_pin.robot import Robot
from rnc_pin.rows import Rows, checked_rows


@dataclass(frozen=True)
class Pfaffian:
    """Any constraint ``A(q) v = 0``.

    Args:
        rows: ``rows(q) -> (k, nv)``.
        rows_dot: ``rows_dot(q, v) -> (k, nv)``, the rate of ``rows`` along v.
        names: one for each row; ``row[0]``, ``row[1]``, ... by default.

    Raises:
        InputError: a function returns an array of another shape.
        ConstraintError: ``names`` does not fit the rows.
    """

    rows: Callable[[np.ndarray], np.ndarray]
    rows_dot: Callable[[np.ndarray, np.ndarray], np.ndarray]
    names: Sequence[str] | None = None

    def bind(self, robot: Robot) -> Rows:
        return _PfaffianRows(self, robot)


class _PfaffianRows(Rows):
    def __init__(self, kind: Pfaffian, robot: Robot) -> None:
        sample = np.atleast_1d(np.asarray(kind.rows(robot.configuration()), dtype=float))
        self._shape = (sample.shape[0], robot.nv)
        self.names = tuple(kind.names or [f"row[{i}]" for i in range(self._shape[0])])
        if len(self.names) != self._shape[0]:
            raise ConstraintError(f"{len(self.names)} names for {self._shape[0]} Pfaffian rows")
        self.units = ("",) * self._shape[0]
        self._kind = kind
        checked_rows(sample, self._shape, "rows(q) of a Pfaffian constraint")

    def jacobian(self, state: Kinematics) -> np.ndarray:
        return checked_rows(self._kind.rows(state.q), self._shape, "rows(q) of a Pfaffian constraint")

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        rows = self._kind.rows_dot(state.q, state.v)
        return checked_rows(rows, self._shape, "rows_dot(q, v) of a Pfaffian constraint")

    def drift(self, state: Kinematics) -> np.ndarray:
        return self.jacobian_dot(state) @ state.v
