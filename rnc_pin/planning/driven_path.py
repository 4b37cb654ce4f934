"""Distances of points from a sampled path."""

from __future__ import annotations

import numpy as np
import scipy
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float


def continued_back(poses: Float[Array, "n 3"], length: float) -> Float[Array, "m 2"]:
    """Return the points of a path, extended straight back from its first pose (x, y, heading) [m], equally fine."""
    x, y, heading = poses[0]
    steps = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    back = np.linspace(length, 0.0, 2 + int(length / max(float(steps.max(initial=0.0)), 1e-3 * length)))[:-1, None]
    return np.concatenate([[x, y] - back * [np.cos(heading), np.sin(heading)], poses[:, :2]])


def path_distances(points: Float[Array, "n 2"], path: Float[Array, "m 2"]) -> Float[Array, " n"]:
    """Return the distances (n,) of points from a polyline whose segments are much shorter than its bend radii."""
    _, nearest = scipy.spatial.cKDTree(path).query(points)
    return np.minimum(*(_to_segment(points, path, np.clip(nearest + k, 0, len(path) - 2)) for k in (-1, 0)))


def _to_segment(points: Array, path: Array, index: Array) -> Array:
    begin, along = path[index], path[index + 1] - path[index]
    square = np.maximum(np.vecdot(along, along), 1e-300)
    s = np.clip(np.vecdot(points - begin, along) / square, 0.0, 1.0)
    return np.linalg.norm(points - begin - s[:, None] * along, axis=1)
