"""Reader of Collada (DAE), a scene with placed meshes."""

from __future__ import annotations

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
    numbers,
    scene_mesh,
)

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
        self._extents: dict[ElementTree.Element, tuple[int, int]] = {}

    def mesh(self) -> Mesh:
        """Return all triangles."""
        scene = self._root.find("scene/instance_visual_scene")
        start = self._root.find("library_visual_scenes/visual_scene") if scene is None else self._named(scene, "url")
        if start is None:
            raise MeshError("has no scene")
        nodes = start.findall("node")
        visits = sum(self._extent(node, 0)[0] for node in nodes)
        if visits > _MAX_NODES:
            raise MeshError(_TOO_MANY_NODES)
        return scene_mesh(part for node in nodes for part in self._placed(node, np.eye(4)))

    def _named(self, element: ElementTree.Element, key: str) -> ElementTree.Element:
        name = element.get(key, "")
        if not name.startswith("#") or name[1:] not in self._ids:
            raise MeshError(f"<{element.tag}> names '{name[:40]}', which is not in the file")
        return self._ids[name[1:]]

    def _extent(self, node: ElementTree.Element, depth: int) -> tuple[int, int]:
        """Number and depth of the nodes that a traversal of a node visits; each node is counted once.

        Raises:
            MeshError: too deep, as nodes are that contain themselves.
        """
        if depth > _MAX_DEPTH:
            raise MeshError(_TOO_MANY_NODES)
        if node not in self._extents:
            parts = [self._extent(each, depth + 1) for each in self._nodes_of(node)]
            self._extents[node] = (
                1 + sum(visits for visits, _ in parts),
                1 + max((deep for _, deep in parts), default=0),
            )
        if depth + self._extents[node][1] - 1 > _MAX_DEPTH:
            raise MeshError(_TOO_MANY_NODES)
        return self._extents[node]

    def _nodes_of(self, node: ElementTree.Element) -> Iterator[ElementTree.Element]:
        for part in node:
            if part.tag == "instance_node":
                yield self._named(part, "url")
            elif part.tag == "node":
                yield part

    def _placed(self, node: ElementTree.Element, placement: np.ndarray) -> Iterator[tuple[Mesh, np.ndarray]]:
        """Yield the meshes of a node and of those inside with their placements (4, 4)."""
        for part in node:
            if part.tag in _TRANSFORMS:
                placement = placement @ _collada_transform(part)
        for part in node.findall("instance_geometry"):
            for mesh in self._geometry(part.get("url", ""), self._named(part, "url")):
                yield mesh, placement
        for each in self._nodes_of(node):
            yield from self._placed(each, placement)

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
