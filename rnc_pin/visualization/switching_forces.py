"""Forces of constraints that appear and vanish during a run, for drawings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.row_stack import RowStack
from rnc_pin.model.rows import ConstraintKind, Rows, parts_of
from rnc_pin.robots.robot import Robot
from rnc_pin.visualization.drawn_state import DrawnState


class SwitchingForces:
    """Points and forces of rows that act during a part of a run.

    Args:
        robot: the robot.
        kinds: constraints of all parts of the run; rows of the same names count once.
        multipliers: names of the rows whose multipliers the run has.

    Attributes:
        columns: multiplier of each row (k,) that has one.
    """

    def __init__(self, robot: Robot, kinds: Sequence[ConstraintKind], multipliers: Sequence[str]) -> None:
        blocks: dict[tuple[str, ...], Rows] = {}
        for kind in parts_of(kinds):
            rows = kind.bind(robot)
            blocks.setdefault(rows.names, rows)
        self._rows, self._kinematics = RowStack(list(blocks.values())), Kinematics(robot)
        places = {name: row for row, name in enumerate(self._rows.names)}
        self._places = [places[name] for name in multipliers if name in places]
        self.columns = [column for column, name in enumerate(multipliers) if name in places]

    def force(self, number: int, state: DrawnState) -> tuple[np.ndarray, np.ndarray]:
        """Point (3,) [m] and force (3,) [N] of a row on the robot; zeros while it does not act or acts on no point."""
        value = state.multipliers[self.columns[number]]
        if not value or not np.isfinite(value):  # the lines of a wheel that flies may be undefined
            return np.zeros(3), np.zeros(3)
        points, directions = self._rows.lines_of_action(self._kinematics.position(state.q))
        row = self._places[number]
        # Multipliers are on the side of the inertia forces, so the constraint force has the opposite sign.
        return np.nan_to_num(points[row]), np.nan_to_num(-value * directions[row])
