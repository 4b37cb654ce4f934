"""Checked readers of mesh files, and coal shapes of the meshes for Pinocchio, the viewers and the drafts.

Pinocchio, coal, MuJoCo and the viewers receive only checked results.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.io.safe_read import read_bytes
from rnc_pin.robots.sources import mesh_readers as readers
from rnc_pin.robots.sources.description import read_numbers
from rnc_pin.robots.sources.mesh_readers import FARTHEST, Mesh, MeshError

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
        MeshError: unknown format, or a file that cannot be opened, is too large, or is not well formed.
    """
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise MeshError(f"format '{ending[:20]}', expected one of {', '.join(FORMATS)}")
    try:
        content = read_bytes(path)
    except (OSError, ValueError) as error:  # a null character in the name
        raise MeshError(getattr(error, "strerror", None) or "cannot be opened") from None
    lfs = b"version https://git-lfs"  # first bytes of a file that Git LFS has not fetched
    if content.startswith(lfs):
        raise MeshError("a git-lfs pointer: git lfs pull")
    broken = (
        *(ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError, TypeError, ValueError),
        SyntaxError,  # of XML
    )
    try:
        return FORMATS[ending](content)
    except MeshError:
        raise
    except ModelError as error:  # raised by the XML parser
        raise MeshError(str(error)) from None
    except broken:
        raise MeshError(f"not well-formed {ending[1:].upper()}") from None


MOST_TOGETHER = 3_000_000
"""Largest number of triangles of all meshes of a robot, repeated uses included."""


class LoadedMesh(NamedTuple):
    """Mesh of a robot.

    Attributes:
        file: path of its file; empty if the triangles are inline in the description.
        scale: scale of its vertices (3,).
        shape: shape for coal and the viewers.
    """

    file: str
    scale: np.ndarray
    shape: coal.BVHModelBase

    def replace(self, placeholder: pin.GeometryObject) -> None:
        """Put the mesh in the place of another shape.

        Args:
            placeholder: shape in a geometry model, changed in place.
        """
        placeholder.geometry, placeholder.meshPath, placeholder.meshScale = self.shape, self.file, self.scale


class MeshShapes:
    """Factory of shapes. Each file is read once, and each scale of it is built once."""

    def __init__(self) -> None:
        self._meshes: dict[Path, Mesh | MeshError] = {}
        self._shapes: dict[tuple[object, ...], coal.BVHModelBase] = {}
        self._count = 0

    def load(self, file: Path, scale: str | None) -> LoadedMesh:
        """Return the shape of a mesh file.

        Args:
            file: path of the mesh.
            scale: three factors, as text of the description.

        Raises:
            MeshError: the file or the scale cannot be used, or the robot's meshes are too large together.
        """
        if file not in self._meshes:
            try:
                self._meshes[file] = read_mesh(file)
            except MeshError as error:
                # Faults are kept too: a broken file that many links use is read once.
                self._meshes[file] = error
        mesh = self._meshes[file]
        if isinstance(mesh, MeshError):
            raise mesh
        factors = np.ones(3) if scale is None else read_numbers(scale, 3)
        if factors is None:
            raise MeshError(f"scale takes three numbers that are not zero, found '{str(scale)[:40]}'")
        return self.make(mesh, factors, str(file))

    def count(self, mesh: Mesh) -> None:
        """Refuse a mesh that is too large together with those before; each has its own limit too.

        Args:
            mesh: checked triangles.
        """
        self._count += len(mesh.triangles)
        if self._count > MOST_TOGETHER:
            raise MeshError(f"more than {MOST_TOGETHER:,} triangles in the meshes of the robot")

    def make(self, mesh: Mesh, factors: np.ndarray, file: str) -> LoadedMesh:
        """Return the shape of a mesh. Errors are as for ``load``.

        Args:
            mesh: checked triangles.
            factors: scale (3,).
            file: path of the file, for the viewers; empty for triangles in the description.
        """
        if not factors.all():
            raise MeshError(f"scale takes three numbers that are not zero, found {factors.tolist()}")
        self.count(mesh)
        # The mesh stays in this object, so the id of its vertices is not used again.
        key = (id(mesh.vertices), *factors.tolist())
        if key not in self._shapes:
            vertices, shape = scaled_vertices(mesh, factors), coal.BVHModelOBBRSS()
            shape.beginModel(len(mesh.triangles), len(vertices))
            shape.addVertices(vertices)
            shape.addTriangles(mesh.triangles.astype(np.uint64))
            shape.endModel()
            shape.computeLocalAABB()
            self._shapes[key] = shape
        return LoadedMesh(file, factors, self._shapes[key])


def scaled_vertices(mesh: Mesh, factors: np.ndarray) -> np.ndarray:
    """Vertices (n, 3) of a mesh, scaled by factors (3,).

    Args:
        mesh: the mesh.
        factors: factors along x, y and z.

    Raises:
        MeshError: they are too far away.
    """
    with np.errstate(over="ignore", under="ignore"):
        vertices = mesh.vertices * factors
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > FARTHEST:
        raise MeshError(f"its scale puts vertices beyond {FARTHEST:g}")
    return np.asarray(vertices)
