"""Reader of Wavefront OBJ: vertices and faces. Materials are in other files and are not read."""

from __future__ import annotations

from array import array
from collections.abc import Iterator

import numpy as np

from rnc_pin.robots.sources.mesh_formats.mesh import Mesh, MeshError, check_counts, checked_mesh, fans

_MAX_CHARACTERS = 1 << 16  # characters of a line
_MAX_LINES = 8_000_000


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
