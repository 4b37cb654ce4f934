"""Readers of mesh files in pure Python. Pinocchio, coal, MuJoCo and the viewers receive only their checked results."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from pathlib import Path

from rnc_pin.errors import ModelError
from rnc_pin.io.safe_read import read_bytes
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
from rnc_pin.robots.sources.mesh_formats.ply import read_ply
from rnc_pin.robots.sources.mesh_formats.simple_formats import read_msh, read_obj, read_stl

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
"""File suffix to reader of each supported format."""

_LFS = b"version https://git-lfs"
_BROKEN = (
    *(ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError, TypeError, ValueError),
    *(SyntaxError, struct.error),  # errors of XML, and of missing bytes
)


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
    if content.startswith(_LFS):
        raise MeshError("a git-lfs pointer: git lfs pull")
    try:
        return FORMATS[ending](content)
    except MeshError:
        raise
    except ModelError as error:  # raised by the XML parser
        raise MeshError(str(error)) from None
    except _BROKEN:
        raise MeshError(f"not well-formed {ending[1:].upper()}") from None
