"""Reader of STL, binary and text."""

from __future__ import annotations

import re
from array import array

import numpy as np

from rnc_pin.robots.sources.mesh_formats.mesh import Mesh, MeshError, check_counts, checked_mesh, merged

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD = 84  # bytes before the first facet; the last four hold the number of facets
_VERTEX = re.compile(rb"\bvertex\s++(\S++)\s++(\S++)\s++(\S++)", re.IGNORECASE)


def read_stl(content: bytes) -> Mesh:
    """Read an STL file; shared vertices of facets are merged.

    Raises:
        MeshError: the number of facets does not match the file, or the file is not well formed.
    """
    count = int.from_bytes(content[_HEAD - 4 : _HEAD], "little")
    if len(content) == _HEAD + _FACET.itemsize * count and count:
        check_counts(0, count)
        corners = np.frombuffer(content, _FACET, count, _HEAD)["corners"].reshape(-1, 3).astype(float)
    elif content.lstrip()[:5].lower() == b"solid":
        corners = _text(content)
    else:
        room = max(0, len(content) - _HEAD) // _FACET.itemsize
        raise MeshError(f"STL of {len(content):,} bytes: room for {room:,} triangles, declared {count:,}")
    points, indices = merged(corners)
    return checked_mesh(points, indices.reshape(-1, 3))


def _text(content: bytes) -> np.ndarray:
    corners = array("d")
    for match in _VERTEX.finditer(content):
        corners.extend(map(float, match.groups()))
        check_counts(0, len(corners) // 9)
    if len(corners) % 9:
        raise MeshError("a facet does not have three vertices")
    return np.frombuffer(corners, dtype=float).reshape(-1, 3)
