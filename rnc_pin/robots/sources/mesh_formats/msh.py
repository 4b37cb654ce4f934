"""Reader of MuJoCo's MSH: numbers of vertices, normals, texture coordinates and faces, then their data."""

from __future__ import annotations

import numpy as np

from rnc_pin.robots.sources.mesh_formats.mesh import Mesh, MeshError, check_counts, checked_mesh, convex_hull

_HEAD = 4 * 4


def read_msh(content: bytes) -> Mesh:
    """Read an MSH file; a file without faces gives the convex hull.

    Raises:
        MeshError: the numbers in its header do not match the file size.
    """
    vertices, normals, pictures, faces = (int(each) for each in np.frombuffer(content, "<i4", 4))
    check_counts(vertices, faces)
    size = _HEAD + 4 * (3 * vertices + 3 * normals + 2 * pictures + 3 * faces)
    if normals < 0 or pictures < 0 or size != len(content):
        raise MeshError(f"MSH of {len(content):,} bytes, declared {size:,}")
    points = np.frombuffer(content, "<f4", 3 * vertices, _HEAD)
    if not faces:
        return convex_hull(points)
    return checked_mesh(points, np.frombuffer(content, "<i4", 3 * faces, size - 12 * faces))
