"""Mesh files: each is read here, by code without pointers, before Pinocchio, coal, MuJoCo or a viewer sees it."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from pathlib import Path

from rnc_pin.errors import ModelError
from rnc_pin.regular_files import read_bytes
from rnc_pin.robots.sources.mesh_formats.collada import read_collada
from rnc_pin.robots.sources.mesh_formats.gltf import read_glb, read_gltf
from rnc_pin.robots.sources.mesh_formats.mesh import (
    FARTHEST,
    Mesh,
    MeshError,
    check_thickness,
    checked_mesh,
    convex_hull,
)
from rnc_pin.robots.sources.mesh_formats.msh import read_msh
from rnc_pin.robots.sources.mesh_formats.obj import read_obj
from rnc_pin.robots.sources.mesh_formats.ply import read_ply
from rnc_pin.robots.sources.mesh_formats.stl import read_stl

__all__ = ["FARTHEST", "FORMATS", "Mesh", "MeshError", "check_thickness", "checked_mesh", "convex_hull", "read_mesh"]

FORMATS: Mapping[str, Callable[[bytes], Mesh]] = {
    ".dae": read_collada,
    ".glb": read_glb,
    ".gltf": read_gltf,
    ".msh": read_msh,
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
}
"""Endings of the formats that are read, and their readers."""

_LFS = b"version https://git-lfs"
_BROKEN = (
    *(ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError, TypeError, ValueError),
    *(SyntaxError, struct.error),  # of XML, and of bytes that are not there
)


def read_mesh(path: Path) -> Mesh:
    """Read and check a mesh file.

    Args:
        path: of the file; its ending tells the format.

    Returns:
        Vertices in the units of the file, finite and within ``FARTHEST``, and triangles whose indices are in range.

    Raises:
        MeshError: another format, a file that cannot be opened, that is too large, or that is not well formed.
    """
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise MeshError(f"format '{ending[:20]}', expected one of {', '.join(FORMATS)}")
    try:
        content = read_bytes(path)
    except (OSError, ValueError) as error:  # a zero in the name
        raise MeshError(getattr(error, "strerror", None) or "cannot be opened") from None
    if content.startswith(_LFS):
        raise MeshError("a git-lfs pointer: git lfs pull")
    try:
        return FORMATS[ending](content)
    except MeshError:
        raise
    except ModelError as error:  # of XML
        raise MeshError(str(error)) from None
    except _BROKEN:
        raise MeshError(f"not well-formed {ending[1:].upper()}") from None
