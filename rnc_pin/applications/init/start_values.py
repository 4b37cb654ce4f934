"""Start values of joints: within their limits, and where the loops of the file are closed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress

import numpy as np

from rnc_pin.applications.init.coupled_joints import loop_closures, uncoupled_joints
from rnc_pin.applications.init.joint_properties import joint_limits
from rnc_pin.applications.scenario.loading import constraint_of
from rnc_pin.errors import RncError
from rnc_pin.model import NonholonomicSystem
from rnc_pin.outputs import JointPosition
from rnc_pin.planning import OutputTarget, solve_ik
from rnc_pin.robots import Robot

_CLOSED = 1e-4  # largest gap of a loop that counts as rounding in the file [m or rad], as at the start of a run
_SOLVED = 1e-9  # largest gap of a configuration that is computed here
_MARGIN = 0.02  # distance from a limit, as a share of the range


def start_values(robot: Robot) -> dict[str, float]:
    """Start values of joints with one degree of freedom [rad or m].

    A joint starts at zero if this is well within its limits, else in their middle. Mimic joints take the values that
    their leaders give them. Joints of loops start at zero, or as the file draws them, or near the middle of their
    limits: at the first of these configurations that closes the loops within the limits.
    """
    start = {}
    for index, name in enumerate(robot.joint_names, start=1):
        if robot.model.joints[index].nv != 1:
            continue
        low, high = joint_limits(robot, name)
        margin = _MARGIN * (high - low) if np.isfinite(high - low) else 0.0
        inside = low + margin < 0 < high - margin or low >= high
        start[name] = 0.0 if inside else _middle(robot, name)
    start = _with_mimics(robot, start)
    with suppress(RncError):  # loops that cannot be closed are an error of the draft
        return _closed(robot, start)
    return start


def _middle(robot: Robot, name: str) -> float:
    """Middle of the limits of a joint [rad or m]; zero without two finite limits."""
    low, high = joint_limits(robot, name)
    return round((low + high) / 2, 4) if np.isfinite(high - low) else 0.0


def _with_mimics(robot: Robot, start: Mapping[str, float]) -> dict[str, float]:
    values = dict(start)
    for _ in robot.mimics:  # mimic joints can form chains
        for joint, of, multiplier, offset in robot.mimics:
            if joint in values:
                leading = values.get(of, robot.locked.get(of, 0.0))
                values[joint] = round(multiplier * leading + offset, 9) + 0.0
    return values


def _closed(robot: Robot, start: dict[str, float]) -> dict[str, float]:
    """Return start values that close the loops of the file, or the given ones if there are none.

    Raises:
        RncError: the loops are not constraints of this robot.
    """
    loops = loop_closures(robot)
    if not loops:
        return start
    loose = uncoupled_joints(start, loops, robot, start)
    coupled = [name for name in start if name not in loose]
    system = NonholonomicSystem(robot, [constraint_of(entry) for entry, _ in loops])
    for values in _guesses(robot, start, coupled):
        inside = all(low <= values[name] <= high for name in coupled for low, high in [joint_limits(robot, name)])
        if inside and np.abs(system.assembly.residual(robot.configuration(values))).max() < _CLOSED:
            return values
    targets: dict[OutputTarget, float] = {JointPosition(name): _middle(robot, name) for name in coupled}
    found = solve_ik(system.reduce(), robot.configuration(start), targets, hold=loose)
    if found.holonomic_residual > _SOLVED:
        return start
    solved = robot.joint_values(found.q)
    return {name: round(float(np.ravel(solved[name])[0]), 9) + 0.0 for name in start}


def _guesses(robot: Robot, start: Mapping[str, float], coupled: list[str]) -> Iterator[dict[str, float]]:
    for chosen in ({}, robot.references):
        yield _with_mimics(robot, {**start, **{name: chosen.get(name, 0.0) for name in coupled}})
