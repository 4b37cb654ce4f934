"""Readers of mesh files: STL, OBJ and Collada (DAE). Materials are not read."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.io.safe_read import parse_tree
from rnc_pin.robots.sources.mesh_formats.mesh import (
    Mesh,
    MeshError,
    check_counts,
    checked_mesh,
    fans,
    merged,
    numbers,
    scene_mesh,
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


# ---------------------------------------------------------------------- Collada


_MAX_NODES = 100_000  # visited nodes; each instance counts
_MAX_DEPTH = 100
_TOO_MANY_NODES = f"nodes are more than {_MAX_DEPTH} deep, or more than {_MAX_NODES:,}"


def read_collada(content: bytes) -> Mesh:
    """Read a Collada file.

    Unit and up axis of a file are not applied, as in the coal loader of Pinocchio. URDF files give the ``scale`` and
    ``origin`` of their meshes.

    Raises:
        MeshError: not well formed, or too many nodes or triangles.
        ValueError: a word is not a number.
    """
    root = parse_tree(content)
    for element in root.iter():
        element.tag = element.tag.rpartition(":")[2]
    if root.tag != "COLLADA":
        raise MeshError("no Collada file")
    return _ColladaScene(root).mesh()


class _ColladaScene:
    """Traversal of a Collada scene, node by node.

    Args:
        root: root element with tags without namespace.
    """

    def __init__(self, root: ElementTree.Element) -> None:
        self._root = root
        self._ids = {str(each.get("id")): each for each in root.iter() if each.get("id")}
        self._geometries: dict[str, list[Mesh]] = {}
        self._numbers: dict[int, np.ndarray] = {}
        self._read = 0  # number of points read
        self._visited = 0  # number of nodes

    def mesh(self) -> Mesh:
        """Return all triangles."""
        scene = self._root.find("scene/instance_visual_scene")
        start = self._root.find("library_visual_scenes/visual_scene") if scene is None else self._named(scene, "url")
        if start is None:
            raise MeshError("has no scene")
        return scene_mesh(part for node in start.findall("node") for part in self._placed(node, np.eye(4), 0))

    def _named(self, element: ElementTree.Element, key: str) -> ElementTree.Element:
        name = element.get(key, "")
        if not name.startswith("#") or name[1:] not in self._ids:
            raise MeshError(f"<{element.tag}> names '{name[:40]}', which is not in the file")
        return self._ids[name[1:]]

    def _nodes_of(self, node: ElementTree.Element) -> Iterator[ElementTree.Element]:
        for part in node:
            if part.tag == "instance_node":
                yield self._named(part, "url")
            elif part.tag == "node":
                yield part

    def _placed(
        self, node: ElementTree.Element, placement: np.ndarray, depth: int
    ) -> Iterator[tuple[Mesh, np.ndarray]]:
        """Yield the meshes of a node and of those inside with their placements (4, 4).

        Raises:
            MeshError: too many nodes, or too deep, as nodes are that contain themselves.
        """
        self._visited += 1
        if self._visited > _MAX_NODES or depth > _MAX_DEPTH:
            raise MeshError(_TOO_MANY_NODES)
        for part in node:
            if part.tag in _TRANSFORMS:
                placement = placement @ _collada_transform(part)
        for part in node.findall("instance_geometry"):
            for mesh in self._geometry(part.get("url", ""), self._named(part, "url")):
                yield mesh, placement
        for each in self._nodes_of(node):
            yield from self._placed(each, placement, depth + 1)

    def _geometry(self, name: str, geometry: ElementTree.Element) -> list[Mesh]:
        """Return the meshes of a geometry; each is read once."""
        if name not in self._geometries:
            triangles: dict[ElementTree.Element, list[np.ndarray]] = {}
            for primitive in (each for mesh in geometry.findall("mesh") for each in mesh if each.tag in _POLYGONS):
                corners = _primitive(primitive)
                if len(corners):
                    vertices = self._named(_input(primitive, "VERTEX"), "source")
                    source = self._named(_input(vertices, "POSITION"), "source")
                    triangles.setdefault(source, []).append(corners)
            self._geometries[name] = [
                checked_mesh(self._points(source), np.concatenate(corners)) for source, corners in triangles.items()
            ]
        return self._geometries[name]

    def _points(self, source: ElementTree.Element) -> np.ndarray:
        """Return the positions (n, 3) of a source."""
        accessor = source.find("technique_common/accessor")
        if accessor is None:
            raise MeshError("a source has no accessor")
        stored = self._named(accessor, "source")
        if id(stored) not in self._numbers:
            self._numbers[id(stored)] = numbers(stored.text)
        values = self._numbers[id(stored)]
        count, stride, offset = (
            int(accessor.get(key, default)) for key, default in (("count", ""), ("stride", "1"), ("offset", "0"))
        )
        check_counts(count, 0)
        self._read += count
        check_counts(self._read, 0)
        if stride < 3 or offset < 0 or count < 1 or offset + stride * (count - 1) + 3 > len(values):
            raise MeshError(f"an accessor of {count:,} points in {len(values):,} numbers")
        starts = offset + stride * np.arange(count)
        return np.asarray(values[starts[:, None] + np.arange(3)])


_TRANSFORMS = ("matrix", "translate", "scale", "rotate", "lookat", "skew")
_POLYGONS = ("triangles", "polylist", "polygons", "trifans")


def _input(element: ElementTree.Element, semantic: str) -> ElementTree.Element:
    found = next((each for each in element.findall("input") if each.get("semantic") == semantic), None)
    if found is None:
        raise MeshError(f"<{element.tag}> has no {semantic}")
    return found


def _collada_transform(part: ElementTree.Element) -> np.ndarray:
    """Transform (4, 4) of a part of a node."""
    matrix = np.eye(4)
    if part.tag == "matrix":
        matrix = numbers(part.text).reshape(4, 4)
    elif part.tag == "translate":
        matrix[:3, 3] = numbers(part.text).reshape(3)
    elif part.tag == "scale":
        matrix[:3, :3] = np.diag(numbers(part.text).reshape(3))
    elif part.tag == "rotate":
        *axis, angle = numbers(part.text).reshape(4)
        length = np.linalg.norm(axis)
        if length > 0:
            matrix[:3, :3] = pin.AngleAxis(np.deg2rad(angle), np.array(axis) / length).toRotationMatrix()
    else:
        raise MeshError(f"<{part.tag}> is not read")
    return matrix


def _primitive(primitive: ElementTree.Element) -> np.ndarray:
    """Indices of positions (k, 3)."""
    inputs = [int(each.get("offset", "0")) for each in primitive.findall("input")]
    place, width = int(_input(primitive, "VERTEX").get("offset", "0")), max(inputs) + 1
    if min(inputs) < 0 or width > 64:
        raise MeshError("an input has no offset")
    lists = [numbers(each.text, np.int64) for each in primitive.findall("p")]
    if any(len(each) % width for each in lists):
        raise MeshError(f"indices of <{primitive.tag}> are not in groups of {width}")
    corners = [each[place::width] for each in lists]
    together = np.concatenate(corners) if corners else np.zeros(0, dtype=np.int64)
    if primitive.tag == "polylist":
        counts = primitive.find("vcount")
        return fans(together, numbers(None if counts is None else counts.text, np.int64))
    if primitive.tag == "triangles":
        return fans(together, np.full(len(together) // 3, 3))
    return fans(together, np.array([len(each) for each in corners], dtype=np.int64))
