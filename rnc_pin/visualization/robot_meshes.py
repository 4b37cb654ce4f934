"""Meshes and textures of a robot as the viewers draw them.

A file may scale a mesh by negative factors, for example to draw both arms from one mesh. A placement cannot mirror, so
the mesh itself is mirrored. The placement contains only the absolute values of the factors.

A page includes the textures of Collada meshes, so each texture must be an image in a folder of the robot.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, ModelWarning
from rnc_pin.io.safe_read import read_bytes
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.containment import is_below

_BEGINNINGS = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"GIF8", b"BM", b"RIFF", b"II*\0", b"MM\0*", b"DDS ")
_TARGA = (1, 2, 3, 9, 10, 11)  # image types in the third byte of a Targa file, which has no magic number


def check_drawable(robot: Robot) -> None:
    """Check that a robot has visual geometry.

    Raises:
        ModelError: the robot has no visual geometry.
    """
    visual = robot.visual_model
    if visual is None or not len(visual.geometryObjects):
        raise ModelError(f"robot '{robot.name}' has no visual geometry to draw")


def drawn_scale(shape: pin.GeometryObject) -> np.ndarray:
    """Absolute scale factors (3,) in the placement of a shape."""
    return np.abs(np.asarray(shape.meshScale, dtype=float))


def drawn_triangles(shape: pin.GeometryObject) -> np.ndarray:
    """Triangles (N, 3, 3) of a mesh as drawn, before ``drawn_scale``; corners counterclockwise seen from outside."""
    mesh, scale = shape.geometry, np.asarray(shape.meshScale, dtype=float)
    indices = (mesh.tri_indices(k) for k in range(mesh.num_tris))
    triangles = np.array(mesh.vertices())[np.array([(each[0], each[1], each[2]) for each in indices])]
    if scale.prod() < 0:  # mirroring reverses the orientation of every triangle
        triangles = triangles[:, ::-1]
    return np.asarray(triangles / np.abs(scale))


def has_own_textures(mesh: Path, folders: Sequence[Path]) -> bool:
    """True if all images that a Collada file names are allowed; a ``ModelWarning`` names the first that is not.

    Args:
        mesh: path of the Collada file.
        folders: folders whose files the robot's description may name.

    Raises:
        OSError: the file cannot be read.
        xml.etree.ElementTree.ParseError: the file is not valid XML.
    """
    roots = [mesh.resolve().parent, *folders]
    for name in _names(ElementTree.fromstring(read_bytes(mesh))):
        places = [mesh.parent / each for each in {name, unquote(name)}]
        if not any(_is_image(place) for place in places if is_below(place, roots)):
            text = f"{mesh.name}: texture '{name[:120]}' is not an image below the robot's own folders and is left out"
            warnings.warn(text, ModelWarning, stacklevel=2)
            return False
    return True


def _names(root: ElementTree.Element) -> Iterator[str]:
    for library in root.iter():
        if str(library.tag).endswith("library_images"):
            for element in library.iter():
                if "init_from" in str(element.tag):
                    yield from ([element.text] if element.text and element.text.strip() else [])
                elif str(element.tag).endswith("ref") and element.text:
                    yield element.text


def _is_image(path: Path) -> bool:
    try:
        content = read_bytes(path)
    except (OSError, ValueError):
        return False
    targa = path.suffix.lower() == ".tga" and len(content) > 18 and content[2] in _TARGA
    return content.startswith(_BEGINNINGS) or targa
