"""Formats of one mesh: STL, OBJ, MSH and PLY.

STL and PLY are text or binary. An OBJ has vertices and faces; its materials are in other files and are not read. An
MSH of MuJoCo has the numbers of vertices, normals, texture coordinates and faces, then their data.
"""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from rnc_pin.robots.sources.mesh_formats.mesh import (
    Mesh,
    MeshError,
    check_counts,
    checked_mesh,
    convex_hull,
    fans,
    merged,
)

_MAX_CHARACTERS = 1 << 16  # characters of a line
_MAX_LINES = 8_000_000
_VERTEX = re.compile(rb"\bvertex\s++(\S++)\s++(\S++)\s++(\S++)", re.IGNORECASE)
_STL_HEAD = 84  # bytes before the first facet; the last four hold the number of facets
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_MSH_HEAD = 4 * 4  # bytes of the four numbers


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


def read_msh(content: bytes) -> Mesh:
    """Read an MSH file; a file without faces gives the convex hull.

    Raises:
        MeshError: the numbers in its header do not match the file size.
    """
    vertices, normals, pictures, faces = (int(each) for each in np.frombuffer(content, "<i4", 4))
    check_counts(vertices, faces)
    size = _MSH_HEAD + 4 * (3 * vertices + 3 * normals + 2 * pictures + 3 * faces)
    if normals < 0 or pictures < 0 or size != len(content):
        raise MeshError(f"MSH of {len(content):,} bytes, declared {size:,}")
    points = np.frombuffer(content, "<f4", 3 * vertices, _MSH_HEAD)
    if not faces:
        return convex_hull(points)
    return checked_mesh(points, np.frombuffer(content, "<i4", 3 * faces, size - 12 * faces))


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


_TYPES = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f", "float64": "d",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")
_MAX_BYTES = 1 << 16  # bytes of a header or a line
_MAX_ROWS = 6_000_000  # of all elements
_Row = list[Sequence[float]]  # the values of each property


class _Property(NamedTuple):
    name: str
    kind: str
    length: str | None  # type of the length of a list


class _Element(NamedTuple):
    name: str
    size: int
    properties: list[_Property]

    @property
    def names(self) -> list[str]:
        return [each.name for each in self.properties]

    @property
    def has_lists(self) -> bool:
        return any(each.length is not None for each in self.properties)


def read_ply(content: bytes) -> Mesh:
    """Read a PLY file.

    Raises:
        MeshError: the file is shorter than declared in its header, or is not well formed.
        ValueError: a word is not a number, or there are no coordinates.
    """
    return checked_mesh(*_points_and_triangles(content, *_head(content)))


def _points_and_triangles(
    content: bytes, order: str, elements: list[_Element], start: int
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and triangles (k, 3) of the elements behind a header."""
    body = _Bytes(content, start, order) if order else _Lines(content, start)
    points, corners, sizes = np.zeros((0, 3)), array("q"), array("q")
    for element in elements:
        if element.name == "vertex":
            check_counts(element.size, 0)
            points = _points(body, element)
        elif element.name == "face" and any(name in _CORNERS for name in element.names):
            check_counts(0, element.size)
            place = next(k for k, name in enumerate(element.names) if name in _CORNERS)
            for row in body.rows(element):
                corners.extend(map(int, row[place]))
                sizes.append(len(row[place]))
                check_counts(0, len(corners) - 2 * len(sizes) if len(corners) > 2 * len(sizes) else 0)
        else:
            for _ in body.rows(element):
                pass
    return points, fans(np.array(corners, dtype=np.int64), np.array(sizes, dtype=np.int64))


def ply_points(content: bytes) -> np.ndarray | None:
    """Points (n, 3) of a PLY file without faces; None if it has faces.

    Raises:
        MeshError: as ``read_ply``.
        ValueError: there are no coordinates.
    """
    order, elements, start = _head(content)
    if any(element.name == "face" and element.size for element in elements):
        return None
    if all(element.name != "vertex" for element in elements):
        raise MeshError("has no element 'vertex'")
    return _points_and_triangles(content, order, elements, start)[0]


def _head(content: bytes) -> tuple[str, list[_Element], int]:
    """Return the byte order (empty for text), the elements, and the offset of the first element."""
    end = content.find(b"end_header", 0, _MAX_BYTES)
    start = content.find(b"\n", end, end + 16) + 1
    if not content.startswith(b"ply") or end < 0 or start == 0:
        raise MeshError("has no PLY header")
    order: str | None = None
    elements: list[_Element] = []
    for line in content[:end].decode("ascii", "replace").splitlines():
        match line.split():
            case ["format", kind, _]:
                order = _ORDERS[kind]
            case ["element", name, count]:
                elements.append(_Element(name, int(count), []))
            case ["property", "list", length, kind, name]:
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[length]))
            case ["property", kind, name]:
                elements[-1].properties.append(_Property(name, _TYPES[kind], None))
    if order is None or any(element.size < 0 for element in elements):
        raise MeshError("its header has no format, or a negative count")
    rows = sum(element.size for element in elements)
    if rows > min(_MAX_ROWS, len(content)):  # also elements without properties
        raise MeshError(f"says {rows:,} elements in {len(content):,} bytes, at most {_MAX_ROWS:,}")
    return order, elements, start


def _points(body: _Bytes | _Lines, element: _Element) -> np.ndarray:
    places = [element.names.index(axis) for axis in "xyz"]
    if isinstance(body, _Bytes) and not element.has_lists:
        return body.table(element)[:, places]
    numbers = array("d")
    for row in body.rows(element):
        numbers.extend(row[place][0] for place in places)
    return np.array(numbers).reshape(-1, 3)


class _Bytes:
    """Reader of the elements of a binary file."""

    def __init__(self, content: bytes, start: int, order: str) -> None:
        self._content, self._start, self._order = content, start, order

    def rows(self, element: _Element) -> Iterator[_Row]:
        """Yield the elements of a kind."""
        if not element.has_lists:
            size = self._order + "".join(each.kind for each in element.properties)
            self._take(struct.calcsize(size) * element.size)
            return
        for _ in range(element.size):
            row: _Row = []
            for each in element.properties:
                count = 1 if each.length is None else int(self._values(each.length, 1)[0])
                if not 0 <= count <= _MAX_BYTES:
                    raise MeshError(f"a list of length {count:,}")
                row.append(self._values(each.kind, count))
            yield row

    def table(self, element: _Element) -> np.ndarray:
        """Return all elements of a kind without lists (count, properties)."""
        kind = np.dtype([(str(k), self._order + each.kind) for k, each in enumerate(element.properties)])
        start = self._take(kind.itemsize * element.size)
        table = np.frombuffer(self._content, kind, element.size, start)
        return np.stack([table[name].astype(float) for name in kind.names or ()], axis=1)

    def _values(self, kind: str, count: int) -> Sequence[float]:
        size = struct.calcsize(self._order + kind) * count
        start = self._take(size)
        return struct.unpack_from(f"{self._order}{count}{kind}", self._content, start)

    def _take(self, size: int) -> int:
        """Return the offset of the next bytes and advance by their number."""
        start = self._start
        if size > len(self._content) - start:
            raise MeshError("ends before its last element")
        self._start += size
        return start


class _Lines:
    """Reader of the elements of a text file, one per line."""

    def __init__(self, content: bytes, start: int) -> None:
        self._content, self._start = content, start

    def rows(self, element: _Element) -> Iterator[_Row]:
        """Yield the elements of a kind."""
        for _ in range(element.size if element.properties else 0):
            words = iter(self._line())
            row: _Row = []
            try:
                for each in element.properties:
                    count = 1 if each.length is None else int(next(words))
                    row.append([float(next(words)) for _ in range(count)])
            except StopIteration:
                raise MeshError(f"a line of '{element.name[:40]}' is too short") from None
            yield row

    def _line(self) -> list[bytes]:
        while self._start < len(self._content):
            end = self._content.find(b"\n", self._start)
            end = len(self._content) if end < 0 else end
            if end - self._start > _MAX_BYTES:
                raise MeshError(f"a line of more than {_MAX_BYTES:,} characters")
            line = self._content[self._start : end].split()
            self._start = end + 1
            if line:
                return line
        raise MeshError("ends before its last element")
