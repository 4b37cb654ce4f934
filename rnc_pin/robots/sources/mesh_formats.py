"""Checked readers of mesh files, and coal shapes of the meshes for Pinocchio, the viewers and the drafts.

Pinocchio, coal, MuJoCo and the viewers receive only checked results.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.io.safe_read import read_bytes
from rnc_pin.robots.sources import mesh_readers as readers
from rnc_pin.robots.sources.mesh_readers import FARTHEST, Mesh

FORMATS: Mapping[str, Callable[[bytes], Mesh]] = {
    ".dae": readers.read_collada,
    ".glb": partial(readers.read_by_trimesh, "glb"),
    ".gltf": partial(readers.read_by_trimesh, "gltf"),
    ".obj": readers.read_obj,
    ".ply": partial(readers.read_by_trimesh, "ply"),
    ".stl": readers.read_stl,
}
"""File suffix to reader of each supported format."""


def read_mesh(path: Path) -> Mesh:
    """Read and check a mesh file.

    Args:
        path: path of the file; its suffix gives the format.

    Returns:
        Vertices in the units of the file, finite and within ``FARTHEST``, and triangles whose indices are in range.

    Raises:
        ModelError: unknown format, or a file that cannot be opened, is too large, or is not well formed.
    """
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise ModelError(f"format '{ending[:20]}', expected one of {', '.join(FORMATS)}")
    try:
        content = read_bytes(path)
    except (OSError, ValueError) as error:  # a null character in the name
        raise ModelError(getattr(error, "strerror", None) or "cannot be opened") from None
    lfs = b"version https://git-lfs"  # first bytes of a file that Git LFS has not fetched
    if content.startswith(lfs):
        raise ModelError("a git-lfs pointer: git lfs pull")
    try:
        return FORMATS[ending](content)
    except ModelError:
        raise
    except Exception:  # any: numbers, indices, and the XML parser's, by a file that is not well formed
        raise ModelError(f"not well-formed {ending[1:].upper()}") from None


MOST_TOGETHER = 3_000_000
"""Largest number of triangles of all meshes of a robot, repeated uses included."""


class MeshShapes:
    """Meshes of a geometry. Each is read once, and each scale of it is built once."""

    def __init__(self) -> None:
        self._meshes: dict[str, Mesh | ModelError] = {}
        self._shapes: dict[tuple[str, str], coal.BVHModelBase] = {}
        self._count = 0

    def put(
        self, placeholder: pin.GeometryObject, name: str, read: Callable[[], Mesh], factors: np.ndarray, file: str
    ) -> None:
        """Put a mesh in the place of another shape.

        Args:
            placeholder: shape in a geometry model, changed in place.
            name: name that the mesh has for other shapes, too.
            read: function that reads the mesh.
            factors: scale (3,).
            file: path of the file, for the viewers; empty for triangles in the description.

        Raises:
            ModelError: the file or the scale cannot be used, or the robot's meshes are too large together.
        """
        if name not in self._meshes:
            try:
                self._meshes[name] = read()
            except ModelError as error:
                # Faults are kept too: a broken file that many links use is read once.
                self._meshes[name] = error
        mesh = self._meshes[name]
        if isinstance(mesh, ModelError):
            raise mesh
        if not factors.all():
            raise ModelError(f"scale takes three numbers that are not zero, found {factors.tolist()}")
        self.count(mesh)
        key = (name, str(factors.tolist()))
        if key not in self._shapes:
            vertices, shape = scaled_vertices(mesh, factors), coal.BVHModelOBBRSS()
            shape.beginModel(len(mesh.triangles), len(vertices))
            shape.addVertices(vertices)
            shape.addTriangles(mesh.triangles.astype(np.uint64))
            shape.endModel()
            shape.computeLocalAABB()
            self._shapes[key] = shape
        placeholder.geometry, placeholder.meshPath, placeholder.meshScale = self._shapes[key], file, factors

    def count(self, mesh: Mesh) -> None:
        """Refuse a mesh that is too large together with those before; each has its own limit too.

        Args:
            mesh: checked triangles.
        """
        self._count += len(mesh.triangles)
        if self._count > MOST_TOGETHER:
            raise ModelError(f"more than {MOST_TOGETHER:,} triangles in the meshes of the robot")


def scaled_vertices(mesh: Mesh, factors: np.ndarray) -> np.ndarray:
    """Vertices (n, 3) of a mesh, scaled by factors (3,).

    Args:
        mesh: the mesh.
        factors: factors along x, y and z.

    Raises:
        ModelError: they are too far away.
    """
    with np.errstate(over="ignore", under="ignore"):
        vertices = mesh.vertices * factors
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > FARTHEST:
        raise ModelError(f"its scale puts vertices beyond {FARTHEST:g}")
    return np.asarray(vertices)
