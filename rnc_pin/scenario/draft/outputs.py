"""Which of the candidates become reducing outputs, and how far their references go."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from pydantic import TypeAdapter

from rnc_pin.errors import ConfigurationError
from rnc_pin.math.linear_algebra import unit_rows
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputKind
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plain import Json
from rnc_pin.robots.robot import Robot
from rnc_pin.scenario.draft.joints import joint_limits, turns
from rnc_pin.scenario.draft.mobility import BENT, Mobility
from rnc_pin.scenario.draft.tolerances import DRIVEN, SAME
from rnc_pin.scenario.schema.outputs import OutputItem

_SLID = 0.05  # how far a slide's reference goes [m]


@dataclass
class Outputs:
    """Reducing outputs.

    Attributes:
        entries: of the scenario.
        kinds: what these stand for.
        names: of their rows, (r,).
        steps: how far the reference of each row goes, (r,) [m, rad].
    """

    entries: list[Mapping[str, Json]] = field(default_factory=list)
    kinds: list[OutputKind] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)


def candidates(mobility: Mobility, robot: Robot, start: Mapping[str, float]) -> list[tuple[Mapping[str, Json], float]]:
    """Entries, the most wanted first, and how far their references go: of the base, then joints, driven ones first."""
    used = [entry["joint"] for entry, _ in mobility.outputs if "joint" in entry]
    joints = sorted((name for name in start if name not in used), key=lambda name: name in mobility.passive)
    return [*mobility.outputs, *(({"joint": name}, _step(robot, name, start[name])) for name in joints)]


def choose(wanted: Iterable[tuple[Mapping[str, Json], float]], system: NonholonomicSystem, q: np.ndarray) -> Outputs:
    """Of the candidates in order, those that add a motion at ``q`` (nq,).

    Raises:
        ConfigurationError: they are too few.
    """
    chosen = Outputs()
    position = Kinematics(system.robot).position(q)
    rows = unit_rows(system.constraints.jacobian(position)) if system.m else np.zeros((0, system.n))
    for entry, step in wanted:
        kind: OutputKind = TypeAdapter(OutputItem).validate_python(entry)
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
            f"of {system.r} independent motions only {len(chosen.names)} were found in its joints and base"
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
    """How far a joint's reference goes: a little, and to the side where there is room."""
    low, high = joint_limits(robot, name)
    above, below = high - value, value - low  # both infinite where nothing ends
    length = min(BENT if turns(robot, name) else _SLID, 0.3 * max(above, below))
    return round(length if above >= (1 - SAME) * below else -length, 4)
