"""GLB, glTF and PLY, which trimesh reads (extra ``meshes``), within our limits.

trimesh gets bytes and no resolver, so that it opens no file and no address. It copies what a file declares before
anything is checked, so sizes and counts are checked here first.
"""

from __future__ import annotations

import io
import json
import logging
import warnings
from collections.abc import Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from rnc_pin.extras import missing_extra
from rnc_pin.robots.sources.mesh_formats.mesh import Mesh, MeshError, check_counts, checked_mesh, scene_mesh

if TYPE_CHECKING:
    from trimesh import Scene

_JSON = 0x4E4F534A  # type of the first chunk of a GLB
_FLOAT = 5126  # component type of glTF
_MAX_PARTS = 2_000_000  # of the JSON: each part takes more memory than its text
_MAX_COPIES = 4  # bytes of all views, relative to those of the file
_MAX_COUNT = 12_000_000  # items of all accessors
_MAX_NODES = 100_000
_MAX_HEADER = 1 << 16  # bytes
_MAX_LINES = 4_000_000  # of a PLY as text, each of which trimesh makes an array
_BREAKS = (b"\n", b"\r", b"\v", b"\f", b"\x1c", b"\x1d", b"\x1e")  # where Python splits lines


def read_gltf(content: bytes) -> Mesh:
    """Read a glTF file with embedded data.

    Raises:
        MeshError: not well formed, compressed, too large, or with data in other files.
    """
    _check_installed()
    _check_document(content, len(content))
    return _mesh_of(_scene(content, "gltf"))


def read_glb(content: bytes) -> Mesh:
    """Read a GLB file. Errors are as for ``read_gltf``."""
    _check_installed()
    size, kind = (int(each) for each in np.frombuffer(content, "<u4", 2, 12))
    if kind != _JSON or size > len(content) - 20:
        raise MeshError(f"a chunk of {size:,} bytes in a file of {len(content):,}")
    _check_document(content[20 : 20 + size], len(content))
    return _mesh_of(_scene(content, "glb"))


def read_ply(content: bytes) -> Mesh:
    """Read a PLY file.

    Raises:
        MeshError: the file is shorter or longer than its header says, or not well formed.
    """
    _check_installed()
    _check_header(content)
    return _mesh_of(_scene(content, "ply"))


def read_ply_points(content: bytes) -> np.ndarray | None:
    """Points (n, 3) of a PLY file without faces; None if it has faces. Errors are as for ``read_ply``."""
    _check_installed()
    _check_header(content)
    (found,) = _scene(content, "ply").geometry.values()
    return None if len(getattr(found, "faces", ())) else np.asarray(found.vertices, dtype=float).reshape(-1, 3)


def _check_installed() -> None:
    if find_spec("trimesh") is None:
        raise MeshError(missing_extra("meshes"))


def _scene(content: bytes, kind: str) -> Scene:
    import trimesh

    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL)  # the error says it
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of numbers that are not finite, which our checks refuse
        warnings.filterwarnings("error", "string or file could not be read")  # words in place of numbers
        try:
            return trimesh.load_scene(io.BytesIO(content), file_type=kind, process=False, skip_materials=True)
        except Exception:  # any: trimesh checks little
            raise MeshError(f"not well-formed {kind.upper()}") from None
        finally:
            log.setLevel(level)


def _mesh_of(scene: Scene) -> Mesh:
    """Triangles of all nodes; points and lines have none."""
    read = {
        name: checked_mesh(found.vertices, found.faces)
        for name, found in scene.geometry.items()
        if len(getattr(found, "faces", ()))
    }
    placed = (scene.graph[node] for node in scene.graph.nodes_geometry)
    return scene_mesh((read[name], placement) for placement, name in placed if name in read)


def _check_document(text: bytes, size: int) -> None:
    """Refuse a glTF document before trimesh makes arrays of it.

    Args:
        text: the JSON.
        size: bytes of the whole file.
    """
    if sum(map(text.count, (b"[", b"{", b","))) > _MAX_PARTS:
        raise MeshError(f"JSON of more than {_MAX_PARTS:,} parts")
    document: Mapping[str, Any] = json.loads(text)
    for buffer in document.get("buffers", ()):
        uri = buffer.get("uri", "data:")
        if not uri.startswith("data:"):
            raise MeshError(f"data in another file, '{uri[:40]}', is not read: put all into one .glb")
    if len(document.get("nodes", ())) > _MAX_NODES:
        raise MeshError(f"more than {_MAX_NODES:,} nodes")
    views, accessors = document.get("bufferViews", ()), document.get("accessors", ())
    sizes = [each["byteLength"] for each in views] + [each.get("byteOffset", 0) for each in (*views, *accessors)]
    counts = [each["count"] for each in accessors] + [each.get("byteStride", 1) for each in views]
    if not all(isinstance(each, int) and each >= 0 for each in (*sizes, *counts)) or 0 in counts[len(accessors) :]:
        raise MeshError("a size is not a whole number")
    if any("sparse" in each or "bufferView" not in each for each in accessors):
        raise MeshError("an accessor that is sparse or compressed is not read")
    if sum(sizes[: len(views)]) > _MAX_COPIES * size or sum(counts[: len(accessors)]) > _MAX_COUNT:
        raise MeshError(f"declares {sum(counts[: len(accessors)]):,} items in {size:,} bytes, at most {_MAX_COUNT:,}")
    _check_primitives(document)


def _check_primitives(document: Mapping[str, Any]) -> None:
    """Refuse positions that are not floats, which trimesh does not scale, and more triangles than a mesh may have."""
    accessors, meshes = document.get("accessors", ()), document.get("meshes", ())
    triangles = []
    for mesh in meshes:
        count = 0
        for primitive in mesh["primitives"]:
            place = primitive["attributes"]["POSITION"]
            if accessors[place]["componentType"] != _FLOAT:
                raise MeshError("positions that are not floats are not read")
            count += accessors[primitive.get("indices", place)]["count"]
        triangles.append(count // 3)
    used = [node["mesh"] for node in document.get("nodes", ()) if "mesh" in node]
    check_counts(0, sum(triangles[each] for each in used))


def _check_header(content: bytes) -> None:
    """Refuse a PLY file whose header is wrong, or says more than there is."""
    end = content.find(b"end_header", 0, _MAX_HEADER)
    if not content.startswith(b"ply") or end < 0:
        raise MeshError("has no PLY header")
    lines = [line.split() for line in content[:end].decode("ascii", "replace").splitlines()]
    rows = [int(words[2]) for words in lines if words[:1] == ["element"]]
    if min(rows, default=0) < 0 or sum(rows) > len(content):
        raise MeshError(f"says {sum(rows):,} elements in {len(content):,} bytes")
    is_text = b"ascii" in content.split(b"\n", 2)[1].lower()
    if is_text and sum(rows) > content.count(b"\n", end):
        raise MeshError("ends before its last element")
    if is_text and not (content.isascii() and sum(map(content.count, _BREAKS)) <= _MAX_LINES):
        raise MeshError(f"text that is not ASCII, or has more than {_MAX_LINES:,} lines")
