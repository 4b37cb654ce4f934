"""Triangle meshes, their checks, and the convex hull of points without triangles."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Float, Int

FARTHEST = 1e15
"""Largest coordinate of a vertex, the same as for all distances in a description."""

MOST_TRIANGLES = 1_000_000
"""Largest number of triangles of a mesh: three times as many as the largest in example-robot-data (trunk of Go1)."""


class MeshError(ValueError):
    """Error for a mesh that cannot be used; the message does not name the file."""


class Mesh(NamedTuple):
    """Triangle mesh.

    Attributes:
        vertices: vertices (n, 3), each used by a triangle.
        triangles: indices of vertices (k, 3), counterclockwise from outside.
    """

    vertices: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "k 3"]


def checked_mesh(vertices: ArrayLike, triangles: ArrayLike) -> Mesh:
    """Check triangles; remove degenerate triangles with equal vertices, and unused vertices.

    Args:
        vertices: (n, 3).
        triangles: indices of vertices (k, 3).

    Raises:
        MeshError: too many, an index out of range, a coordinate beyond ``FARTHEST`` or not finite, or no triangle left.
    """
    points, corners = np.asarray(vertices, dtype=float).reshape(-1, 3), np.asarray(triangles).reshape(-1, 3)
    check_counts(len(points), len(corners))
    if corners.size and (corners.min() < 0 or corners.max() >= len(points)):
        wrong = int(np.flatnonzero(((corners < 0) | (corners >= len(points))).any(axis=1))[0])
        raise MeshError(f"triangle {wrong} has a vertex that is not among the {len(points):,}")
    corners = corners.astype(np.int64)
    # Unused vertices are dropped first: exporters leave placeholders far away, or NaN, among them.
    used = np.zeros(len(points), dtype=bool)
    used[corners] = True
    if not np.isfinite(points[used]).all() or np.abs(points[used]).max(initial=0.0) > FARTHEST:
        raise MeshError(f"a coordinate is not finite, or beyond {FARTHEST:g}")
    # By coordinates and not by number: formats without shared vertices repeat their points.
    first, second, third = (points[corners[:, k]] for k in range(3))
    whole = (first != second).any(axis=1) & (second != third).any(axis=1) & (third != first).any(axis=1)
    corners = corners[whole]
    if not len(corners):
        raise MeshError("has no triangles")
    # Once more: removed triangles may have been the only users of a vertex.
    used[:] = False
    used[corners] = True
    return Mesh(points[used], (np.cumsum(used) - 1)[corners])


def check_counts(vertices: int, triangles: int) -> None:
    """Refuse a mesh that is too large, before memory is allocated for it.

    Args:
        vertices: number of vertices.
        triangles: number of triangles.

    Raises:
        MeshError: a negative number, or too many.
    """
    most_vertices = 3 * MOST_TRIANGLES  # three corners a triangle, all different, as an STL stores them
    if not (0 <= vertices <= most_vertices and 0 <= triangles <= MOST_TRIANGLES):
        raise MeshError(
            f"{vertices:,} vertices and {triangles:,} triangles, at most {most_vertices:,} and {MOST_TRIANGLES:,}"
        )


def scene_mesh(parts: Iterable[tuple[Mesh, np.ndarray]]) -> Mesh:
    """Join the meshes of a scene, each at its placement (4, 4).

    Args:
        parts: meshes with their placements.

    Raises:
        MeshError: there are none, or too many triangles.
    """
    vertices: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    count = faces = 0
    for mesh, placement in parts:
        triangles.append(mesh.triangles + count)
        count, faces = count + len(mesh.vertices), faces + len(mesh.triangles)
        # At each part, before its vertices are copied: instances can multiply a small file.
        check_counts(count, faces)
        vertices.append(mesh.vertices @ placement[:3, :3].T + placement[:3, 3])
    if not vertices:
        raise MeshError("has no triangles")
    return checked_mesh(np.concatenate(vertices), np.concatenate(triangles))


def merged(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the unique points (n, 3) of points (m, 3), and the indices (m,) that restore all points.

    Args:
        points: all points.
    """
    rows = np.ascontiguousarray(points + 0.0)  # -0 and 0 are the same coordinate
    # Bytes of a row as one item: numpy.unique along an axis sorts each column.
    _, first, inverse = np.unique(
        rows.view(np.dtype((np.void, rows.itemsize * 3))), return_index=True, return_inverse=True
    )
    return rows[first], inverse.ravel()


def fans(indices: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Triangles (k, 3) of polygons, given consecutively in ``indices`` with ``sizes`` corners each.

    Args:
        indices: corners of all polygons, one after the other.
        sizes: number of corners of each polygon.

    Raises:
        MeshError: the sizes do not add up, or there are too many triangles.
    """
    sizes = np.asarray(sizes, dtype=np.int64)
    if (sizes < 0).any() or (sizes > len(indices)).any() or int(sizes.sum()) != len(indices):
        raise MeshError("the sizes of its polygons do not match the number of indices")
    counts = np.maximum(sizes - 2, 0)
    check_counts(0, int(counts.sum()))
    # Without a loop over polygons: a mesh may have a million.
    start = np.repeat(np.cumsum(sizes) - sizes, counts)
    step = np.arange(len(start)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.asarray(np.stack([indices[start], indices[start + step + 1], indices[start + step + 2]], axis=1))


def numbers(text: str | bytes | None, kind: type = float) -> np.ndarray:
    """Return the numbers of a text.

    Args:
        text: numbers with blanks between them; None or empty for none.
        kind: type of the numbers.

    Raises:
        ValueError: a word is not a number.
    """
    stripped = (text or "").strip()
    if not stripped:
        return np.zeros(0, dtype=kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # NumPy before 2.4 only warns of words that are not numbers
        try:
            return np.fromstring(stripped, dtype=kind, sep=" ")
        except Warning:
            raise ValueError("not a number") from None


def convex_hull(points: ArrayLike, joggled: bool = False) -> Mesh:
    """Convex hull of points (n, 3).

    Args:
        points: the points.
        joggled: triangulate as if rounding moved each point. A flat face is then not a fan about one corner, and no
            corner of it has many edges.

    Raises:
        MeshError: too few points, or points in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError  # the import takes 0.1 s and is seldom needed

    corners = np.asarray(points, dtype=float).reshape(-1, 3)
    check_counts(len(corners), 0)
    if not np.isfinite(corners).all() or np.abs(corners).max(initial=0.0) > FARTHEST:
        raise MeshError(f"a coordinate is not finite, or beyond {FARTHEST:g}")
    check_thickness(corners)
    try:
        hull = ConvexHull(corners, qhull_options="QJ" if joggled else None)
    except QhullError:
        raise MeshError("its points have no convex hull") from None
    first, second, third = (corners[hull.simplices[:, k]] for k in range(3))
    # Qhull orders the corners of a facet in any sense; its plane points outward.
    inward = np.einsum("ki,ki->k", np.cross(second - first, third - first), hull.equations[:, :3]) < 0
    simplices = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    return checked_mesh(corners, simplices)


def check_thickness(points: np.ndarray) -> None:
    """Refuse points (n, 3) in a plane, which have no convex hull.

    Args:
        points: the points.

    Raises:
        MeshError: fewer than four points, or points too close to a plane.
    """
    if len(points) < 4:
        raise MeshError(f"a convex hull needs four points, found {len(points)}")
    spread = points - points.mean(axis=0)
    largest = np.abs(spread).max()
    if largest > 0:
        spread = spread / largest
    axes = np.linalg.eigh(spread.T @ spread)[1]
    extents = np.ptp(spread @ axes, axis=0)
    flattest = 1e-6  # least thickness of points for a hull, relative to their largest extent
    if not extents.min() > flattest * extents.max():
        raise MeshError("its points are in a plane: a convex hull needs a volume")
