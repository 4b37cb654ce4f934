"""Geometry of a robot as points, to find the ground, the wheels and their radii; and tolerances for numbers of a file.

Files round to a few digits, and workshops build to a degree and a millimetre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.robots import Robot

ALIGNED = 0.0175
"""Angle [rad], or its sine, below which two directions are equal: 1 degree, e.g. toe-in or the lean of a kingpin."""
SAME = 1e-3
"""Share of a range, or of a radius, below which two values are equal; it bounds rounding, not workmanship."""
PLACED = 3e-3
"""Distance [m] below which two positions are equal, e.g. the axles of two wheels of one axle line."""
INDEPENDENT = 1e-3
"""Sine of the angle between actuators (or outputs) below which they are linearly dependent."""


def placed(length: float) -> float:
    """Return the distance [m] below which two positions on a part of this length are equal: a tenth of small parts."""
    return min(PLACED, 0.1 * length)


def first_smallest(values: Sequence[float] | np.ndarray, slack: float) -> int:
    """Return the index of the first value within ``slack`` of the smallest; rounding does not change it."""
    array = np.asarray(values)
    return int(np.flatnonzero(array <= array.min() + slack)[0])


Kind: TypeAlias = Literal["collision", "visual"]
GEOMETRY: tuple[Kind, ...] = ("collision", "visual")

LEVEL = 0.1
"""Largest vertical component of a unit axle vector."""

NEAR = 0.3
"""Largest height of a wheel's lowest point above the ground, in radii."""

_CIRCLE = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)


@dataclass(frozen=True)
class Shape:
    """One geometry object: points, and a margin around their convex hull.

    Attributes:
        joint: index of the parent joint.
        name: name of the geometry.
        points: points in the world frame (k, 3) [m].
        margin: radius around the points [m].
        axis: axis of a cylinder in the world frame (3,), else None.
        file: path of the mesh, or an empty string.
    """

    joint: int
    name: str
    points: np.ndarray
    margin: float
    axis: np.ndarray | None
    file: str

    @property
    def bottom(self) -> float:
        """Height of the lowest point [m]."""
        return float(self.points[:, 2].min() - self.margin)


def missing_meshes(robot: Robot, kind: Kind) -> dict[int, list[str]]:
    """Return the names of missing meshes of the "visual" or "collision" geometry, by index of the parent joint."""
    found: dict[int, list[str]] = {}
    try:
        missing = robot.missing_meshes(kind)
    except ModelError:
        return found
    for link, names in missing.items():
        joint = int(robot.model.frames[robot.frame_id(link)].parentJoint)
        found.setdefault(joint, []).extend(names)
    return found


def shapes(robot: Robot, kind: Kind, q: np.ndarray) -> list[Shape]:
    """Return the "visual" or "collision" geometry at a configuration (nq,); empty if files are missing."""
    try:
        geometry = robot.visual_model if kind == "visual" else robot.collision_model
    except ModelError:
        return []
    if geometry is None:
        return []
    data, placed = robot.model.createData(), geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, geometry, placed, q)
    stand_ins = robot.stand_ins if kind == "visual" else frozenset()
    found = []
    for item, placement in zip(geometry.geometryObjects, placed.oMg, strict=True):
        local = _points(item.geometry)
        if local is None or item.name in stand_ins:  # skip boxes that only stand for an inertia
            continue
        points, margin = local
        axis = placement.rotation[:, 2].copy() if type(item.geometry).__name__ == "Cylinder" else None
        world = points @ placement.rotation.T + placement.translation
        found.append(Shape(item.parentJoint, item.name, world, margin, axis, item.meshPath))
    return found


def _points(geometry: Any) -> tuple[np.ndarray, float] | None:
    kind = type(geometry).__name__
    if kind == "Sphere":
        return np.zeros((1, 3)), float(geometry.radius)
    if kind in ("Cylinder", "Cone"):
        circle = np.stack([np.cos(_CIRCLE), np.sin(_CIRCLE), np.zeros_like(_CIRCLE)], axis=1) * geometry.radius
        end = np.array([0.0, 0.0, geometry.halfLength])
        return np.concatenate([circle + end, circle - end]), 0.0
    if kind == "Capsule":
        return np.array([[0, 0, geometry.halfLength], [0, 0, -geometry.halfLength]]), float(geometry.radius)
    if kind == "Ellipsoid":
        return np.concatenate([np.diag(geometry.radii), -np.diag(geometry.radii)]), 0.0
    if kind == "Box":
        corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        return corners * geometry.halfSide, 0.0
    if hasattr(geometry, "vertices"):
        points = np.array(geometry.vertices(), dtype=float).reshape(-1, 3)
        return (points, 0.0) if len(points) and np.isfinite(points).all() else None
    return None


@dataclass(frozen=True)
class Disk:
    """Disk about an axle.

    Attributes:
        radius: radius [m].
        bottom: height of the lowest point [m].
        width: width along the axle [m].
    """

    radius: float
    bottom: float
    width: float


def fitted_disk(parts: list[Shape], center: np.ndarray, axle: np.ndarray) -> Disk | None:
    """Return the disk that shapes form about an axle near ``center``, or None if they are not round or far from it.

    Radius and roundness are those about the middle of the shapes, which files place a little beside the axle.
    """
    if not parts:
        return None
    upward = np.array([0.0, 0.0, 1.0]) - axle[2] * axle
    upward /= np.linalg.norm(upward)
    forward = np.cross(axle, upward)
    low, high = (
        np.array([reach(each, axis, center) for axis in (forward, upward, axle)])
        for reach, each in ((_low, parts), (_high, parts))
    )
    extents = high - low
    middle = (high + low)[:2] / 2
    own = center + middle[0] * forward + middle[1] * upward
    radius = max(float(np.linalg.norm(across(part.points - own, axle), axis=1).max()) + part.margin for part in parts)
    is_near = float(np.linalg.norm(middle)) < max(0.2 * radius, PLACED)
    is_round = extents[:2].min() > 0.9 * extents[:2].max() and is_near
    # A square has equal extents too, but its corners are farther away than its sides.
    if not is_round or 2 * radius > 1.1 * extents[:2].max():
        return None
    return Disk(radius, min(part.bottom for part in parts), float(extents[2]))


def across(vectors: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Component of vectors (..., 3) perpendicular to a unit axis (3,)."""
    return np.asarray(vectors - (vectors @ axis)[..., None] * axis)


def _low(parts: list[Shape], axis: np.ndarray, center: np.ndarray) -> float:
    return min(float(((part.points - center) @ axis).min()) - part.margin for part in parts)


def _high(parts: list[Shape], axis: np.ndarray, center: np.ndarray) -> float:
    return max(float(((part.points - center) @ axis).max()) + part.margin for part in parts)
