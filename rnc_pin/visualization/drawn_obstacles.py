"""Obstacles in pages and in the top view."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np

from rnc_pin.collision import Obstacle
from rnc_pin.robots.sources.mesh_formats import convex_hull
from rnc_pin.visualization.drawn_state import DrawnState
from rnc_pin.visualization.elements import GREY, Element, LayerEntry
from rnc_pin.visualization.meshcat_library import mg
from rnc_pin.visualization.meshcat_scene import MeshcatScene

_ROUND = 32  # points of a circle
_OPACITY = 0.75
_PATCH, _SLAB = 10.0, 0.01  # half side and thickness of the drawn part of a half space [m]
_PALE = 0.3  # its opacity


def surface_points(shape: coal.CollisionGeometry) -> np.ndarray:
    """Points (n, 3) [m] on a convex shape, in its own frame; their hull is the shape, apart from roundness.

    Of a half space, the hull is a square slab below its surface.
    """
    if isinstance(shape, coal.Halfspace):
        normal = np.ravel(shape.n)
        across = _PATCH * np.linalg.svd(normal[None])[2][1:]
        corners = [a * across[0] + b * across[1] for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
        return np.array([(shape.d - depth) * normal + corner for depth in (0.0, _SLAB) for corner in corners])
    if isinstance(shape, coal.Convex):
        return np.array(shape.points())
    if isinstance(shape, coal.Sphere):
        return _ball(shape.radius)
    if isinstance(shape, coal.Capsule):
        ball, middle = _ball(shape.radius), np.array([0.0, 0.0, shape.halfLength])
        return np.concatenate([ball - middle, ball + middle])
    if isinstance(shape, coal.Cylinder):
        around = np.linspace(0.0, 2 * np.pi, _ROUND, endpoint=False)
        ring = np.column_stack([shape.radius * np.cos(around), shape.radius * np.sin(around), np.zeros(_ROUND)])
        middle = np.array([0.0, 0.0, shape.halfLength])
        return np.concatenate([ring - middle, ring + middle])
    shape.computeLocalAABB()
    box = shape.aabb_local  # exact for a box, and around other shapes
    return np.array(np.meshgrid(*zip(box.min_, box.max_, strict=True))).reshape(3, -1).T


def _ball(radius: float) -> np.ndarray:
    around, up = np.meshgrid(
        np.linspace(0.0, 2 * np.pi, _ROUND, endpoint=False), np.linspace(0.0, np.pi, _ROUND // 2 + 1)
    )
    points = [np.cos(around) * np.sin(up), np.sin(around) * np.sin(up), np.cos(up)]
    return radius * np.unique(np.stack(points, axis=-1).reshape(-1, 3).round(12), axis=0)


def points_at(obstacle: Obstacle, t: float) -> np.ndarray:
    """Points (n, 3) on an obstacle in the world [m] at time t [s]."""
    pose = obstacle.placement(t)
    return surface_points(obstacle.shape) @ pose.rotation.T + pose.translation


def outline(obstacle: Obstacle, t: float) -> np.ndarray:
    """Outline (n, 2) of an obstacle from above [m] at time t [s], counterclockwise."""
    from scipy.spatial import ConvexHull  # the import takes 0.1 s and is seldom needed

    points = points_at(obstacle, t)[:, :2]
    return points[ConvexHull(points).vertices]


class ObstacleElement(Element):
    """Obstacle in the scene, at rest or in motion."""

    def __init__(self, obstacle: Obstacle) -> None:
        self.entry = LayerEntry("obstacles", "obstacles", GREY, "dot")
        self._obstacle, self._node = obstacle, f"obstacles/{obstacle.name}"
        self._drawn = False

    def build(self, scene: MeshcatScene) -> None:
        opacity = _PALE if self._obstacle.unbounded else _OPACITY
        scene.mesh(self._node, _drawable(self._obstacle.shape), GREY, opacity)

    def update(self, scene: MeshcatScene, state: DrawnState) -> None:
        if self._obstacle.motion is None and self._drawn:
            return
        self._drawn = True
        scene.place(self._node, self._obstacle.placement(state.time).homogeneous)


def _drawable(shape: coal.CollisionGeometry) -> mg.Geometry:
    if isinstance(shape, coal.Box):
        return mg.Box((2.0 * np.ravel(shape.halfSide)).tolist())
    if isinstance(shape, coal.Sphere):
        return mg.Sphere(float(shape.radius))
    hull = convex_hull(surface_points(shape))
    return mg.TriangularMeshGeometry(hull.vertices, hull.triangles)


def corners_over_time(obstacles: Sequence[Obstacle], times: Sequence[float]) -> np.ndarray:
    """Points (n, 3) [m] on all bounded obstacles at some times [s], for the camera."""
    points = [points_at(obstacle, t) for obstacle in obstacles if not obstacle.unbounded for t in times]
    return np.concatenate(points) if points else np.zeros((0, 3))
