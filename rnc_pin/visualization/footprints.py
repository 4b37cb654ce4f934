"""Outlines of a robot from above at some moments of a run."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes

from rnc_pin.robots.robot import Robot
from rnc_pin.visualization import plot_style as ps
from rnc_pin.visualization.drawn_obstacles import surface_points

_MOMENTS = 5
_FACE, _EDGE = "0.55", "0.3"


def footprints(robot: Robot, q: np.ndarray) -> list[np.ndarray]:
    """Outline (n, 2) [m] of every moving part from above at a configuration (nq,): the hull of its collision shapes."""
    from scipy.spatial import ConvexHull  # the import takes 0.1 s and is seldom needed

    source = robot.collision_model
    if source is None:
        return []
    data, placed = robot.model.createData(), source.createData()
    pin.updateGeometryPlacements(robot.model, data, source, placed, q)
    parts: dict[int, list[np.ndarray]] = {}
    for shape, pose in zip(source.geometryObjects, placed.oMg, strict=True):
        points = surface_points(shape.geometry) @ pose.rotation.T + pose.translation
        parts.setdefault(int(shape.parentJoint), []).append(points[:, :2])
    hulls = [np.concatenate(points) for joint, points in parts.items() if joint]
    return [points[ConvexHull(points).vertices] for points in hulls]


def draw_footprints(axes: Axes, robot: Robot, q: np.ndarray) -> list[ps.LegendEntry]:
    """Draw the outlines at moments of a run, (N, nq), darker towards its end. Return the legend entry."""
    lines = []
    for k, index in enumerate(np.linspace(0, len(q) - 1, _MOMENTS).round().astype(int)):
        strength = 0.25 + 0.75 * k / (_MOMENTS - 1)
        for points in footprints(robot, q[index]):
            axes.fill(*points.T, color=_FACE, alpha=0.12 * strength, zorder=0.6, lw=0)
            lines += axes.plot(*np.concatenate([points, points[:1]]).T, color=_EDGE, lw=0.8, alpha=strength, zorder=0.7)
    return [ps.LegendEntry("robot", lines[-1:])] if lines else []
