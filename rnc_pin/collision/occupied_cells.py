"""Point clouds, meshes of any form and maps of ROS navigation as obstacles: occupied cells, merged into boxes."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import coal
import numpy as np
import yaml
from numpy import ndarray as Array
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from rnc_pin.array_shapes import Bool, Float, Int
from rnc_pin.collision.shapes import Obstacle
from rnc_pin.errors import ConfigurationError, InputError, ModelError
from rnc_pin.io.safe_read import load_yaml, read_bytes
from rnc_pin.io.strict_mapping import Strict, validated, wrong
from rnc_pin.printing import printed
from rnc_pin.robots.sources.mesh_formats import FORMATS, Mesh, MeshError, read_mesh
from rnc_pin.robots.sources.mesh_formats.readers import read_ply_points

MOST_BOXES = 2000
"""Largest number of boxes; each is a pair with every shape of the robot."""

_MOST_CELLS = 2**25  # of a grid
_MOST_PIECES = 4_000_000  # of the triangles of a mesh
_FINER = 4  # pieces of triangles are smaller than cells by this factor
_CLOUDS = (".pcd", ".ply", ".xyz")
_KINDS = {"F": "f", "I": "i", "U": "u"}  # of PCD, as numpy names them


@printed(side="m")
@dataclass(frozen=True)
class OccupiedCells:
    """Grid of cubes, some of which are occupied.

    Attributes:
        occupied: True (n, m, k) for occupied cubes, along x, y and z.
        side: side of a cube [m].
        origin: corner of the first cube (3,) [m].
        name: name of its obstacles.
    """

    occupied: Bool[Array, "n m k"]
    side: float
    origin: Float[Array, " 3"]
    name: str = "cells"

    def obstacles(
        self, position: ArrayLike = (0.0, 0.0, 0.0), yaw: float = 0.0, roll: float = 0.0, pitch: float = 0.0
    ) -> tuple[Obstacle, ...]:
        """Boxes that cover the occupied cubes exactly.

        Args:
            position: origin of the points' frame in the world (3,) [m].
            yaw: rotation of the points' frame about the world's z [rad], after roll and pitch.
            roll: rotation about x [rad].
            pitch: rotation about y [rad].

        Raises:
            ModelError: there are too many boxes.
        """
        found = _few_boxes(self.occupied, f"cells '{self.name}'", "a larger 'side'")
        # An obstacle checks the numbers, and knows the order of its angles.
        frame = Obstacle(coal.Sphere(1.0), position, yaw, roll, pitch, self.name).placement(0.0)
        boxes = []
        for k, (first, size) in enumerate(zip(found[:, :3], found[:, 3:], strict=True)):
            middle = frame.act(self.origin + self.side * (first + 0.5 * size))
            shape = coal.Box(*(self.side * size).tolist())
            boxes.append(Obstacle(shape, middle, yaw, roll, pitch, f"{self.name} {k + 1}"))
        return tuple(boxes)


def merged_boxes(filled: Bool[Array, "*n"]) -> Int[Array, "k m"]:
    """Disjoint boxes that cover the True cells of a grid exactly: first indices, then sizes, along each axis."""
    rest, found = filled.copy(), []
    for start in np.argwhere(filled).tolist():
        if not rest[tuple(start)]:
            continue
        window = [slice(at, at + 1) for at in start]
        for axis in reversed(range(rest.ndim)):
            window[axis] = slice(start[axis], None)
            others = tuple(k for k in range(rest.ndim) if k != axis)
            along = np.asarray(rest[tuple(window)].all(axis=others))
            size = len(along) if along.all() else int(np.argmin(along))
            window[axis] = slice(start[axis], start[axis] + size)
        rest[tuple(window)] = False
        found.append([*start, *(each.stop - each.start for each in window)])
    return np.array(found, dtype=int).reshape(-1, 2 * filled.ndim)


def _few_boxes(filled: Bool[Array, "*n"], title: str, remedy: str) -> Int[Array, "k m"]:
    """Merged boxes, or an error with a remedy if there are too many."""
    found = merged_boxes(filled)
    if len(found) > MOST_BOXES:
        raise ModelError(f"{title}: {len(found)} boxes, expected at most {MOST_BOXES}: give {remedy}")
    return found


def cells_around(points: ArrayLike, side: float, name: str = "cloud") -> OccupiedCells:
    """Return the cubes that contain points.

    Args:
        points: coordinates (n, 3) [m]; rows that are not finite, which scanners write for no return, are left out.
        side: side of a cube [m].
        name: name of the obstacles.

    Raises:
        InputError: wrong shapes, or a side that is not positive.
        ModelError: there are no finite points, or too many cubes.

    Example:
        >>> pole = np.column_stack([np.zeros(50), np.zeros(50), np.linspace(0.01, 0.99, 50)])
        >>> (box,) = rnc.collision.cells_around(pole, side=0.1).obstacles()
        >>> box.placement(0.0).translation.round(3)
        array([0.05, 0.05, 0.5 ])
    """
    found = np.asarray(points, dtype=float)
    if found.ndim != 2 or found.shape[1] != 3:
        raise InputError(f"cells '{name}': points have shape {found.shape}, expected (n, 3)")
    return _cells(found[np.isfinite(found).all(axis=1)], np.zeros((1, 3)), side, name)


def load_cells(path: str | Path, side: float, scale: float = 1.0, name: str = "cells") -> OccupiedCells:
    """Return the cubes that contain the points of a cloud, or the surface of a mesh.

    A mesh may have any form: holes and hollows stay open if they are wider than two cubes. Its inside is not filled.

    Args:
        path: a cloud (.pcd, .xyz, or .ply without faces), or a mesh as for ``load_mesh_shape``.
        side: side of a cube [m].
        scale: factor of the coordinates.
        name: name of the obstacles.

    Raises:
        InputError: a side or a scale that is not positive.
        ModelError: the file cannot be read, has no points, or needs too many cubes.
    """
    path = Path(path)
    title = f"cells '{name}': '{path.name}'"
    ending = path.suffix.lower()
    if ending not in (*_CLOUDS, *FORMATS):
        raise ModelError(f"{title}: expected one of {', '.join(dict.fromkeys((*_CLOUDS, *FORMATS)))}")
    if not 0.0 < scale < np.inf:
        raise InputError(f"{title}: scale: expected a positive number, found {scale!r}")
    try:
        points = _points(path, ending)
        if points is not None:
            return cells_around(scale * points, side, name)
        mesh = read_mesh(path)
    except (OSError, MeshError, ValueError, KeyError, TypeError) as error:
        raise ModelError(f"{title}: {error}") from None
    _check_side(side, name)
    pieces = _small(Mesh(scale * mesh.vertices, mesh.triangles), side / _FINER, title)
    low = pieces.min(axis=1)
    return _cells(low, (pieces.max(axis=1) - low), side, name)


def _points(path: Path, ending: str) -> Float[Array, "n 3"] | None:
    """Points of a cloud; None for a mesh."""
    if ending not in _CLOUDS:
        return None
    content = read_bytes(path)
    if ending == ".ply":
        return read_ply_points(content)
    return _pcd(content) if ending == ".pcd" else _table(content, (0, 1, 2))


def _table(content: bytes, columns: tuple[int, ...]) -> Float[Array, "n 3"]:
    """Columns of numbers between spaces or commas."""
    text = io.StringIO(content.decode("ascii").replace(",", " "))
    return np.loadtxt(text, usecols=columns, ndmin=2)


def _pcd(content: bytes) -> Float[Array, "n 3"]:
    """Points of a PCD file, as text or binary."""
    head: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in head:
        end = content.find(b"\n", start, start + 4096)
        if end < 0:
            raise MeshError("has no line 'DATA' in its header")
        words = content[start:end].decode("ascii", "replace").split()
        if words:
            head[words[0]] = words[1:]
        start = end + 1
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "POINTS") if key not in head]
    if missing or not {"x", "y", "z"} <= set(head.get("FIELDS", [])):
        raise MeshError(f"expected the header lines FIELDS, with x, y and z, SIZE, TYPE and POINTS; {missing} missing")
    fields, count = head["FIELDS"], int(head["POINTS"][0])
    repeats = [int(each) for each in head.get("COUNT", ["1"] * len(fields))]
    first = [sum(repeats[: fields.index(axis)]) for axis in "xyz"]
    if head["DATA"] == ["ascii"]:
        found = _table(content[start:], (first[0], first[1], first[2]))
        if len(found) != count:
            raise MeshError(f"has {len(found)} points, its header says {count}")
        return found
    if head["DATA"] != ["binary"]:
        raise MeshError(f"data are {' '.join(head['DATA'])}, expected 'ascii' or 'binary'")
    kinds = [f"<{_KINDS[kind]}{size}" for kind, size in zip(head["TYPE"], head["SIZE"], strict=True)]
    row = np.dtype([(f"{k}", kind, (times,)) for k, (kind, times) in enumerate(zip(kinds, repeats, strict=True))])
    if not 0 <= count * row.itemsize <= len(content) - start:
        raise MeshError("ends before its last point")
    rows = np.frombuffer(content, row, count, start)
    return np.column_stack([rows[f"{fields.index(axis)}"][:, 0].astype(float) for axis in "xyz"])


def _small(mesh: Mesh, longest: float, title: str) -> Float[Array, "k 3 3"]:
    """Corners of the triangles, which are halved until no side is longer."""
    done, rest = [], mesh.vertices[mesh.triangles]
    while len(rest):
        sides = np.linalg.norm(rest - np.roll(rest, -1, axis=1), axis=2)
        small = sides.max(axis=1) <= longest
        done.append(rest[small])
        rest, sides = rest[~small], sides[~small]
        if sum(map(len, done)) + 2 * len(rest) > _MOST_PIECES:
            raise ModelError(f"{title}: its surface has too many cubes: give a larger 'side'")
        turned = (np.argmax(sides, axis=1)[:, None] + np.arange(3)) % 3  # the longest side first
        a, b, c = np.swapaxes(np.take_along_axis(rest, turned[:, :, None], axis=1), 0, 1)
        middle = 0.5 * (a + b)
        rest = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


def _check_side(side: float, name: str) -> None:
    if not 0.0 < side < np.inf:
        raise InputError(f"cells '{name}': side: expected a positive number, found {side!r}")


def _cells(low: Float[Array, "n 3"], size: Float[Array, "n 3"], side: float, name: str) -> OccupiedCells:
    """Cubes that touch boxes with given smallest corners and sizes, which are smaller than a cube."""
    _check_side(side, name)
    if not len(low):
        raise ModelError(f"cells '{name}': there are no points")
    corners = [low + size * [x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)] if size.any() else [low]
    places = np.floor(np.concatenate(corners) / side)
    first = places.min(axis=0)
    count = places.max(axis=0) - first + 1.0
    if not count.prod() <= _MOST_CELLS:
        raise ModelError(
            f"cells '{name}': {count.prod():.3g} cubes, expected at most {_MOST_CELLS:,}: give a larger 'side'"
        )
    occupied = np.zeros(count.astype(int).tolist(), dtype=bool)
    occupied[tuple((places - first).astype(int).T)] = True
    occupied.setflags(write=False)
    origin = side * first
    origin.setflags(write=False)
    return OccupiedCells(occupied, float(side), origin, name)


# ------------------------------------------------------------------ maps

_LARGEST = 2**26  # pixels of an image


@printed(resolution="m")
@dataclass(frozen=True)
class OccupancyMap:
    """Map of occupied cells.

    Attributes:
        occupied: True (rows, columns) for occupied cells; row 0 is at the origin, columns are along x.
        unknown: True for cells that are neither occupied nor free.
        resolution: side of a cell [m].
        origin: x, y [m] and yaw [rad] of the corner of cell (0, 0) in the world.
        name: name of its obstacles.
    """

    occupied: Bool[Array, "n m"]
    unknown: Bool[Array, "n m"]
    resolution: float
    origin: Float[Array, " 3"]
    name: str = "map"

    def obstacles(self, height: float = 2.0, unknown: bool = False, cells: int = 1) -> tuple[Obstacle, ...]:
        """Boxes that cover the occupied cells exactly, on the ground.

        Args:
            height: height of the boxes [m].
            unknown: True if unknown cells are obstacles too.
            cells: side of the squares of cells that count as one, which is occupied if any of its cells is. Larger
                squares give fewer boxes, and narrower passages.

        Raises:
            ModelError: there are too many boxes.
        """
        filled = self.occupied | self.unknown if unknown else self.occupied
        if cells > 1:
            rows, columns = (-(-size // cells) * cells for size in filled.shape)
            padded = np.zeros((rows, columns), dtype=bool)
            padded[: filled.shape[0], : filled.shape[1]] = filled
            filled = padded.reshape(rows // cells, cells, columns // cells, cells).any(axis=(1, 3))
        found = _few_boxes(filled, f"map '{self.name}'", "more 'cells'")
        side, (x, y, yaw) = cells * self.resolution, self.origin.tolist()
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        boxes = []
        for k, (row, column, rows, columns) in enumerate(found.tolist()):
            middle = turn @ [side * (column + 0.5 * columns), side * (row + 0.5 * rows)] + [x, y]
            shape = coal.Box(side * columns, side * rows, height)
            place = (float(middle[0]), float(middle[1]), 0.5 * height)
            boxes.append(Obstacle(shape, position=place, yaw=yaw, name=f"{self.name} {k + 1}"))
        return tuple(boxes)


def load_map(path: str | Path, name: str = "map") -> OccupancyMap:
    """Read a map of ROS navigation: a YAML file and the PGM or PNG image beside it.

    The keys are those of ``nav2_map_server``: image, resolution, origin, negate, occupied_thresh and free_thresh. A
    cell with occupancy p is occupied above ``occupied_thresh``, free below ``free_thresh``, and unknown between both.
    The modes "trinary" and "scale" are read alike; a transparent cell of a map in mode "scale" is unknown.

    Args:
        path: the YAML file. Its image is in the same folder, or below it.
        name: name of the obstacles.

    Raises:
        ModelError: a file cannot be read, a key is missing, unknown or wrong, or the image is not in the folder.
    """
    path = Path(path)
    title = f"map '{path.name}'"
    try:
        keys = validated(_MapKeys, load_yaml(read_bytes(path).decode()), title)
    except (ConfigurationError, OSError, ValueError, yaml.YAMLError) as error:
        text = " ".join(str(error).split()).removeprefix(f"{title}: ")
        raise ModelError(f"{title}: {text}") from None
    bright, transparent = _pixels(path, keys.image, title)
    occupancy = bright if keys.negate else 1.0 - bright
    seen = ~transparent if keys.mode == "scale" else np.ones_like(transparent)
    occupied = (occupancy > keys.occupied_thresh) & seen
    unknown = ~occupied & ~((occupancy < keys.free_thresh) & seen)
    for array in (occupied, unknown):
        array.setflags(write=False)
    return OccupancyMap(occupied, unknown, keys.resolution, np.array(keys.origin), name)


class _MapKeys(Strict):
    """Keys of a map's YAML file."""

    image: str
    resolution: Annotated[float, Field(gt=0)]
    origin: Annotated[list[float], Field(min_length=3, max_length=3)]
    negate: Literal[0, 1]
    occupied_thresh: Annotated[float, Field(ge=0, le=1)]
    free_thresh: Annotated[float, Field(ge=0, le=1)]
    mode: Literal["trinary", "scale"] = "trinary"

    @model_validator(mode="after")
    def _in_order(self) -> _MapKeys:
        if not self.free_thresh < self.occupied_thresh:
            raise wrong("free_thresh", f"expected less than occupied_thresh, found {self.free_thresh:g}")
        return self


def _pixels(path: Path, image: str, title: str) -> tuple[Float[Array, "n m"], Bool[Array, "n m"]]:
    """Brightness from 0 to 1 of the cells, the lowest row first, and the mask of transparent ones."""
    from PIL import Image, UnidentifiedImageError

    file = (path.parent / image).resolve()
    if not file.is_relative_to(path.parent.resolve()):
        raise ModelError(f"{title}: image '{image}' is not in the folder of the map")
    try:
        with Image.open(io.BytesIO(read_bytes(file)), formats=["PNG", "PPM"]) as picture:
            if picture.width * picture.height > _LARGEST:
                raise ModelError(f"{title}: image '{image}' has more than {_LARGEST:,} pixels")
            if picture.mode not in ("1", "L", "LA", "P", "RGB", "RGBA"):
                raise ModelError(f"{title}: image '{image}' has pixels of mode {picture.mode}, expected 8 bits")
            colors = np.array(picture.convert("RGBA"), dtype=float)
    except UnidentifiedImageError:
        raise ModelError(f"{title}: image '{image}' is neither PGM nor PNG") from None
    except (OSError, ValueError, SyntaxError) as error:
        raise ModelError(f"{title}: image '{image}': {error}") from None
    return colors[::-1, :, :3].mean(axis=2) / 255.0, colors[::-1, :, 3] == 0.0
