"""Readers of scenes with placed meshes: Collada (DAE), and glTF 2.0 in one file, GLB or text with embedded data.

External files of a glTF are not read.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias, TypeVar
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


_Json: TypeAlias = Mapping[str, Any]
_Entry = TypeVar("_Entry")
_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
_JSON, _BINARY = 0x4E4F534A, 0x004E4942  # chunk types
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_MAX_PARTS = 2_000_000  # of the JSON: each part takes more memory than its text
_MAX_POINTS_RATIO = 4  # largest number of points read, relative to that of a mesh


def read_glb(content: bytes) -> Mesh:
    """Read a GLB file.

    Raises:
        MeshError: not well formed, compressed, or with data in other files.
    """
    if content[:4] != b"glTF" or int.from_bytes(content[4:8], "little") != 2:
        raise MeshError("no GLB file of version 2")
    chunks: dict[int, bytes] = {}
    start = 12
    while start + 8 <= len(content):
        size, kind = (int(each) for each in np.frombuffer(content, "<u4", 2, start))
        if size > len(content) - start - 8:
            raise MeshError(f"a chunk of {size:,} bytes in a file of {len(content):,}")
        chunks.setdefault(kind, content[start + 8 : start + 8 + size])
        start += 8 + size
    return _GltfScene(_document(chunks[_JSON]), chunks.get(_BINARY)).mesh()


def read_gltf(content: bytes) -> Mesh:
    """Read a glTF file.

    Raises:
        MeshError: not well formed, compressed, or with data in other files.
    """
    return _GltfScene(_document(content), None).mesh()


def _document(content: bytes) -> _Json:
    if sum(map(content.count, (b"[", b"{", b","))) > _MAX_PARTS:
        raise MeshError(f"JSON of more than {_MAX_PARTS:,} parts")
    return json.loads(content)


class _GltfScene:
    """Traversal of a glTF scene, node by node.

    Args:
        document: the JSON.
        binary: first buffer of a GLB file.
    """

    def __init__(self, document: _Json, binary: bytes | None) -> None:
        self._document, self._binary = document, binary
        self._buffers: dict[int, bytes] = {}
        self._meshes: dict[int, list[Mesh]] = {}
        self._nodes = self._points = 0

    def mesh(self) -> Mesh:
        """Return all triangles."""
        nodes = _item(self._document["scenes"], self._document.get("scene", 0))["nodes"]
        return scene_mesh(part for node in nodes for part in self._placed(node, np.eye(4), 0))

    def _placed(self, index: int, placement: np.ndarray, depth: int) -> Iterator[tuple[Mesh, np.ndarray]]:
        """Yield the meshes of a node and of its children with their placements (4, 4)."""
        self._nodes += 1
        if self._nodes > _MAX_NODES or depth > _MAX_DEPTH:
            raise MeshError(_TOO_MANY_NODES)
        node = _item(self._document["nodes"], index)
        placement = placement @ _gltf_transform(node)
        if "mesh" in node:
            for mesh in self._read(node["mesh"]):
                yield mesh, placement
        for child in node.get("children", ()):
            yield from self._placed(child, placement, depth + 1)

    def _read(self, index: int) -> list[Mesh]:
        """Return the triangle primitives of a mesh; each is read once."""
        if index not in self._meshes:
            triangles: dict[int, list[np.ndarray]] = {}
            for primitive in _item(self._document["meshes"], index)["primitives"]:
                mode, place = primitive.get("mode", _TRIANGLES), primitive["attributes"]["POSITION"]
                if mode in (_TRIANGLES, _STRIP, _FAN):
                    triangles.setdefault(place, []).append(_polygons(self._corners(primitive, place), mode))
            self._meshes[index] = [
                checked_mesh(self._values(place, "VEC3"), np.concatenate(parts)) for place, parts in triangles.items()
            ]
        return self._meshes[index]

    def _corners(self, primitive: _Json, place: int) -> np.ndarray:
        """Consecutive indices of points (n,)."""
        if "indices" in primitive:
            return self._values(primitive["indices"], "SCALAR").ravel().astype(np.int64)
        return np.arange(len(self._values(place, "VEC3")))

    def _values(self, index: int, kind: str) -> np.ndarray:
        """Return the numbers of an accessor (count, width)."""
        accessor = _item(self._document["accessors"], index)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise MeshError("an accessor that is sparse or compressed is not read")
        if accessor["type"] != kind:
            raise MeshError(f"an accessor of type '{str(accessor['type'])[:20]}', expected {kind}")
        count, offset = accessor["count"], accessor.get("byteOffset", 0)
        view = _item(self._document["bufferViews"], accessor["bufferView"])
        data, start, size = self._buffer(view["buffer"]), view.get("byteOffset", 0), view["byteLength"]
        item = np.dtype((_KINDS[accessor["componentType"]], (_WIDTHS[kind],)))
        bytes_each = item.base.itemsize * _WIDTHS[kind]
        stride = view.get("byteStride", bytes_each)
        if not all(isinstance(each, int) and each >= 0 for each in (count, offset, start, size, stride)):
            raise MeshError("a size is not a whole number")
        self._points += count
        check_counts(self._points // _MAX_POINTS_RATIO, 0)
        if (
            start + size > len(data)
            or stride < bytes_each
            or (count and offset + stride * (count - 1) + bytes_each > size)
        ):
            raise MeshError(f"an accessor of {count:,} items in {size:,} bytes")
        if not count:
            return np.zeros((0, _WIDTHS[kind]))
        items = np.ndarray((count, _WIDTHS[kind]), item.base, data, start + offset, (stride, item.base.itemsize))
        values = items.astype(float)
        if accessor.get("normalized") and item.base.kind != "f":
            values = np.maximum(values / np.iinfo(item.base).max, -1.0)
        return values

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = _item(self._document["buffers"], index).get("uri")
            if uri is None and index == 0 and self._binary is not None:
                self._buffers[index] = self._binary
            elif isinstance(uri, str) and uri.startswith("data:") and ";base64," in uri[:100]:
                self._buffers[index] = base64.b64decode(uri.partition(";base64,")[2], validate=True)
            else:
                raise MeshError(f"data in another file, '{str(uri)[:40]}', is not read: put all into one .glb")
        return self._buffers[index]


def _polygons(corners: np.ndarray, mode: int) -> np.ndarray:
    """Triangles (k, 3) of corner indices (n,)."""
    if mode == _TRIANGLES:
        return fans(corners, np.full(len(corners) // 3, 3))
    if mode == _FAN:
        return fans(corners, np.array([len(corners)]))
    strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    strip[1::2] = strip[1::2, ::-1]  # every second triangle has the opposite orientation
    return strip


def _item(items: Sequence[_Entry], index: int) -> _Entry:
    if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(items):
        raise MeshError("an index out of range")
    return items[index]


def _gltf_transform(node: _Json) -> np.ndarray:
    """Transform (4, 4) of a node."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=float)
    length = np.sqrt(x * x + y * y + z * z + w * w)
    matrix = np.eye(4)
    if length > 0:
        matrix[:3, :3] = pin.Quaternion(*(np.array([w, x, y, z]) / length)).toRotationMatrix()
    matrix[:3, :3] = matrix[:3, :3] * np.array(node.get("scale", (1, 1, 1)), dtype=float).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), dtype=float).reshape(3)
    return matrix
