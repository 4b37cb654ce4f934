"""Choice of reducing outputs from candidates, and displacement of their references."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.applications.init.base_assumptions import BENT, BaseAssumptions
from rnc_pin.applications.init.joint_properties import is_revolute, joint_range
from rnc_pin.applications.init.tolerances import DRIVEN, SAME
from rnc_pin.applications.scenario.loading import output_of
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import Json
from rnc_pin.math import unit_rows
from rnc_pin.model import Kinematics, NonholonomicSystem, OutputKind
from rnc_pin.robots import Robot

_SLID = 0.05  # displacement of the reference of a prismatic joint [m]


@dataclass
class ChosenOutputs:
    """Chosen reducing outputs.

    Attributes:
        entries: entries of the scenario.
        kinds: output objects of these entries.
        names: row names (r,).
        steps: displacement of the reference of each row (r,) [m, rad].
    """

    entries: list[Mapping[str, Json]] = field(default_factory=list)
    kinds: list[OutputKind] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)


def output_candidates(
    mobility: BaseAssumptions, robot: Robot, start: Mapping[str, float]
) -> list[tuple[Mapping[str, Json], float]]:
    """Return output entries by preference with reference displacements: base, driven joints, passive joints."""
    used = [entry["joint"] for entry, _ in mobility.outputs if "joint" in entry]
    joints = sorted((name for name in start if name not in used), key=lambda name: name in mobility.passive)
    return [*mobility.outputs, *(({"joint": name}, _step(robot, name, start[name])) for name in joints)]


def select_outputs(
    wanted: Iterable[tuple[Mapping[str, Json], float]], system: NonholonomicSystem, q: np.ndarray
) -> ChosenOutputs:
    """Return the candidates, in order, whose Jacobian rows at ``q`` (nq,) are independent of the rows before them.

    Raises:
        ConfigurationError: fewer than r independent rows.
    """
    chosen = ChosenOutputs()
    position = Kinematics(system.robot).position(q)
    rows = unit_rows(system.constraints.jacobian(position)) if system.m else np.zeros((0, system.n))
    for entry, step in wanted:
        kind = output_of(entry)
        bound = kind.bind(system.robot)
        added = unit_rows(bound.jacobian(position))
        if len(chosen.names) + len(added) > system.r or not _independent(rows, added):
            continue
        rows = np.vstack([rows, added])
        chosen.entries.append(entry)
        chosen.kinds.append(kind)
        chosen.names += bound.names
        chosen.steps += [step] + [0.0] * (len(added) - 1)
    if len(chosen.names) < system.r:
        raise ConfigurationError(
            f"only {len(chosen.names)} of {system.r} independent reducing outputs were found among its joints and base"
        )
    return chosen


def _independent(rows: np.ndarray, added: np.ndarray) -> bool:
    for row in added:
        rest = row - (np.linalg.lstsq(rows.T, row, rcond=None)[0] @ rows if len(rows) else 0.0)
        if np.linalg.norm(rest) < DRIVEN:
            return False
        rows = np.vstack([rows, row])
    return True


def _step(robot: Robot, name: str, value: float) -> float:
    """Displacement of a joint's reference [rad or m]: small, toward the farther limit."""
    low, high = joint_range(robot, name)
    above, below = high - value, value - low  # both infinite without limits
    length = max(min(BENT if is_revolute(robot, name) else _SLID, 0.3 * max(above, below)), 0.0)
    return round(length if above >= (1 - SAME) * below else -length, 4)
