"""Reader of glTF 2.0 in one file: GLB, and text with embedded data. External files are not read."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np
import pinocchio as pin

from rnc_pin.robots.sources.mesh_formats.mesh import Mesh, MeshError, SceneTriangles, check_counts, checked_mesh, fans

_Json: TypeAlias = Mapping[str, Any]
_Entry = TypeVar("_Entry")
_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
_JSON, _BINARY = 0x4E4F534A, 0x004E4942  # chunk types
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_MAX_DEPTH = 100
_MAX_NODES = 100_000
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
    return _Scene(_document(chunks[_JSON]), chunks.get(_BINARY)).mesh()


def read_gltf(content: bytes) -> Mesh:
    """Read a glTF file.

    Raises:
        MeshError: not well formed, compressed, or with data in other files.
    """
    return _Scene(_document(content), None).mesh()


def _document(content: bytes) -> _Json:
    if sum(map(content.count, (b"[", b"{", b","))) > _MAX_PARTS:
        raise MeshError(f"JSON of more than {_MAX_PARTS:,} parts")
    return json.loads(content)


class _Scene:
    """Traversal of a scene, node by node.

    Args:
        document: the JSON.
        binary: first buffer of a GLB file.
    """

    def __init__(self, document: _Json, binary: bytes | None) -> None:
        self._document, self._binary = document, binary
        self._buffers: dict[int, bytes] = {}
        self._meshes: dict[int, list[Mesh]] = {}
        self._collected = SceneTriangles()
        self._nodes = self._points = 0

    def mesh(self) -> Mesh:
        """Return all triangles."""
        for node in _item(self._document["scenes"], self._document.get("scene", 0))["nodes"]:
            self._add(node, np.eye(4), 0)
        return self._collected.mesh()

    def _add(self, index: int, placement: np.ndarray, depth: int) -> None:
        self._nodes += 1
        if self._nodes > _MAX_NODES or depth > _MAX_DEPTH:
            raise MeshError(f"nodes are more than {_MAX_DEPTH} deep, or more than {_MAX_NODES:,}")
        node = _item(self._document["nodes"], index)
        placement = placement @ _transform(node)
        if "mesh" in node:
            for mesh in self._read(node["mesh"]):
                self._collected.place(mesh, placement)
        for child in node.get("children", ()):
            self._add(child, placement, depth + 1)

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


def _transform(node: _Json) -> np.ndarray:
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
