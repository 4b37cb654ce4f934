"""What a system and its reduction print: the motion that is left, rows kept and dropped with reasons, actuators."""

from __future__ import annotations

from collections.abc import Sequence

from rnc_pin.model.actuation import Actuation
from rnc_pin.model.independence import DroppedRow
from rnc_pin.model.row_stack import OutputStack, RowStack
from rnc_pin.printing import Item, Line, counted, items
from rnc_pin.robots.robot import Robot


def system_headline(kind: str, robot: Robot, constraints: RowStack) -> str:
    """How many degrees of freedom there are, and how many are left."""
    rows = counted(constraints.size, "independent row")
    return f"{kind} of '{robot.name}': {robot.nv} degrees of freedom less {rows} leave {robot.nv - constraints.size}"


def system_lines(constraints: RowStack, dropped: Sequence[DroppedRow], actuation: Actuation) -> list[Line]:
    """Rows and actuators."""
    kept = items(constraints.names, ["holonomic" if flag else "" for flag in constraints.holonomic])
    lines: list[Line] = [("rows kept", kept)]
    if dropped:
        lines.append(("rows dropped", tuple(Item(row.name, row.reason) for row in dropped)))
    return [*lines, ("actuators", items(actuation.names))]


def output_items(outputs: OutputStack) -> Sequence[Item]:
    """Names of outputs; of quasi-velocities it is said."""
    return items(outputs.names, ["quasi-velocity" if flag else "" for flag in outputs.quasi])
