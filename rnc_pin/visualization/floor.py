"""Where the floor is drawn: none under what floats."""

from __future__ import annotations

from rnc_pin.visualization.subject import Subject
from rnc_pin.visualization.view import View


def floor_of(view: View, subject: Subject) -> float | None:
    """Height of the grid [m], or None for none."""
    if view.ground == "auto":
        return None if floats(subject) else 0.0
    return view.ground


def floats(subject: Subject) -> bool:
    """Whether a robot is free in space: a base that moves in all directions, no weight, momentum that is conserved."""
    model, reduced = subject.robot.model, subject.reduced
    if model.joints[1].shortname() != "JointModelFreeFlyer" or model.gravity.linear.any():
        return False
    return reduced is None or any(name.startswith("momentum(") for name in reduced.constraints.names)
