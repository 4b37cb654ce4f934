"""Readers of mesh files: STL, OBJ and Collada (DAE), and GLB, glTF and PLY by trimesh (extra ``meshes``).

Materials are not read. trimesh gets bytes and no resolver, so that it opens no file and no address. It copies what a
file declares before anything is checked, so sizes and counts are checked here first.
"""

from __future__ import annotations

import io
import json
import logging
import re
import warnings
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Float, Int
from rnc_pin.errors import ModelError, missing_extra
from rnc_pin.io.safe_read import parse_tree

FARTHEST = 1e15
"""Largest coordinate of a vertex, the same as for all distances in a description."""

MOST_TRIANGLES = 1_000_000
"""Largest number of triangles of a mesh: three times as many as the largest in example-robot-data (trunk of Go1)."""


class Mesh(NamedTuple):
    """Triangle mesh.

    Attributes:
        vertices: vertices (n, 3), each used by a triangle.
        triangles: indices of vertices (k, 3), counterclockwise from outside.
    """

    vertices: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "k 3"]


def checked_mesh(vertices: ArrayLike, triangles: ArrayLike) -> Mesh:
    """Check triangles; remove degenerate triangles with equal vertices, and unused vertices.

    Args:
        vertices: (n, 3).
        triangles: indices of vertices (k, 3).

    Raises:
        ModelError: too many, an index out of range, a coordinate not finite or beyond ``FARTHEST``, or no triangles.
    """
    points, corners = np.asarray(vertices, dtype=float).reshape(-1, 3), np.asarray(triangles).reshape(-1, 3)
    check_counts(len(points), len(corners))
    if corners.size and (corners.min() < 0 or corners.max() >= len(points)):
        wrong = int(np.flatnonzero(((corners < 0) | (corners >= len(points))).any(axis=1))[0])
        raise ModelError(f"triangle {wrong} has a vertex that is not among the {len(points):,}")
    corners = corners.astype(np.int64)
    # Unused vertices are dropped first: exporters leave placeholders far away, or NaN, among them.
    used = np.zeros(len(points), dtype=bool)
    used[corners] = True
    if not np.isfinite(points[used]).all() or np.abs(points[used]).max(initial=0.0) > FARTHEST:
        raise ModelError(f"a coordinate is not finite, or beyond {FARTHEST:g}")
    # By coordinates and not by number: formats without shared vertices repeat their points.
    first, second, third = (points[corners[:, k]] for k in range(3))
    whole = (first != second).any(axis=1) & (second != third).any(axis=1) & (third != first).any(axis=1)
    corners = corners[whole]
    if not len(corners):
        raise ModelError("has no triangles")
    # Once more: removed triangles may have been the only users of a vertex.
    used[:] = False
    used[corners] = True
    return Mesh(points[used], (np.cumsum(used) - 1)[corners])


def check_counts(vertices: int, triangles: int) -> None:
    """Refuse a mesh that is too large, before memory is allocated for it.

    Args:
        vertices: number of vertices.
        triangles: number of triangles.

    Raises:
        ModelError: a negative number, or too many.
    """
    most_vertices = 3 * MOST_TRIANGLES  # three corners a triangle, all different, as an STL stores them
    if not (0 <= vertices <= most_vertices and 0 <= triangles <= MOST_TRIANGLES):
        raise ModelError(
            f"{vertices:,} vertices and {triangles:,} triangles, at most {most_vertices:,} and {MOST_TRIANGLES:,}"
        )


def scene_mesh(parts: Iterable[tuple[Mesh, np.ndarray]]) -> Mesh:
    """Join the meshes of a scene, each at its placement (4, 4).

    Args:
        parts: meshes with their placements.

    Raises:
        ModelError: there are none, or too many triangles.
    """
    vertices: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    count = faces = 0
    for mesh, placement in parts:
        triangles.append(mesh.triangles + count)
        count, faces = count + len(mesh.vertices), faces + len(mesh.triangles)
        # At each part, before its vertices are copied: instances can multiply a small file.
        check_counts(count, faces)
        vertices.append(mesh.vertices @ placement[:3, :3].T + placement[:3, 3])
    if not vertices:
        raise ModelError("has no triangles")
    return checked_mesh(np.concatenate(vertices), np.concatenate(triangles))


def merged(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the unique points (n, 3) of points (m, 3), and the indices (m,) that restore all points.

    Args:
        points: all points.
    """
    rows = np.ascontiguousarray(points + 0.0)  # -0 and 0 are the same coordinate
    # Bytes of a row as one item: numpy.unique along an axis sorts each column.
    whole = rows.view(np.dtype((np.void, rows.itemsize * 3)))
    _, first, inverse = np.unique(whole, return_index=True, return_inverse=True)
    return rows[first], inverse.ravel()


def fans(indices: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Triangles (k, 3) of polygons, given consecutively in ``indices`` with ``sizes`` corners each.

    Args:
        indices: corners of all polygons, one after the other.
        sizes: number of corners of each polygon.

    Raises:
        ModelError: the sizes do not add up, or there are too many triangles.
    """
    sizes = np.asarray(sizes, dtype=np.int64)
    if (sizes < 0).any() or (sizes > len(indices)).any() or int(sizes.sum()) != len(indices):
        raise ModelError("the sizes of its polygons do not match the number of indices")
    counts = np.maximum(sizes - 2, 0)
    check_counts(0, int(counts.sum()))
    # Without a loop over polygons: a mesh may have a million.
    start = np.repeat(np.cumsum(sizes) - sizes, counts)
    step = np.arange(len(start)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.asarray(np.stack([indices[start], indices[start + step + 1], indices[start + step + 2]], axis=1))


def numbers(text: str | bytes | None, kind: type = float) -> np.ndarray:
    """Return the numbers of a text.

    Args:
        text: numbers with blanks between them; None or empty for none.
        kind: type of the numbers.

    Raises:
        ValueError: a word is not a number.
    """
    stripped = (text or "").strip()
    if not stripped:
        return np.zeros(0, dtype=kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # NumPy before 2.4 only warns of words that are not numbers
        try:
            return np.fromstring(stripped, dtype=kind, sep=" ")
        except Warning:
            raise ValueError("not a number") from None


def convex_hull(points: ArrayLike, joggled: bool = False) -> Mesh:
    """Convex hull of points (n, 3).

    Args:
        points: the points.
        joggled: triangulate as if rounding moved each point. A flat face is then not a fan about one corner, and no
            corner of it has many edges.

    Raises:
        ModelError: too few points, or points in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError  # the import takes 0.1 s and is seldom needed

    corners = np.asarray(points, dtype=float).reshape(-1, 3)
    check_counts(len(corners), 0)
    if not np.isfinite(corners).all() or np.abs(corners).max(initial=0.0) > FARTHEST:
        raise ModelError(f"a coordinate is not finite, or beyond {FARTHEST:g}")
    if len(corners) < 4:
        raise ModelError(f"a convex hull needs four points, found {len(corners)}")
    if is_flat(corners):
        raise ModelError("its points are in a plane: a convex hull needs a volume")
    try:
        hull = ConvexHull(corners, qhull_options="QJ" if joggled else None)
    except QhullError:
        raise ModelError("its points have no convex hull") from None
    first, second, third = (corners[hull.simplices[:, k]] for k in range(3))
    # Qhull orders the corners of a facet in any sense; its plane points outward.
    inward = np.einsum("ki,ki->k", np.cross(second - first, third - first), hull.equations[:, :3]) < 0
    return checked_mesh(corners, np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices))


def is_flat(points: np.ndarray) -> bool:
    """True if points (n, 3) are in a plane, or too close to one for a convex hull.

    Args:
        points: the points.
    """
    if len(points) < 4:
        return True
    spread = points - points.mean(axis=0)
    largest = np.abs(spread).max()
    if largest > 0:
        spread = spread / largest
    extents = np.ptp(spread @ np.linalg.eigh(spread.T @ spread)[1], axis=0)
    flattest = 1e-6  # least thickness of points for a hull, relative to their largest extent
    return not extents.min() > flattest * extents.max()


# ---------------------------------------------------------------------- readers


_VERTEX = re.compile(rb"\bvertex\s++(\S++)\s++(\S++)\s++(\S++)", re.IGNORECASE)
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_obj(content: bytes) -> Mesh:
    """Read an OBJ file.

    Args:
        content: content of the file.

    Raises:
        ModelError: not well formed.
        ValueError: a word is not a number.
    """
    most_lines, most_characters = 8_000_000, 1 << 16  # of a line: a face of thousands of corners fits
    # Counted at once: a loop in Python takes long, also over lines that it ignores.
    if content.count(b"\n") > most_lines:
        raise ModelError(f"more than {most_lines:,} lines")
    vertices, corners, sizes = array("d"), array("q"), array("q")
    # A limit for each line: its words take more memory than the file.
    for line in iter(partial(io.BytesIO(content).readline, most_characters), b""):
        words = line.split()
        if len(line) == most_characters:
            raise ModelError(f"a line of more than {most_characters:,} characters")
        if words and words[-1] == b"\\":
            raise ModelError("a line that continues on the next one is not read")
        if words[:1] == [b"v"]:
            vertices.extend(_vertex(words))
            check_counts(len(vertices) // 3, 0)
        elif words[:1] == [b"f"]:
            count = len(vertices) // 3
            for word in words[1:]:
                index = int(word.partition(b"/")[0])
                # OBJ counts from one, and negative indices from the last vertex so far.
                corners.append(index - 1 if index > 0 else count + index)
            sizes.append(len(words) - 1)
            # A polygon of k corners becomes k - 2 triangles; checked on the way, before lists fill the memory.
            check_counts(count, max(len(sizes), len(corners) - 2 * len(sizes)))
    points = np.array(vertices).reshape(-1, 3)
    return checked_mesh(points, fans(np.array(corners, dtype=np.int64), np.array(sizes, dtype=np.int64)))


def _vertex(words: list[bytes]) -> tuple[float, float, float]:
    """Return the coordinates of a vertex; a weight or colour may follow them."""
    if len(words) not in (4, 5, 7, 8):
        raise ModelError(f"a vertex of {len(words) - 1} numbers")
    x, y, z = map(float, words[1:4])
    weight = float(words[4]) if len(words) == 5 else 1.0
    return x / weight, y / weight, z / weight


def read_stl(content: bytes) -> Mesh:
    """Read an STL file; shared vertices of facets are merged.

    Args:
        content: content of the file.

    Raises:
        ModelError: the number of facets does not match the file, or the file is not well formed.
    """
    head = 84  # bytes before the first facet; the last four hold the number of facets
    count = int.from_bytes(content[head - 4 : head], "little")
    # The size decides: some binary files begin with the word "solid" too.
    if len(content) == head + _FACET.itemsize * count and count:
        check_counts(0, count)
        corners = np.frombuffer(content, _FACET, count, head)["corners"].reshape(-1, 3).astype(float)
    elif content.lstrip()[:5].lower() == b"solid":
        ends = array("d")
        for match in _VERTEX.finditer(content):
            ends.extend(map(float, match.groups()))
            check_counts(0, len(ends) // 9)
        if len(ends) % 9:
            raise ModelError("a facet does not have three vertices")
        corners = np.frombuffer(ends, dtype=float).reshape(-1, 3)
    else:
        room = max(0, len(content) - head) // _FACET.itemsize
        raise ModelError(f"STL of {len(content):,} bytes: room for {room:,} triangles, declared {count:,}")
    points, indices = merged(corners)
    return checked_mesh(points, indices.reshape(-1, 3))


# ---------------------------------------------------------------------- Collada


_MAX_NODES = 100_000  # visited nodes; each instance counts
_MAX_DEPTH = 100  # Python's own limit of nested calls is 1000


def read_collada(content: bytes) -> Mesh:
    """Read a Collada file.

    Unit and up axis of a file are not applied, as in the coal loader of Pinocchio. URDF files give the ``scale`` and
    ``origin`` of their meshes.

    Args:
        content: content of the file.

    Raises:
        ModelError: not well formed, or too many nodes or triangles.
        ValueError: a word is not a number.
    """
    root = parse_tree(content)
    for element in root.iter():
        element.tag = element.tag.rpartition(":")[2]
    if root.tag != "COLLADA":
        raise ModelError("no Collada file")
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
            raise ModelError("has no scene")
        return scene_mesh(part for node in start.findall("node") for part in self._placed(node, np.eye(4), 0))

    def _named(self, element: ElementTree.Element, key: str) -> ElementTree.Element:
        name = element.get(key, "")
        if not name.startswith("#") or name[1:] not in self._ids:
            raise ModelError(f"<{element.tag}> names '{name[:40]}', which is not in the file")
        return self._ids[name[1:]]

    def _placed(
        self, node: ElementTree.Element, placement: np.ndarray, depth: int
    ) -> Iterator[tuple[Mesh, np.ndarray]]:
        """Yield the meshes of a node and of nodes inside with their placements (4, 4).

        Raises:
            ModelError: too many nodes, or too deep, as nodes are that contain themselves.
        """
        # Nodes can be instances of nodes, which double from level to level or never end.
        self._visited += 1
        if self._visited > _MAX_NODES or depth > _MAX_DEPTH:
            raise ModelError(f"nodes are more than {_MAX_DEPTH} deep, or more than {_MAX_NODES:,}")
        transforms = ("matrix", "translate", "scale", "rotate", "lookat", "skew")
        for part in node:
            if part.tag in transforms:
                placement = placement @ _collada_transform(part)
        for part in node.findall("instance_geometry"):
            for mesh in self._geometry(part.get("url", ""), self._named(part, "url")):
                yield mesh, placement
        for part in node:
            if part.tag in ("node", "instance_node"):
                inside = part if part.tag == "node" else self._named(part, "url")
                yield from self._placed(inside, placement, depth + 1)

    def _geometry(self, name: str, geometry: ElementTree.Element) -> list[Mesh]:
        """Return the meshes of a geometry; each is read once."""
        polygons = ("triangles", "polylist", "polygons", "trifans")
        if name not in self._geometries:
            triangles: dict[ElementTree.Element, list[np.ndarray]] = {}
            for primitive in (each for mesh in geometry.findall("mesh") for each in mesh if each.tag in polygons):
                corners = _primitive(primitive)
                if len(corners):
                    vertices = self._named(_input(primitive, "VERTEX"), "source")
                    source = self._named(_input(vertices, "POSITION"), "source")
                    # By source of points: primitives that share one become one mesh, so that its points are read once.
                    triangles.setdefault(source, []).append(corners)
            self._geometries[name] = [
                checked_mesh(self._points(source), np.concatenate(corners)) for source, corners in triangles.items()
            ]
        return self._geometries[name]

    def _points(self, source: ElementTree.Element) -> np.ndarray:
        """Return the positions (n, 3) of a source."""
        accessor = source.find("technique_common/accessor")
        if accessor is None:
            raise ModelError("a source has no accessor")
        stored = self._named(accessor, "source")
        # Text is parsed once: accessors of several sources may share one array.
        if id(stored) not in self._numbers:
            self._numbers[id(stored)] = numbers(stored.text)
        values = self._numbers[id(stored)]
        usual = {"count": "", "stride": "1", "offset": "0"}
        count, stride, offset = (int(accessor.get(key, default)) for key, default in usual.items())
        check_counts(count, 0)
        # Accessors share numbers: many of them together may still give too many points.
        self._read += count
        check_counts(self._read, 0)
        # NumPy would wrap negative places and read other points.
        if stride < 3 or offset < 0 or count < 1 or offset + stride * (count - 1) + 3 > len(values):
            raise ModelError(f"an accessor of {count:,} points in {len(values):,} numbers")
        return np.asarray(values[(offset + stride * np.arange(count))[:, None] + np.arange(3)])


def _input(element: ElementTree.Element, semantic: str) -> ElementTree.Element:
    found = next((each for each in element.findall("input") if each.get("semantic") == semantic), None)
    if found is None:
        raise ModelError(f"<{element.tag}> has no {semantic}")
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
        # In degrees, about an axis of any length.
        *axis, angle = numbers(part.text).reshape(4)
        length = np.linalg.norm(axis)
        if length > 0:
            matrix[:3, :3] = pin.AngleAxis(np.deg2rad(angle), np.array(axis) / length).toRotationMatrix()
    else:
        raise ModelError(f"<{part.tag}> is not read")
    return matrix


def _primitive(primitive: ElementTree.Element) -> np.ndarray:
    """Indices of positions (k, 3)."""
    inputs = [int(each.get("offset", "0")) for each in primitive.findall("input")]
    place, width = int(_input(primitive, "VERTEX").get("offset", "0")), max(inputs) + 1
    # Corners have a few inputs: a huge offset is a fault of the file.
    if min(inputs) < 0 or width > 64:
        raise ModelError("an input has no offset")
    lists = [numbers(each.text, np.int64) for each in primitive.findall("p")]
    if any(len(each) % width for each in lists):
        raise ModelError(f"indices of <{primitive.tag}> are not in groups of {width}")
    corners = [each[place::width] for each in lists]
    together = np.concatenate(corners) if corners else np.zeros(0, dtype=np.int64)
    if primitive.tag == "polylist":
        counts = primitive.find("vcount")
        return fans(together, numbers(None if counts is None else counts.text, np.int64))
    if primitive.tag == "triangles":
        return fans(together, np.full(len(together) // 3, 3))
    return fans(together, np.array([len(each) for each in corners], dtype=np.int64))


# ---------------------------------------------------------------------- trimesh


def read_by_trimesh(kind: str, content: bytes) -> Mesh:
    """Read a GLB file, a glTF file with embedded data, or a PLY file. Points and lines are not read.

    Args:
        kind: "glb", "gltf" or "ply".
        content: content of the file.

    Raises:
        ModelError: trimesh is not installed; or the file is not well formed, compressed, too large, shorter or longer
            than its header says, or has data in other files.
    """
    try:
        import trimesh
    except ImportError:
        raise ModelError(missing_extra("meshes")) from None
    checks: Mapping[str, Callable[[bytes], None]] = {"glb": _check_glb, "gltf": _check_gltf, "ply": _check_ply}
    checks[kind](content)
    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL)  # the error says it
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of numbers that are not finite, which our checks refuse
        warnings.filterwarnings("error", "string or file could not be read")  # words in place of numbers
        try:
            # Without processing: merging vertices and dropping faces is done here, after the checks.
            scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, process=False, skip_materials=True)
        except Exception:  # any: trimesh checks little
            raise ModelError(f"not well-formed {kind.upper()}") from None
        finally:
            log.setLevel(level)
    read = {
        name: checked_mesh(found.vertices, found.faces)
        for name, found in scene.geometry.items()
        if len(getattr(found, "faces", ()))
    }
    placed = (scene.graph[node] for node in scene.graph.nodes_geometry)
    return scene_mesh((read[name], placement) for placement, name in placed if name in read)


def _check_glb(content: bytes) -> None:
    # The header has twelve bytes; then each chunk begins with its size and its type.
    size, kind = (int(each) for each in np.frombuffer(content, "<u4", 2, 12))
    json_chunk = 0x4E4F534A  # type of the first chunk of a GLB
    if kind != json_chunk or size > len(content) - 20:
        raise ModelError(f"a chunk of {size:,} bytes in a file of {len(content):,}")
    _check_gltf(content[20 : 20 + size], len(content))


def _check_gltf(text: bytes, size: int | None = None) -> None:
    """Refuse the JSON of a glTF, in a file of ``size`` bytes, before trimesh makes arrays of it."""
    size = size or len(text)
    most_parts = 2_000_000  # of the JSON: each part takes more memory than its text
    if sum(map(text.count, (b"[", b"{", b","))) > most_parts:
        raise ModelError(f"JSON of more than {most_parts:,} parts")
    document: Mapping[str, Any] = json.loads(text)
    for buffer in document.get("buffers", ()):
        uri = buffer.get("uri", "data:")
        if not uri.startswith("data:"):
            raise ModelError(f"data in another file, '{uri[:40]}', is not read: put all into one .glb")
    if len(document.get("nodes", ())) > _MAX_NODES:
        raise ModelError(f"more than {_MAX_NODES:,} nodes")
    views, accessors = document.get("bufferViews", ()), document.get("accessors", ())
    sizes = [each["byteLength"] for each in views] + [each.get("byteOffset", 0) for each in (*views, *accessors)]
    counts = [each["count"] for each in accessors] + [each.get("byteStride", 1) for each in views]
    if not all(isinstance(each, int) and each >= 0 for each in (*sizes, *counts)) or 0 in counts[len(accessors) :]:
        raise ModelError("a size is not a whole number")
    if any("sparse" in each or "bufferView" not in each for each in accessors):
        raise ModelError("an accessor that is sparse or compressed is not read")
    most_copies = 4  # bytes of all views, relative to the bytes of the file
    most_items = 12_000_000  # of all accessors
    if sum(sizes[: len(views)]) > most_copies * size or sum(counts[: len(accessors)]) > most_items:
        raise ModelError(f"declares {sum(counts[: len(accessors)]):,} items in {size:,} bytes, at most {most_items:,}")
    _check_primitives(document)


def _check_primitives(document: Mapping[str, Any]) -> None:
    """Refuse positions that are not floats, which trimesh does not scale, and more triangles than a mesh may have."""
    accessors, meshes = document.get("accessors", ()), document.get("meshes", ())
    triangles = []
    float_type = 5126  # component type of glTF
    for mesh in meshes:
        count = 0
        for primitive in mesh["primitives"]:
            place = primitive["attributes"]["POSITION"]
            if accessors[place]["componentType"] != float_type:
                raise ModelError("positions that are not floats are not read")
            count += accessors[primitive.get("indices", place)]["count"]
        triangles.append(count // 3)
    used = [node["mesh"] for node in document.get("nodes", ()) if "mesh" in node]
    check_counts(0, sum(triangles[each] for each in used))


def _check_ply(content: bytes) -> None:
    """Refuse a PLY file whose header is wrong, or says more than there is."""
    header_limit = 1 << 16  # bytes
    end = content.find(b"end_header", 0, header_limit)
    if not content.startswith(b"ply") or end < 0:
        raise ModelError("has no PLY header")
    lines = [line.split() for line in content[:end].decode("ascii", "replace").splitlines()]
    rows = [int(words[2]) for words in lines if words[:1] == ["element"]]
    if min(rows, default=0) < 0 or sum(rows) > len(content):
        raise ModelError(f"says {sum(rows):,} elements in {len(content):,} bytes")
    is_text = b"ascii" in content.split(b"\n", 2)[1].lower()
    if is_text and sum(rows) > content.count(b"\n", end):
        raise ModelError("ends before its last element")
    most_rows = 4_000_000  # lines of a PLY as text, each of which trimesh makes an array
    breaks = (b"\n", b"\r", b"\v", b"\f", b"\x1c", b"\x1d", b"\x1e")  # where Python splits lines
    if is_text and not (content.isascii() and sum(map(content.count, breaks)) <= most_rows):
        raise ModelError(f"text that is not ASCII, or has more than {most_rows:,} lines")
