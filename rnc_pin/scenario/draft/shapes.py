"""Where a robot's geometry is, as points: enough to find its ground, its wheels and their radii."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.robots.robot import Robot

LEVEL = 0.1
"""Largest vertical part of an axle."""

NEAR = 0.3
"""How far above the ground a wheel's lowest point may be, in radii."""

_CIRCLE = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)


@dataclass(frozen=True)
class Shape:
    """One geometry: points, all of it within ``margin`` of them.

    Attributes:
        joint: index of the joint that carries it.
        name: of the geometry.
        points: in the world, (k, 3) [m].
        margin: [m].
        axis: of a cylinder, in the world (3,); else None.
        file: of its mesh, or nothing.
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


def shapes(robot: Robot, kind: str, q: np.ndarray) -> list[Shape]:
    """The geometry of a kind, "visual" or "collision", at a configuration (nq,); nothing where files are missing."""
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
        if local is None or item.name in stand_ins:  # a box as large as a wheel's inertia is no wheel
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
    """Something round about an axle.

    Attributes:
        radius: [m].
        bottom: height of its lowest point [m].
        width: along the axle [m].
    """

    radius: float
    bottom: float
    width: float


def round_about(parts: list[Shape], center: np.ndarray, axle: np.ndarray) -> Disk | None:
    """The disk that shapes make about an axle through ``center``, or None where they are not round about it."""
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
    radius = max(
        float(np.linalg.norm(across(part.points - center, axle), axis=1).max()) + part.margin for part in parts
    )
    middle = np.abs(high + low)[:2] / 2
    is_round = extents[:2].min() > 0.9 * extents[:2].max() and middle.max() < 0.1 * radius
    # The corners of a square are farther away than its sides.
    if not is_round or 2 * radius > 1.1 * extents[:2].max():
        return None
    return Disk(radius, min(part.bottom for part in parts), float(extents[2]))


def across(vectors: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """What of vectors (..., 3) is not along an axis (3,) of length one."""
    return np.asarray(vectors - (vectors @ axis)[..., None] * axis)


def _low(parts: list[Shape], axis: np.ndarray, center: np.ndarray) -> float:
    return min(float(((part.points - center) @ axis).min()) - part.margin for part in parts)


def _high(parts: list[Shape], axis: np.ndarray, center: np.ndarray) -> float:
    return max(float(((part.points - center) @ axis).max()) + part.margin for part in parts)
