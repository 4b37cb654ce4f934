"""Radii of wheels beside the heights of their centres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.constraints.ground_plane import GroundPlane
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import GroundContact, Rows
from rnc_pin.robots.robot import Robot
from rnc_pin.verdict import Finding, FindingKind, Severity


@dataclass(frozen=True)
class _Wheel:
    """Wheel, ball or caster on a plane."""

    frame: str
    radius: float
    center: Array
    contact: Array
    ground: GroundPlane | None
    """Plane whose height the constraint states; None for z = 0."""
    fixed: bool
    """True if no joint changes the height of the contact point."""


def wheel_height_findings(
    reduced: ReducedModel, q: Float[Array, " nq"], ground: float | None = None
) -> tuple[Finding, ...]:
    """Compare radii of wheels, balls and casters with the heights of their centres.

    Heights are compared where the model fixes them, as on a planar base: elsewhere, a contact row keeps the height. A
    planar base without a stated ground can be drawn at any height. Then the ground is z = 0 only if it can be: a centre
    far below or above it says nothing. Wheels on curved ground, and on ground that a frame
    carries, are not compared.

    Args:
        reduced: the model.
        q: configuration at the start.
        ground: height of level ground that the constraints do not state [m]; None if it is not known.

    Returns:
        Findings of the kind ``MODEL``. A difference that rounding explains is a note: 1 % of the radius, or half its
        last digit, up to 5 %.
    """
    at = Kinematics(reduced.robot).position(np.asarray(q, dtype=float))
    blocks = [place.block for place in reduced.all_constraints.places]
    wheels = [each for block in blocks for each in _wheels(block, reduced.robot, at)]
    found = []
    equal = 1e-4  # part of a radius below which the messages print two lengths with the same digits
    for wheel in wheels:
        gap = _gap(wheel, ground)
        if abs(gap) <= equal * wheel.radius:
            continue
        side, height = "above" if gap > 0 else "below", _above(wheel.center, wheel.ground, ground)
        message = (
            f"{wheel.frame}: radius {wheel.radius:g} m, but its centre is {height:.4g} m above the ground: the contact "
            f"point is {abs(gap):.4g} m {side} the ground"
        )
        severity = _severity(wheel, abs(gap))
        found.append(Finding(FindingKind.MODEL, wheel.frame, abs(gap), "m", None, severity, message))
    return tuple(found)


def _wheels(block: Rows, robot: Robot, at: PositionKinematics) -> list[_Wheel]:
    """Wheels of one constraint on a plane in the world."""
    plane = getattr(block, "ground", None)
    if plane is not None and not isinstance(plane, GroundPlane):
        return []
    found = []
    rounding = 1e-9  # entry of a row [m/rad] below which a joint does not change the height
    for each in block.mechanisms():
        if not isinstance(each, GroundContact) or not each.radius or (plane is not None and plane.frame is not None):
            continue
        frame = at.placement(robot.frame_id(each.frame))
        lines = block.lines_of_action(at)
        assert lines is not None  # every contact has a point
        center = frame.translation + frame.rotation @ each.center
        up = np.array([0.0, 0.0, 1.0]) if plane is None else plane.axes[2]
        lift = at.jacobian(robot.frame_id(each.frame))
        rising = up @ (lift[:3] - pin.skew(lines[0][0] - frame.translation) @ lift[3:])
        fixed = bool(np.abs(rising).max() < rounding)
        stated = None if plane is None or (up[2] == 1.0 and not plane.point[2]) else plane  # z = 0 may be a default
        found.append(_Wheel(each.frame, each.radius, center, lines[0][0], stated, fixed))
    return found


def _gap(wheel: _Wheel, ground: float | None) -> float:
    """Height of the contact point above the ground [m]; 0 if it is not known, or if a row keeps it."""
    if not wheel.fixed:
        return 0.0
    nearest, farthest = 0.25, 4.0  # heights of a centre, in radii, at which z = 0 can be its ground
    if wheel.ground is None and ground is None:
        height = wheel.center[2] / wheel.radius
        if not nearest <= height <= farthest:
            return 0.0  # a base may be described at any height
    return _above(wheel.contact, wheel.ground, ground)


def _above(point: Array, plane: GroundPlane | None, ground: float | None) -> float:
    return float(point[2]) - (ground or 0.0) if plane is None else plane.height(point)


def _severity(wheel: _Wheel, difference: float) -> Severity:
    """A note if rounding explains a difference [m]."""
    digits = f"{wheel.radius:.9f}".rstrip("0").partition(".")[2]
    rounded, coarse = 0.01, 0.05  # parts of a radius that rounding explains: always, and if its last digit is as coarse
    rounding = min(0.5 * 10.0 ** -len(digits), coarse * wheel.radius)
    return Severity.NOTE if difference <= max(rounding, rounded * wheel.radius) else Severity.DEGRADES
