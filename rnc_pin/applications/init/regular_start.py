"""Start values with a nonsingular inertia matrix."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init.joint_properties import is_revolute, joint_limits
from rnc_pin.math import unit_diagonal
from rnc_pin.robots import Robot

_SINGULAR = 1e-9  # smallest eigenvalue of an inertia matrix with ones on its diagonal
_PULLED, _TURNED_ASIDE = 0.1, 0.6  # [m], [rad]
_MOVES = 3  # largest number of joints to move


def with_regular_inertia(robot: Robot, start: Mapping[str, float]) -> tuple[dict[str, float], list[str]]:
    """Move joints if the inertia matrix is singular at the start: two axes on one line, no mass between them.

    Args:
        robot: the robot.
        start: values of joints with one degree of freedom [rad or m].

    Returns:
        New values, and a line on each moved joint.
    """
    values, notes = dict(start), []
    for _ in range(_MOVES):
        if _smallest_eigenvalue(robot, values) > _SINGULAR:
            break
        moved = {name: {**values, name: _aside(robot, name, values[name])} for name in values}
        name = max(moved, key=lambda each: _smallest_eigenvalue(robot, moved[each]))
        values = moved[name]
        notes.append(f"{name} starts at {values[name]:g}: at its default value two joint axes coincide")
    return values, notes


def _smallest_eigenvalue(robot: Robot, start: Mapping[str, float]) -> float:
    """Smallest eigenvalue of the inertia matrix with ones on its diagonal."""
    M = pin.crba(robot.model, robot.model.createData(), robot.configuration(start))
    return float(np.linalg.eigvalsh(unit_diagonal(M))[0])


def _aside(robot: Robot, name: str, value: float) -> float:
    """Value of a joint near a given one, within its limits."""
    low, high = joint_limits(robot, name)
    step = min(_TURNED_ASIDE if is_revolute(robot, name) else _PULLED, (high - low) / 4)
    return round(value + (step if value + step < high else -step), 4)
