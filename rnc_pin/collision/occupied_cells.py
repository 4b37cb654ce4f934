"""Points and maps of ROS navigation as obstacles: occupied cells, merged into boxes."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import coal
import numpy as np
import yaml
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from rnc_pin.array_shapes import Array, Bool, Float, Int
from rnc_pin.collision.shapes import Obstacle
from rnc_pin.errors import ConfigurationError, InputError, ModelError
from rnc_pin.io.safe_read import load_yaml, read_bytes
from rnc_pin.io.strict_mapping import Strict, validated, wrong
from rnc_pin.printing import printed

MOST_BOXES = 2000
"""Largest number of boxes; each is a pair with every shape of the robot."""


def merged_boxes(filled: Bool[Array, "*n"]) -> Int[Array, "k m"]:
    """Disjoint boxes that cover the True cells of a grid exactly: first indices, then sizes, along each axis.

    Args:
        filled: grid of any number m of axes.
    """
    rest, found = filled.copy(), []
    for start in np.argwhere(filled).tolist():
        if not rest[tuple(start)]:
            continue
        window = [slice(at, at + 1) for at in start]
        # Greedy: as long as possible along the last axis, then along the others. Not the least number, but disjoint and
        # exact.
        for axis in reversed(range(rest.ndim)):
            window[axis] = slice(start[axis], None)
            others = tuple(k for k in range(rest.ndim) if k != axis)
            along = np.asarray(rest[tuple(window)].all(axis=others))
            size = len(along) if along.all() else int(np.argmin(along))
            window[axis] = slice(start[axis], start[axis] + size)
        # Cells of a box are taken: boxes are disjoint.
        rest[tuple(window)] = False
        found.append([*start, *(each.stop - each.start for each in window)])
    return np.array(found, dtype=int).reshape(-1, 2 * filled.ndim)


def _few_boxes(filled: Bool[Array, "*n"], title: str, remedy: str) -> Int[Array, "k m"]:
    """Merged boxes, or an error with a remedy if there are too many."""
    found = merged_boxes(filled)
    if len(found) > MOST_BOXES:
        raise ModelError(f"{title}: {len(found)} boxes, expected at most {MOST_BOXES}: give {remedy}")
    return found


def cells_around(points: ArrayLike, side: float, name: str = "cells") -> tuple[Obstacle, ...]:
    """Return boxes that cover the cubes with points in them exactly, such as the points of a scanner.

    Args:
        points: coordinates (n, 3) in the world [m]; rows that are not finite, which scanners write for no return, are
            left out.
        side: side of a cube [m].
        name: name of the obstacles, which are numbered.

    Raises:
        InputError: wrong shapes, or a side that is not positive.
        ModelError: there are no finite points, or too many cubes or boxes.

    Example:
        >>> pole = np.column_stack([np.zeros(50), np.zeros(50), np.linspace(0.01, 0.99, 50)])
        >>> (box,) = rnc.collision.cells_around(pole, side=0.1)
        >>> box.placement(0.0).translation.round(3)
        array([0.05, 0.05, 0.5 ])
    """
    title, given = f"cells '{name}'", np.asarray(points, dtype=float)
    if given.ndim != 2 or given.shape[1] != 3:
        raise InputError(f"{title}: points have shape {given.shape}, expected (n, 3)")
    if not 0.0 < side < np.inf:
        raise InputError(f"{title}: side: expected a positive number, found {side!r}")
    # Scanners give NaN or infinity where they see nothing.
    places = np.floor(given[np.isfinite(given).all(axis=1)] / side)
    if not len(places):
        raise ModelError(f"{title}: there are no points")
    first = places.min(axis=0)
    count = places.max(axis=0) - first + 1.0
    most_cells = 2**25  # a byte each in memory; a far outlier of a scan would span more
    if not count.prod() <= most_cells:
        raise ModelError(f"{title}: {count.prod():.3g} cubes, expected at most {most_cells:,}: give a larger 'side'")
    occupied = np.zeros(count.astype(int).tolist(), dtype=bool)
    occupied[tuple((places - first).astype(int).T)] = True
    found = _few_boxes(occupied, title, "a larger 'side'")
    boxes = [(coal.Box(*(side * box[3:]).tolist()), side * (first + box[:3] + 0.5 * box[3:])) for box in found]
    return tuple(Obstacle(shape, position=at, name=f"{name} {k}") for k, (shape, at) in enumerate(boxes, start=1))


# ------------------------------------------------------------------ maps


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
            # Up to whole groups of cells; what lies beyond the map is free.
            padded = np.zeros((rows, columns), dtype=bool)
            padded[: filled.shape[0], : filled.shape[1]] = filled
            filled = padded.reshape(rows // cells, cells, columns // cells, cells).any(axis=(1, 3))
        found = _few_boxes(filled, f"map '{self.name}'", "more 'cells'")
        side, (x, y, yaw) = cells * self.resolution, self.origin.tolist()
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        boxes = []
        for k, (row, column, rows, columns) in enumerate(found.tolist()):
            # The origin of a map may have a yaw, which turns all cells about the corner of the first one.
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
    # map_server reads transparency in this mode alone.
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

    # A map from an untrusted source could name any file of the computer.
    file = (path.parent / image).resolve()
    if not file.is_relative_to(path.parent.resolve()):
        raise ModelError(f"{title}: image '{image}' is not in the folder of the map")
    largest = 2**26  # pixels: a small PNG may declare any size, and each takes 32 bytes as RGBA numbers
    try:
        with Image.open(io.BytesIO(read_bytes(file)), formats=["PNG", "PPM"]) as picture:
            if picture.width * picture.height > largest:
                raise ModelError(f"{title}: image '{image}' has more than {largest:,} pixels")
            if picture.mode not in ("1", "L", "LA", "P", "RGB", "RGBA"):
                raise ModelError(f"{title}: image '{image}' has pixels of mode {picture.mode}, expected 8 bits")
            colors = np.array(picture.convert("RGBA"), dtype=float)
    except UnidentifiedImageError:
        raise ModelError(f"{title}: image '{image}' is neither PGM nor PNG") from None
    except (OSError, ValueError, SyntaxError) as error:
        raise ModelError(f"{title}: image '{image}': {error}") from None
    # The first row of an image is its top, which is the farthest along y on the map.
    return colors[::-1, :, :3].mean(axis=2) / 255.0, colors[::-1, :, 3] == 0.0
