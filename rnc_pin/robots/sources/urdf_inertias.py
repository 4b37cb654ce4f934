"""Inertias of the links of a URDF: those in the file, and those computed from a given mass."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, nearest
from rnc_pin.robots.sources.description import Body
from rnc_pin.robots.sources.mesh_formats import MeshError, read_mesh
from rnc_pin.robots.sources.numeric_checks import read_number, read_numbers

BALL = 0.05  # radius [m] of the ball that represents a link without geometry
_FLAT = 1e-2  # shortest edge of a box, relative to its longest edge


def give_masses(root: ElementTree.Element, masses: Mapping[str, float], path: Path) -> None:
    """Give masses to links without a valid inertia, with uniform density in the box around their geometry.

    The box encloses the collision geometry, or the visual geometry if there is none. Without readable geometry, the
    link is a ball of radius ``BALL``.

    Args:
        root: XML of the robot, with absolute paths of meshes.
        masses: link to mass [kg].
        path: path of the file, for messages.

    Raises:
        ModelError: unknown link, a link with a valid inertia, or a mass that is not positive.
    """
    links = {str(link.get("name")): link for link in root.findall("link")}
    for name, mass in masses.items():
        if name not in links:
            raise ModelError(f"{path}: masses: no link '{name}'{nearest(str(name), links)}")
        if isinstance(mass, bool) or not isinstance(mass, int | float) or not 0 < mass < np.inf:
            raise ModelError(f"{path}: mass of link '{name}' has to be positive [kg], found {mass!r}")
        link = links[name]
        body = _body(link)
        if body.mass > 0 and np.linalg.eigvalsh(body.inertia)[0] > 0:
            raise ModelError(
                f"{path}: masses: link '{name}' has an inertia of its own ({body.mass:g} kg), and masses= is for links "
                f"without a useful one: robot.with_masses({{'{name}': {mass!r}}}) gives it another mass"
            )
        for inertial in link.findall("inertial"):
            link.remove(inertial)
        link.append(_inertial(float(mass), *_box(link)))


def bodies_of(root: ElementTree.Element) -> dict[str, Body]:
    """Link name to its mass, inertia and geometry in the file."""
    return {str(link.get("name")): _body(link) for link in root.findall("link")}


def _body(link: ElementTree.Element) -> Body:
    mass, inertia = _inertia(link)
    return Body(mass, inertia, bool(_shapes(link)), lambda: float(np.prod(_box(link)[1])))


def _inertia(link: ElementTree.Element) -> tuple[float, np.ndarray]:
    mass, tensor = link.find("inertial/mass"), link.find("inertial/inertia")
    if mass is None or tensor is None:
        return 0.0, np.zeros((3, 3))
    words = [mass.get("value", "")] + [tensor.get(key, "") for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
    numbers = read_numbers(" ".join(words), 7)
    if numbers is None:
        return 0.0, np.zeros((3, 3))
    kg, xx, xy, xz, yy, yz, zz = numbers
    return float(kg), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _inertial(mass: float, center: np.ndarray, edges: np.ndarray) -> ElementTree.Element:
    inertial = ElementTree.Element("inertial")
    ElementTree.SubElement(inertial, "origin", {"xyz": " ".join(map(repr, center.tolist()))})
    ElementTree.SubElement(inertial, "mass", {"value": repr(mass)})
    moments = mass / 12 * (np.sum(edges**2) - edges**2)
    tensor = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    tensor |= {key: repr(float(moment)) for key, moment in zip(("ixx", "iyy", "izz"), moments, strict=True)}
    ElementTree.SubElement(inertial, "inertia", tensor)
    return inertial


def _box(link: ElementTree.Element) -> tuple[np.ndarray, np.ndarray]:
    """Centre and edges (3,) [m] of the axis-aligned box around a link's geometry, in the link frame."""
    corners = [points for shape in _shapes(link) for points in _corners(shape)]
    if corners:
        points = np.concatenate(corners)
        low, high = points.min(axis=0), points.max(axis=0)
        edges = high - low
        if edges.max() > 0:
            return (low + high) / 2, np.maximum(edges, _FLAT * edges.max())
    # The cube with the inertia of a ball: edge^2 / 6 = 2 / 5 radius^2.
    return np.zeros(3), np.full(3, BALL * np.sqrt(12 / 5))


def _shapes(link: ElementTree.Element) -> list[ElementTree.Element]:
    return link.findall("collision") or link.findall("visual")


def _corners(shape: ElementTree.Element) -> Iterator[np.ndarray]:
    """Corners (8, 3) [m] of the box around one geometry, in the link frame."""
    geometry = next((kind for kind in shape.findall("geometry/*")), None)
    bounds = None if geometry is None else _bounds(geometry)
    if bounds is None:
        return
    origin = shape.find("origin")
    numbers = {key: _vector(None if origin is None else origin.get(key)) for key in ("xyz", "rpy")}
    if any(each is None for each in numbers.values()):
        return
    corners = np.array(list(itertools.product(*zip(*bounds, strict=True))))
    yield corners @ pin.rpy.rpyToMatrix(numbers["rpy"]).T + numbers["xyz"]


def _bounds(geometry: ElementTree.Element) -> tuple[np.ndarray, np.ndarray] | None:
    """Lowest and highest coordinates (3,) of a geometry in its own frame, or None if it cannot be read."""
    if geometry.tag == "mesh":
        scale = _vector(geometry.get("scale"), 1.0)
        vertices = _vertices(geometry.get("filename", ""))
        if scale is None or vertices is None:
            return None
        scaled = vertices * scale
        return scaled.min(axis=0), scaled.max(axis=0)
    half: np.ndarray | None = None
    if geometry.tag == "box":
        size = _vector(geometry.get("size"))
        half = None if size is None else size / 2
    if geometry.tag in ("sphere", "cylinder"):
        radius, length = (read_number(geometry.get(key)) for key in ("radius", "length"))
        if radius is not None and geometry.tag == "sphere":
            half = np.full(3, radius)
        elif radius is not None and length is not None:
            half = np.array([radius, radius, length / 2])
    return None if half is None else (-half, half)


def _vertices(file: str) -> np.ndarray | None:
    if not Path(file).is_absolute():  # a relative path means that the file was not found
        return None
    try:
        return read_mesh(Path(file)).vertices
    except MeshError:
        return None


def _vector(text: str | None, default: float = 0.0) -> np.ndarray | None:
    return np.full(3, default) if text is None else read_numbers(text, 3)
