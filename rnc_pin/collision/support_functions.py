"""Support functions of convex shapes: how far a shape reaches along a direction."""

from __future__ import annotations

import coal
import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import ModelError

_ALONG = 1e-9  # distance of a direction from the normal of a half space that counts as rounding


def support(shape: coal.CollisionGeometry, directions: Float[Array, "k 3"]) -> Float[Array, " k"]:
    """Largest value of ``direction . x`` over the points x of a convex shape [m].

    The gap of two convex bodies along any unit direction is a lower bound of their signed distance: the gap is minus
    the supports of the first body along the direction and of the second body against it.

    Args:
        shape: box, sphere, cylinder, capsule, cone, ellipsoid, hull or half space.
        directions: unit vectors in the frame of the shape. A half space is bounded along its normal alone.

    Raises:
        ModelError: the shape is not convex.
    """
    x, y, z = directions.T
    swept = shape.getSweptSphereRadius()
    match shape:
        case coal.Box():
            found = np.abs(directions) @ np.ravel(shape.halfSide)
        case coal.Sphere():
            found = np.full(len(directions), shape.radius)
        case coal.Capsule():
            found = shape.halfLength * np.abs(z) + shape.radius
        case coal.Cylinder():
            found = shape.halfLength * np.abs(z) + shape.radius * np.hypot(x, y)
        case coal.Cone():
            found = np.maximum(shape.halfLength * z, shape.radius * np.hypot(x, y) - shape.halfLength * z)
        case coal.Ellipsoid():
            found = np.linalg.norm(directions * np.ravel(shape.radii), axis=1)
        case coal.ConvexBase():
            found = (directions @ np.array(shape.points()).T).max(axis=1)
        case coal.Halfspace():
            normal = np.ravel(shape.n)
            found = np.where(np.abs(directions - normal).max(axis=1) < _ALONG, shape.d, np.inf)
        case _:
            raise ModelError(f"a {type(shape).__name__} has no support function")
    return np.asarray(found + swept)
