"""Printed summary of a system or reduced model: degrees of freedom, kept and dropped rows with reasons, actuators."""

from __future__ import annotations

from collections.abc import Sequence

from rnc_pin.model.actuation import Actuation
from rnc_pin.model.independence import DroppedRow
from rnc_pin.model.passive_forces import PassiveForces
from rnc_pin.model.row_stack import OutputStack, RowStack
from rnc_pin.printing import Item, Line, counted, items
from rnc_pin.robots.robot import Robot


def system_headline(kind: str, robot: Robot, constraints: RowStack) -> str:
    """Headline with the degrees of freedom before and after the constraints."""
    rows = counted(constraints.size, "independent row")
    return f"{kind} of '{robot.name}': {robot.nv} degrees of freedom less {rows} leave {robot.nv - constraints.size}"


def system_lines(
    constraints: RowStack, dropped: Sequence[DroppedRow], actuation: Actuation, forces: PassiveForces
) -> list[Line]:
    """Lines with the kept rows, the dropped rows, the actuators and the passive forces."""
    kept = items(constraints.names, ["holonomic" if flag else "" for flag in constraints.holonomic])
    lines: list[Line] = [("rows kept", kept)]
    if dropped:
        lines.append(("rows dropped", tuple(Item(row.name, row.reason) for row in dropped)))
    lines.append(("actuators", items(actuation.names)))
    return [*lines, ("forces", items(forces.names))] if forces else lines


def output_items(outputs: OutputStack) -> Sequence[Item]:
    """Names of outputs; quasi-velocities are marked."""
    return items(outputs.names, ["quasi-velocity" if flag else "" for flag in outputs.quasi])
