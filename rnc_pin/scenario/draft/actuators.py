"""What pushes a robot: what its file drives, and what else is driven where that cannot do it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np

from rnc_pin.math.linear_algebra import unit_rows
from rnc_pin.robots.robot import Robot
from rnc_pin.scenario.draft.mobility import Entry, Mobility
from rnc_pin.scenario.draft.tolerances import DRIVEN

_UNPOWERED = "the file gives it no effort, or it would be carried along: CHECK"
_UNTOLD = "stands for what the file does not tell of: CHECK"


@dataclass(frozen=True)
class Actuators:
    """Entries that may drive a robot, one input each, with a remark each.

    Attributes:
        sure: of the base and of joints that have an effort.
        joints: passive ones, driven where the rest cannot do it.
        forces: on the base, which stand for what the file does not tell of.
    """

    sure: list[tuple[Entry, str]]
    joints: list[tuple[Entry, str]]
    forces: list[tuple[Entry, str]]

    @property
    def all(self) -> list[tuple[Entry, str]]:
        """The likeliest first."""
        return [*self.sure, *self.joints, *self.forces]

    def enough(self, input_matrix: np.ndarray) -> list[tuple[Entry, str]]:
        """The sure ones, and of the others in order those that make one more reduced force.

        Args:
            input_matrix: reduced forces for inputs of all of them (r, p).
        """
        columns = list(range(len(self.sure)))
        for column in range(len(self.sure), len(self.all)):
            if _rank(input_matrix[:, [*columns, column]]) > _rank(input_matrix[:, columns]):
                columns.append(column)
        return [self.all[column] for column in columns]


def candidates(mobility: Mobility, robot: Robot, start: Iterable[str], undriven: Collection[str] = ()) -> Actuators:
    """What may drive a robot with a base of one kind.

    Args:
        mobility: how the base stands.
        robot: with that base.
        start: its joints with one degree of freedom.
        undriven: joints that the file says to be passive, by naming the actuators of others.
    """
    joints = [name for name in start if name not in undriven]
    driving = [
        (entry, remark) for entry, remark in mobility.actuators if not (isinstance(entry, str) and entry in undriven)
    ]
    named = {entry for entry, _ in driving if isinstance(entry, str)}
    conserved = {entry.get("momentum") for entry, _ in mobility.constraints if isinstance(entry, dict)}
    followers = {mimic.joint for mimic in robot.mimics}
    sure = [name for name in joints if name not in named | mobility.passive | conserved]
    unpowered = [name for name in joints if name in mobility.passive - conserved - named - followers]
    given = [entry for entry, _ in driving]
    return Actuators(
        [*driving, *((name, "") for name in sure)],
        [(name, _UNPOWERED) for name in unpowered],
        [(force, _UNTOLD) for force in _forces(mobility) if force not in given],
    )


def _forces(mobility: Mobility) -> list[Entry]:
    """Forces and torques on the base, unless its momentum is kept."""
    if mobility.weightless or mobility.base == "fixed":
        return []
    kinds = [("force", "xy"), ("torque", "z")] if mobility.base == "planar" else [("torque", "xyz")]
    return [{kind: {"frame": mobility.frame, "axis": axis}} for kind, axes in kinds for axis in axes]


def _rank(input_matrix: np.ndarray) -> int:
    """How many reduced forces actuators can make."""
    return int(np.linalg.matrix_rank(unit_rows(input_matrix), tol=DRIVEN)) if input_matrix.size else 0
