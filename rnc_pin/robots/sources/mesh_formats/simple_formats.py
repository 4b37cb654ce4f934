"""Formats of one mesh: STL, as text or binary, and OBJ, whose materials are in other files and are not read."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator

import numpy as np

from rnc_pin.robots.sources.mesh_formats.mesh import (
    Mesh,
    MeshError,
    check_counts,
    checked_mesh,
    fans,
    merged,
)

_MAX_CHARACTERS = 1 << 16  # characters of a line
_MAX_LINES = 8_000_000
_VERTEX = re.compile(rb"\bvertex\s++(\S++)\s++(\S++)\s++(\S++)", re.IGNORECASE)
_STL_HEAD = 84  # bytes before the first facet; the last four hold the number of facets
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_obj(content: bytes) -> Mesh:
    """Read an OBJ file.

    Raises:
        MeshError: not well formed.
        ValueError: a word is not a number.
    """
    if content.count(b"\n") > _MAX_LINES:
        raise MeshError(f"more than {_MAX_LINES:,} lines")
    vertices, corners, sizes = array("d"), array("q"), array("q")
    for line in _lines(content):
        if line.startswith((b"v ", b"v\t")):
            vertices.extend(_vertex(line.split()))
            check_counts(len(vertices) // 3, 0)
        elif line.startswith((b"f ", b"f\t")):
            words = line.split()
            count = len(vertices) // 3
            for word in words[1:]:
                index = int(word.partition(b"/")[0])
                corners.append(index - 1 if index > 0 else count + index)
            sizes.append(len(words) - 1)
            check_counts(count, max(len(sizes), len(corners) - 2 * len(sizes)))
    points = np.array(vertices).reshape(-1, 3)
    return checked_mesh(points, fans(np.array(corners, dtype=np.int64), np.array(sizes, dtype=np.int64)))


def _vertex(words: list[bytes]) -> tuple[float, float, float]:
    """Return the coordinates of a vertex; a weight or colour may follow them."""
    if len(words) not in (4, 5, 7, 8):
        raise MeshError(f"a vertex of {len(words) - 1} numbers")
    x, y, z = map(float, words[1:4])
    weight = float(words[4]) if len(words) == 5 else 1.0
    return x / weight, y / weight, z / weight


def _lines(content: bytes) -> Iterator[bytes]:
    """Yield stripped lines; a line that ends in a backslash continues on the next line."""
    start, begun = 0, b""
    while start < len(content):
        end = content.find(b"\n", start)
        end = len(content) if end < 0 else end
        if end - start + len(begun) > _MAX_CHARACTERS:
            raise MeshError(f"a line of more than {_MAX_CHARACTERS:,} characters")
        line = content[start:end].strip()
        start = end + 1
        if line.endswith(b"\\"):
            begun += line[:-1] + b" "
            continue
        yield begun + line
        begun = b""
    if begun:
        yield begun


def read_stl(content: bytes) -> Mesh:
    """Read an STL file; shared vertices of facets are merged.

    Raises:
        MeshError: the number of facets does not match the file, or the file is not well formed.
    """
    count = int.from_bytes(content[_STL_HEAD - 4 : _STL_HEAD], "little")
    if len(content) == _STL_HEAD + _FACET.itemsize * count and count:
        check_counts(0, count)
        corners = np.frombuffer(content, _FACET, count, _STL_HEAD)["corners"].reshape(-1, 3).astype(float)
    elif content.lstrip()[:5].lower() == b"solid":
        corners = _text(content)
    else:
        room = max(0, len(content) - _STL_HEAD) // _FACET.itemsize
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
