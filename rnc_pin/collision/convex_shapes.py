"""Convex shapes for coal: primitives as they are, and the convex hull of each mesh.

The distance between two convex shapes is signed, and its rate follows from the nearest points. A mesh of triangles has
neither: coal reports the depth of one pair of triangles where two meshes overlap. A hull contains its mesh, so that a
distance of hulls is never larger than that of the meshes.

A joint that turns a shape of revolution about its own axis, such as a wheel, does not move it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product

import coal
import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float, Int
from rnc_pin.errors import ModelError
from rnc_pin.robots.sources.mesh_formats import Mesh, MeshError, convex_hull

_THICKNESS = 1e-3  # thickness of the hull of a flat mesh over its extent
_LARGEST = 1e3  # [m]; no finite bounding sphere is of use beyond it
_BEYOND = 1e6  # [m]; half side of the box that stands for a half space in the broad phase
_PRIMITIVES = (coal.Box, coal.Sphere, coal.Cylinder, coal.Capsule, coal.Cone, coal.Ellipsoid, coal.Convex)
_WOBBLE = 2e-6  # [m]; axes in robot files have few digits: 1.5708 for a right angle moves the rim of a wheel by 1e-6 m
_OF_REVOLUTION = (coal.Cylinder, coal.Capsule, coal.Cone)  # about the z axes of their frames
_REVOLUTE = "JointModelR"  # bounded and unbounded, along an axis of the frame or not


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


class SpinningShapes:
    """Shapes of revolution whose joint turns about their axis, and the poses that they have without this turn.

    Args:
        model: model of the robot.
        axes: axes of its joints, by ``axes_of_rotation``.
        shapes: convex shapes; only those with a carrier are looked at.
        carriers: joint that carries each of the first shapes.
        rotations, origins: poses of the shapes in their joints, (s, 3, 3) and (s, 3) [m].
        radii: radii of the spheres around the shapes [m].

    Attributes:
        shapes: indices (n,) of the shapes that spin.
        wobble: largest distance (s,) of a point of each shape from that of an exact shape of revolution [m].
    """

    def __init__(
        self,
        model: pin.Model,
        axes: Float[Array, "njoints 3"],
        shapes: Sequence[coal.CollisionGeometry],
        carriers: Int[Array, " k"],
        rotations: Float[Array, "s 3 3"],
        origins: Float[Array, "s 3"],
        radii: Float[Array, " s"],
    ) -> None:
        self.wobble = np.zeros(len(shapes))
        found = []
        for k, joint in enumerate(carriers.tolist()):
            axis = axes[joint]
            if (
                np.isnan(axis).any()
                or model.joints[joint].nv != 1
                or not isinstance(shapes[k], (coal.Sphere, *_OF_REVOLUTION))
            ):
                continue
            tilt = (
                0.0 if isinstance(shapes[k], coal.Sphere) else float(np.linalg.norm(np.cross(axis, rotations[k, :, 2])))
            )
            wobble = float(np.linalg.norm(np.cross(axis, origins[k]))) + tilt * float(radii[k])
            if wobble < _WOBBLE:
                found.append(k)
                self.wobble[k] = wobble
        self.shapes = np.array(found, dtype=int)
        joints = carriers[self.shapes]
        self._parents = np.array([model.parents[joint] for joint in joints.tolist()], dtype=int)
        placed = [model.jointPlacements[joint].rotation for joint in joints.tolist()]
        self._rotations = np.array(placed).reshape(-1, 3, 3) @ rotations[self.shapes]

    def without_spin(
        self, rotations: Float[Array, "n s 3 3"], joints: Float[Array, "n j 3 3"]
    ) -> Float[Array, "n s 3 3"]:
        """Rotations of all shapes, with those of spinning ones as if their joints stood at zero.

        Args:
            rotations: rotations of all shapes in the world.
            joints: rotations of all joints in the world.
        """
        if not len(self.shapes):
            return rotations
        still = rotations.copy()
        still[:, self.shapes] = joints[:, self._parents] @ self._rotations
        return still


def axes_of_rotation(model: pin.Model) -> Float[Array, "njoints 3"]:
    """Axis of each joint that turns about one axis, in its frame; NaN for other joints."""
    axes, q = np.full((model.njoints, 3), np.nan), pin.neutral(model)
    for k, joint in enumerate(list(model.joints)[1:], start=1):
        if joint.shortname().startswith(_REVOLUTE) and joint.nv == 1:
            data = joint.createData()
            joint.calc(data, q)
            axes[k] = np.ravel(data.S)[3:]
        elif joint.shortname() == "JointModelPlanar":
            axes[k] = [0.0, 0.0, 1.0]
    return axes
