"""Outputs that a user writes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputRows, checked_rows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class Output:
    """Any output ``x(q)`` with its Jacobian on the tangent space.

    Args:
        value: ``value(q) -> (k,)``, or None for a quasi-velocity.
        jacobian: ``jacobian(q) -> (k, nv)``.
        jacobian_dot: ``jacobian_dot(q, v) -> (k, nv)``, its rate along v.
        names: one for each row.
        angular: whether the values are angles, compared modulo a full turn.

    Raises:
        InputError: a function returns an array of another shape.
    """

    value: Callable[[np.ndarray], np.ndarray] | None
    jacobian: Callable[[np.ndarray], np.ndarray]
    jacobian_dot: Callable[[np.ndarray, np.ndarray], np.ndarray]
    names: Sequence[str]
    angular: bool = False

    def bind(self, robot: Robot) -> OutputRows:
        return _CustomRows(self, robot)


class _CustomRows(OutputRows):
    def __init__(self, kind: Output, robot: Robot) -> None:
        size = len(kind.names)
        if isinstance(kind.names, str) or size == 0:
            raise ConstraintError(f"names of a user-defined output have to be a list of strings, found {kind.names!r}")
        self.names = tuple(kind.names)
        self.units = ("",) * size
        self.angular = (kind.angular,) * size
        self.quasi = kind.value is None
        self._kind = kind
        self._shape = (size, robot.nv)
        checked_rows(kind.jacobian(robot.configuration()), self._shape, f"jacobian(q) of output {self.names}")

    def value(self, state: Kinematics) -> np.ndarray:
        if self._kind.value is None:
            return np.zeros(self._shape[0])
        return checked_rows(self._kind.value(state.q), self._shape[:1], f"value(q) of output {self.names}")

    def jacobian(self, state: Kinematics) -> np.ndarray:
        return checked_rows(self._kind.jacobian(state.q), self._shape, f"jacobian(q) of output {self.names}")

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        rows = self._kind.jacobian_dot(state.q, state.v)
        return checked_rows(rows, self._shape, f"jacobian_dot(q, v) of output {self.names}")

    def drift(self, state: Kinematics) -> np.ndarray:
        return self.jacobian_dot(state) @ state.v
