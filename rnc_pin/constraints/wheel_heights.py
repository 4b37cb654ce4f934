"""Radii of wheels beside the heights of their centres and the shapes of their links."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.constraints.ground_plane import GroundPlane
from rnc_pin.errors import ModelError
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import GroundContact, Rows
from rnc_pin.robots.robot import Robot
from rnc_pin.verdict import Finding, FindingKind, Severity

if TYPE_CHECKING:
    import coal

_ROUNDED, _COARSE = 0.01, 0.05  # shares of a radius that rounding explains: always, and if its last digit is as coarse
_EXACT = 1e-4  # share of a radius below which two lengths are equal, and printed with the same digits
_FIXED = 1e-9  # entry of a row below which a joint does not change the height of a contact
_NEAREST, _FARTHEST = 0.25, 4.0  # heights of a centre, in radii, at which z = 0 can be its ground
_ROUND, _BESIDE = 0.05, 0.02  # differences in radii up to which a mesh is round about the axle


@dataclass(frozen=True)
class _Wheel:
    """Wheel, ball or caster on a plane."""

    frame: str
    radius: float
    axle: Array | None
    """Axle in the world (3,); None for a ball."""
    center: Array
    contact: Array
    ground: GroundPlane | None
    """Plane whose height the constraint states; None for z = 0."""
    fixed: bool
    """True if no joint changes the height of the contact point."""


def wheel_height_findings(
    reduced: ReducedModel, q: Float[Array, " nq"], ground: float | None = None
) -> tuple[Finding, ...]:
    """Compare radii of wheels, balls and casters with the heights of their centres and the shapes of their links.

    Heights are compared where the model fixes them, as on a planar base: elsewhere, a contact row keeps the height. A
    planar base without a stated ground can be drawn at any height. Then the ground is z = 0 only if it can be: a wheel
    whose radius agrees with its shape may be higher or lower. Wheels on curved ground, and on ground that a frame
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
    shapes = _Shapes(reduced.robot, at.q) if wheels else None
    found = []
    for wheel in wheels:
        drawn = None if shapes is None else shapes.radius(wheel)
        difference = 0.0 if drawn is None else abs(wheel.radius - drawn)
        gap = _gap(wheel, ground, drawn is not None and _severity(wheel, difference) is Severity.NOTE)
        words = []
        if abs(gap) > _EXACT * wheel.radius:
            words.append(f"its centre is {_above(wheel.center, wheel.ground, ground):.4g} m above the ground")
        if drawn is not None and difference > _EXACT * wheel.radius:
            words.append(f"its collision shape has {drawn:.4g} m")
        if not words:
            continue
        message = f"{wheel.frame}: radius {wheel.radius:g} m, but {' and '.join(words)}"
        if abs(gap) > _EXACT * wheel.radius:
            side = "above" if gap > 0 else "below"
            message += f": the contact point is {abs(gap):.4g} m {side} the ground"
        found.append(_finding(wheel, max(abs(gap), difference), message))
    return tuple(found)


def _wheels(block: Rows, robot: Robot, at: PositionKinematics) -> list[_Wheel]:
    """Wheels of one constraint on a plane in the world."""
    plane = getattr(block, "ground", None)
    if plane is not None and not isinstance(plane, GroundPlane):
        return []
    found = []
    for each in block.mechanisms():
        if not isinstance(each, GroundContact) or not each.radius or (plane is not None and plane.frame is not None):
            continue
        frame = at.placement(robot.frame_id(each.frame))
        lines = block.lines_of_action(at)
        assert lines is not None  # every contact has a point
        axle = None if each.axle is None else frame.rotation @ each.axle
        center = frame.translation + frame.rotation @ each.center
        up = np.array([0.0, 0.0, 1.0]) if plane is None else plane.axes[2]
        lift = at.jacobian(robot.frame_id(each.frame))
        rising = up @ (lift[:3] - pin.skew(lines[0][0] - frame.translation) @ lift[3:])
        fixed = bool(np.abs(rising).max() < _FIXED)
        stated = None if plane is None or (up[2] == 1.0 and not plane.point[2]) else plane  # z = 0 may be a default
        found.append(_Wheel(each.frame, each.radius, axle, center, lines[0][0], stated, fixed))
    return found


def _gap(wheel: _Wheel, ground: float | None, is_measured: bool) -> float:
    """Height of the contact point above the ground [m]; 0 if it is not known, or if a row keeps it."""
    if not wheel.fixed:
        return 0.0
    if wheel.ground is None and ground is None:
        height = wheel.center[2] / wheel.radius
        if is_measured or not _NEAREST <= height <= _FARTHEST:
            return 0.0  # a base may be described at any height
    return _above(wheel.contact, wheel.ground, ground)


def _above(point: Array, plane: GroundPlane | None, ground: float | None) -> float:
    return float(point[2]) - (ground or 0.0) if plane is None else plane.height(point)


def _finding(wheel: _Wheel, amount: float, message: str) -> Finding:
    return Finding(FindingKind.MODEL, wheel.frame, amount, "m", None, _severity(wheel, amount), message)


def _severity(wheel: _Wheel, difference: float) -> Severity:
    """A note if rounding explains a difference [m]."""
    digits = f"{wheel.radius:.9f}".rstrip("0").partition(".")[2]
    rounding = min(0.5 * 10.0 ** -len(digits), _COARSE * wheel.radius)
    return Severity.NOTE if difference <= max(rounding, _ROUNDED * wheel.radius) else Severity.DEGRADES


class _Shapes:
    """Collision shapes of a robot at a configuration (nq,), without the shapes of links that lack a mesh.

    The other shapes of such a link, such as the hub of a wheel without its tyre, do not give its radius.
    """

    def __init__(self, robot: Robot, q: Array) -> None:
        self._robot = robot
        try:
            geometry, missing = robot.collision_model, robot.missing_meshes("collision")
        except ModelError:
            geometry, missing = None, {}
        partial = {robot.model.frames[robot.frame_id(link)].parentJoint for link in missing}
        self._objects: list[tuple[pin.GeometryObject, pin.SE3]] = []
        if geometry is not None:
            data, placed = robot.model.createData(), geometry.createData()
            pin.updateGeometryPlacements(robot.model, data, geometry, placed, q)
            pairs = zip(geometry.geometryObjects, placed.oMg, strict=True)
            self._objects = [(item, place) for item, place in pairs if item.parentJoint not in partial]

    def radius(self, wheel: _Wheel) -> float | None:
        """Largest radius of the round shapes about the wheel's centre on its link [m]; None without such shapes."""
        frame = self._robot.model.frames[self._robot.frame_id(wheel.frame)]
        if self._robot.model.joints[frame.parentJoint].nv != 1 and wheel.axle is not None:
            return None  # the link is more than a wheel
        there = [(item, place) for item, place in self._objects if item.parentJoint == frame.parentJoint]
        found = [(item.geometry, place, _radius(item.geometry, place, wheel)) for item, place in there]
        largest = max((radius for *_, radius in found if radius is not None), default=None)
        if largest is None or wheel.axle is None:
            return largest
        # Parts beyond the round ones, such as rollers on a hub, touch the ground.
        beyond = [_reach(shape, place, wheel.center, wheel.axle) for shape, place, radius in found if radius is None]
        return largest if max(beyond, default=0.0) < largest else None


def _reach(shape: coal.CollisionGeometry, placement: pin.SE3, center: Array, axle: Array) -> float:
    """Distance from the axle to the center of a shape, or to the far side of a sphere or capsule [m]."""
    thickness = float(shape.radius) if type(shape).__name__ in ("Sphere", "Capsule") else 0.0
    return float(np.linalg.norm(_across(placement.translation - center, axle))) + thickness


def _radius(shape: coal.CollisionGeometry, placement: pin.SE3, wheel: _Wheel) -> float | None:
    """Radius of a shape that is round about the wheel's axle, or None."""
    kind, near = type(shape).__name__, _BESIDE * wheel.radius
    away = placement.translation - wheel.center
    if wheel.axle is None:
        return float(shape.radius) if kind == "Sphere" and np.linalg.norm(away) < near else None
    beside = np.linalg.norm(_across(away, wheel.axle))
    if kind == "Sphere":
        return float(shape.radius) if beside < near else None
    if kind == "Cylinder":
        along = abs(float(placement.rotation[:, 2] @ wheel.axle))
        return float(shape.radius) if beside < near and along > 1.0 - _EXACT * 1e3 else None
    if not hasattr(shape, "vertices"):
        return None
    points = np.asarray(shape.vertices(), dtype=float).reshape(-1, 3)
    if not len(points):
        return None
    rim = _across(points @ placement.rotation.T + away, wheel.axle)
    radius = float(np.linalg.norm(rim, axis=1).max())
    upward = _across(np.array([0.0, 0.0, 1.0]), wheel.axle)
    size = np.linalg.norm(upward)
    if size < _ROUND:
        return None
    axes = np.stack([upward / size, np.cross(wheel.axle, upward / size)], axis=1)
    extents = np.concatenate([(rim @ axes).max(axis=0), -(rim @ axes).min(axis=0)])
    return radius if (extents > (1 - _ROUND) * radius).all() else None


def _across(vectors: Array, axis: Array) -> Array:
    """Components of vectors (..., 3) across a unit axis (3,)."""
    return np.asarray(vectors - (vectors @ axis)[..., None] * axis)
