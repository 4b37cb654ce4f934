"""Convex shapes for coal: primitives as they are, and the convex hull of each mesh.

The distance between two convex shapes is signed, and its rate follows from the nearest points. A mesh of triangles has
neither: coal reports the depth of one pair of triangles where two meshes overlap. A hull contains its mesh, so that a
distance of hulls is never larger than that of the meshes.
"""

from __future__ import annotations

from functools import partial
from itertools import product

import coal
import numpy as np

from rnc_pin.errors import ModelError
from rnc_pin.robots.sources.mesh_formats import Mesh, MeshError, convex_hull

_THICKNESS = 1e-3  # thickness of the hull of a flat mesh over its extent
_LARGEST = 1e3  # [m]; no finite bounding sphere is of use beyond it
_BEYOND = 1e6  # [m]; half side of the box that stands for a half space in the broad phase
_PRIMITIVES = (coal.Box, coal.Sphere, coal.Cylinder, coal.Capsule, coal.Cone, coal.Ellipsoid, coal.Convex)


def convex_shape(shape: coal.CollisionGeometry, name: str) -> coal.CollisionGeometry:
    """Return a convex shape that contains a shape: itself if it is convex, else the hull of its vertices.

    Args:
        shape: shape of a collision model.
        name: its name, for errors.

    Raises:
        ModelError: the shape is neither convex nor a mesh, such as a plane or a height field.
    """
    if isinstance(shape, _PRIMITIVES):
        return shape
    if not isinstance(shape, coal.BVHModelBase):
        kind = type(shape).__name__
        raise ModelError(f"shape '{name}' is a {kind}: distances need a box, sphere, cylinder, capsule or mesh")
    return hull_of(np.array(shape.vertices()), name)


def hull_of(points: np.ndarray, name: str) -> coal.Convex:
    """Return the convex hull of points (n, 3) [m]. Points in a plane get a small thickness.

    coal takes at most 255 edges at a corner. Flat faces are triangulated anew if a corner has more; if that does not
    help, as at the tip of a fine cone, the box around the points takes the place of their hull.

    Raises:
        ModelError: the points have no hull.
    """
    try:
        mesh = convex_hull(points)
    except MeshError:
        points = _thickened(points)
        try:
            mesh = convex_hull(points)
        except MeshError as error:
            raise ModelError(f"mesh '{name}': {error}") from None
    corners = np.array(list(product(*zip(points.min(axis=0), points.max(axis=0), strict=True))))
    for attempt in (partial(convex_hull, points, joggled=True), partial(convex_hull, corners)):
        try:
            return _convex(mesh)
        except RuntimeError:  # too many edges at a corner
            mesh = attempt()
    return _convex(mesh)


def _convex(mesh: Mesh) -> coal.Convex:
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in mesh.vertices:
        vertices.append(vertex)
    for corners in mesh.triangles.tolist():
        triangles.append(coal.Triangle(*corners))
    return coal.Convex(vertices, triangles)


def _thickened(points: np.ndarray) -> np.ndarray:
    """Points (6n, 3), moved by a small distance along the principal axes."""
    centered = points - points.mean(axis=0)
    extent = max(float(np.ptp(points, axis=0).max(initial=0.0)), 1e-3)
    axes = np.linalg.eigh(centered.T @ centered)[1].T * (0.5 * _THICKNESS * extent)
    return np.concatenate([points + sign * axis for axis in axes for sign in (1.0, -1.0)])


def bounding_box(shape: coal.CollisionGeometry, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return centre and half sides, (3,) each [m], of the box around a shape in its own frame.

    The box of a half space ends at its surface, if its normal is an axis, and 1000 km away.

    Raises:
        ModelError: the shape is not finite.
    """
    shape.computeLocalAABB()
    low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
    if isinstance(shape, coal.Halfspace):
        low, high = np.clip(low, -_BEYOND, _BEYOND), np.clip(high, -_BEYOND, _BEYOND)
        return 0.5 * (low + high), 0.5 * (high - low)
    if not (np.abs([low, high]) < _LARGEST).all():
        raise ModelError(f"shape '{name}' extends beyond {_LARGEST:g} m: distances need a finite shape")
    return 0.5 * (low + high), 0.5 * (high - low)
