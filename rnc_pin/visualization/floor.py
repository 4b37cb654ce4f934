"""Height of the drawn floor; a floating robot has none."""

from __future__ import annotations

from rnc_pin.visualization.subject import Subject
from rnc_pin.visualization.view import View


def ground_height(view: View, subject: Subject) -> float | None:
    """Height of the grid [m]; None for no grid."""
    if view.ground == "auto":
        return None if is_floating(subject) else 0.0
    return view.ground


def is_floating(subject: Subject) -> bool:
    """True if a robot floats in space: free-flyer base, no gravity, and (in a reduced model) conserved momentum."""
    model, reduced = subject.robot.model, subject.reduced
    if model.joints[1].shortname() != "JointModelFreeFlyer" or model.gravity.linear.any():
        return False
    return reduced is None or any(name.startswith("momentum(") for name in reduced.constraints.names)
