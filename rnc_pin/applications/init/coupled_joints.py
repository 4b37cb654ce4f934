"""Coupling of joints by constraints: loop closures of a file, and joints without any coupling."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from rnc_pin.applications.init.base_assumptions import Entry
from rnc_pin.applications.scenario.loading import constraint_of
from rnc_pin.io import Json
from rnc_pin.model import Kinematics
from rnc_pin.robots import Robot

_COUPLED = 1e-9  # smallest entry of a constraint row that couples a joint


def loop_closures(robot: Robot) -> list[tuple[Entry, str]]:
    """Return constraints for the loops of a file, with a remark on each; a loop within one body needs none."""
    entries: list[tuple[Entry, str]] = []
    for closure in robot.closures:
        joints = {robot.model.frames[robot.frame_id(name)].parentJoint for name in closure[:2]}
        if len(joints) > 1:
            said = {key: list(value) if isinstance(value, tuple) else value for key, value in closure._asdict().items()}
            entry: dict[str, Json] = {key: value for key, value in said.items() if value != [0.0, 0.0, 0.0]}
            entries.append(({"loop_closure": entry}, "closed by an equality of the file"))
    return entries


def uncoupled_joints(
    joints: Iterable[str], constraints: Iterable[tuple[Entry, str]], robot: Robot, start: Mapping[str, float]
) -> list[str]:
    """Return the joints that no constraint couples to others; momentum conservation, which couples all, is ignored.

    Args:
        joints: joints with one degree of freedom.
        constraints: constraint entries, with a remark on each.
        robot: the robot.
        start: values of its joints with one degree of freedom.
    """
    position = Kinematics(robot).position(robot.configuration(start))
    coupled = np.zeros(robot.nv, dtype=bool)
    kept: set[object] = set()
    for entry, _ in constraints:
        if isinstance(entry, Mapping) and "momentum" in entry:
            kept.add(entry["momentum"])
            continue
        coupled |= np.abs(constraint_of(entry).bind(robot).jacobian(position)).max(axis=0, initial=0.0) > _COUPLED
    return [name for name in joints if name not in kept and not coupled[robot.velocity_indices(name)].any()]
