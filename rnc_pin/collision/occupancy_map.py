"""Maps of ROS navigation as obstacles: occupied cells of an image, merged into boxes."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeGuard

import coal
import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Bool, Float
from rnc_pin.collision.obstacle import Obstacle
from rnc_pin.collision.occupied_cells import MOST_BOXES, merged_boxes
from rnc_pin.errors import ModelError, nearest
from rnc_pin.io.safe_read import load_yaml, read_bytes
from rnc_pin.printing import printed

_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")
_NEEDED = _KEYS[:6]
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
        found = merged_boxes(filled)
        if len(found) > MOST_BOXES:
            raise ModelError(f"map '{self.name}': {len(found)} boxes, expected at most {MOST_BOXES}: give more 'cells'")
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
    content = _content(path, title)
    resolution = _number(content, "resolution", title)
    low, high = (_number(content, key, title) for key in ("free_thresh", "occupied_thresh"))
    if not (resolution > 0.0 and 0.0 <= low < high <= 1.0):
        raise ModelError(
            f"{title}: expected a positive resolution and 0 <= free_thresh < occupied_thresh <= 1, "
            f"found {resolution:g}, {low:g} and {high:g}"
        )
    if content["negate"] not in (0, 1):
        raise ModelError(f"{title}: negate: expected 0 or 1, found {content['negate']!r}")
    if (mode := content.get("mode", "trinary")) not in ("trinary", "scale"):
        raise ModelError(f"{title}: mode: expected 'trinary' or 'scale', found {mode!r}")
    origin = content["origin"]
    if not isinstance(origin, list) or len(origin) != 3 or not all(_is_number(each) for each in origin):
        raise ModelError(f"{title}: origin: expected x, y and yaw, found {origin!r}")
    bright, transparent = _pixels(path, content["image"], title)
    occupancy = bright if content["negate"] else 1.0 - bright
    seen = ~transparent if mode == "scale" else np.ones_like(transparent)
    occupied = (occupancy > high) & seen
    unknown = ~occupied & ~((occupancy < low) & seen)
    for array in (occupied, unknown):
        array.setflags(write=False)
    return OccupancyMap(occupied, unknown, resolution, np.array(origin, dtype=float), name)


def _content(path: Path, title: str) -> Mapping[str, object]:
    """Mapping of a map's YAML file."""
    try:
        content = load_yaml(read_bytes(path).decode())
    except (OSError, ValueError) as error:
        raise ModelError(f"{title}: {error}") from None
    if not isinstance(content, dict):
        raise ModelError(f"{title}: expected the keys {', '.join(_NEEDED)}")
    for key in content:
        if key not in _KEYS:
            raise ModelError(f"{title}: unknown key '{key}'{nearest(str(key), _KEYS)}")
    for key in _NEEDED:
        if key not in content:
            raise ModelError(f"{title}: no key '{key}'; expected {', '.join(_NEEDED)}")
    return content


def _number(content: Mapping[str, object], key: str, title: str) -> float:
    value = content[key]
    if not _is_number(value):
        raise ModelError(f"{title}: {key}: expected a number, found {value!r}")
    return value


def _is_number(value: object) -> TypeGuard[float]:
    return not isinstance(value, bool) and isinstance(value, int | float) and bool(np.isfinite(value))


def _pixels(path: Path, image: object, title: str) -> tuple[Float[Array, "n m"], Bool[Array, "n m"]]:
    """Brightness from 0 to 1 of the cells, the lowest row first, and the mask of transparent ones."""
    from PIL import Image, UnidentifiedImageError

    if not isinstance(image, str):
        raise ModelError(f"{title}: image: expected a file name, found {image!r}")
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
