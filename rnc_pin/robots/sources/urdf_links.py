"""Links of a URDF: their meshes, boxes in place of missing meshes, and inertias, in the file or from a given mass.

A robot can be simulated without meshes, so missing meshes cause one warning and no error.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from copy import deepcopy
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, few, place_of, warn
from rnc_pin.robots import robot_files
from rnc_pin.robots.sources import description

STAND_IN = "_stand_in"
"""Suffix of the names of boxes that replace meshes; Pinocchio's own names of shapes end in a number."""

_GEOMETRY = {"visual": pin.GeometryType.VISUAL, "collision": pin.GeometryType.COLLISION}


class Meshes:
    """Geometry of a URDF, without missing meshes.

    Args:
        root: root element; names of files that are found become absolute paths.
        path: path of the file, for messages.
        packages: locations of packages, and folders whose files may be named.

    Attributes:
        lost: kind of geometry to the names of the meshes that ``geometry`` left out, by link.
    """

    def __init__(self, root: ElementTree.Element, path: Path, packages: robot_files.Packages) -> None:
        self._root, self._path = root, path
        self._missing: dict[str, str] = {}  # file name to its expected package or folder
        self.lost: dict[str, dict[str, tuple[str, ...]]] = {kind: {} for kind in _GEOMETRY}
        self._warned = False
        for element in root.iter():
            if element.tag not in ("mesh", "texture") or "filename" not in element.attrib:
                continue
            name = robot_files.package_uri(element.attrib["filename"])
            element.set("filename", name)
            found = packages.file(name)
            if found is not None:
                element.set("filename", str(found))
            elif element.tag == "mesh":
                self._missing[name] = self._home(name, packages)

    def geometry(self, model: pin.Model, kind: str) -> pin.GeometryModel:
        """Return the geometry of a kind, "visual" or "collision". Visual boxes replace links that lose all meshes.

        Args:
            model: Pinocchio model of the file.
            kind: "visual" or "collision".

        Raises:
            ModelError: a shape other than a mesh cannot be built.
        """
        from rnc_pin.robots.sources.mesh_formats import MeshShapes, read_mesh

        geometry, shapes, faults = self._build(model, kind), MeshShapes(), dict[str, str]()
        gone = self.lost[kind] = {}
        for link in self._root.findall("link"):
            name, drawn = str(link.get("name")), link.findall(kind)
            for number, mesh in enumerate(map(_mesh_of, drawn)):
                if mesh is None:
                    continue
                file, shape = mesh.get("filename", ""), f"{name}_{number}"  # Pinocchio's name
                try:
                    if file in self._missing:
                        raise ModelError("not found")
                    factors = description.check_numbers(mesh.get("scale", "1 1 1"), (3,), "scale")
                    placeholder = geometry.geometryObjects[geometry.getGeometryId(shape)]
                    shapes.put(placeholder, file, partial(read_mesh, Path(file)), factors, file)
                except ModelError as error:
                    faults[file] = str(error)
                    gone[name] = (*gone.get(name, ()), Path(file).name)
                    geometry.removeGeometryObject(shape)
            if kind == "visual" and drawn and len(gone.get(name, ())) == len(drawn):
                _stand_in(geometry, model, name, link)
        # Once for both kinds of geometry, which often name the same files.
        if faults and not self._warned:
            self._warned = True
            self._warn(faults)
        return geometry

    def _build(self, model: pin.Model, kind: str) -> pin.GeometryModel:
        """Build the geometry by Pinocchio, with a box in place of each mesh; Pinocchio's mesh loader is not used."""
        root = deepcopy(self._root)
        for mesh in [*root.iter("mesh")]:
            mesh.tag, mesh.attrib = "box", {"size": "1 1 1"}
        text = ElementTree.tostring(root, encoding="unicode")
        try:
            with description.captured_stderr():
                return pin.buildGeomFromUrdfString(model, text, _GEOMETRY[kind], None, [])  # file names are absolute
        except Exception as error:  # Boost.Python raises any type of C++ exception
            raise ModelError(f"{self._path}: geometry cannot be loaded: {description.brief(error)}") from None

    def _warn(self, faults: Mapping[str, str]) -> None:
        parts, missing = [], self._missing
        if faults.keys() & missing:
            homes = []
            for home, count in Counter(missing.values()).most_common():
                names = [Path(name).name for name, other in missing.items() if other == home]
                homes.append(f"{home} ({count})" if home.startswith("package") else f"{few(names)} in {home}")
            remedy = (
                "give the folder of packages with package_dirs (--package-dir, ROS_PACKAGE_PATH)"
                if any(home.startswith("package") for home in missing.values())
                else "put them there"
            )
            parts.append(f"{_meshes(len(missing))} not found: {few(homes, 6)}; {remedy}")
        why = [f"{Path(name).name} ({fault})" for name, fault in faults.items() if name not in missing]
        if why:
            parts.append(f"{_meshes(len(why))} not readable: {few(why)}")
        warn(f"{self._path}: {'; '.join(parts)}; boxes of the inertia's size stand in")

    def _home(self, name: str, packages: robot_files.Packages) -> str:
        """Folder where a file is expected, or its package if that is not found, in words."""
        scheme, separator, rest = name.partition("://")
        if separator and scheme in ("package", "model"):
            package, _, inside = rest.partition("/")
            folder = packages.folder(package)
            return f"package '{package}'" if folder is None else f"folder '{(folder / inside).parent}'"
        return f"folder '{(self._path.parent / (rest if separator else name)).parent}'"


def _meshes(count: int) -> str:
    return "1 mesh was" if count == 1 else f"{count} meshes were"


def _mesh_of(shape: ElementTree.Element) -> ElementTree.Element | None:
    """Return the ``<mesh>`` of a shape, or None. Urdfdom uses the first element of the geometry."""
    first = shape.find("geometry/*")
    return first if first is not None and first.tag == "mesh" else None


# ---------------------------------------------------------------------- stand-ins


def _stand_in(geometry: pin.GeometryModel, model: pin.Model, name: str, link: ElementTree.Element) -> None:
    """Add the solid box with the inertia of a link: about its size, where nothing else tells it.

    A link without mass has none. A box of very low density is reduced, and a flat box gets a minimum thickness.
    """
    mass, inertia = _inertia(link)
    placement = _pose(link.find("inertial/origin"))
    known = mass > 0 and np.isfinite(placement.homogeneous).all()
    if not known or not model.existFrame(name, pin.FrameType.BODY):
        return
    moments, axes = np.linalg.eigh(inertia)
    # eigh may return a mirrored basis, which is no rotation.
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1.0
    # Moments of a solid box are m/12 times sums of two squared sides: solved for the squares.
    squares = 6.0 * (moments.sum() - 2.0 * moments) / mass
    longest = float(np.sqrt(max(squares.max(), 1e-6)))
    least_side = 0.05  # of the longest side: a flat box would be invisible from its edge
    sides = np.maximum(np.sqrt(np.maximum(squares, 0.0)), least_side * longest)
    least_density = 30.0  # [kg/m^3]: many files give small links far too large inertias
    # The cube root keeps the form of the box.
    sides *= min(1.0, float(np.cbrt(mass / least_density / sides.prod())))
    index = model.getFrameId(name, pin.FrameType.BODY)
    frame = model.frames[index]
    place = frame.placement * placement * pin.SE3(axes, np.zeros(3))
    shape = pin.GeometryObject(name + STAND_IN, frame.parentJoint, index, place, coal.Box(*sides))
    shape.meshColor = np.array([0.55, 0.6, 0.66, 0.75])
    geometry.addGeometryObject(shape)


# ---------------------------------------------------------------------- inertias


BALL_RADIUS = 0.05  # radius [m] of the ball that represents a link without geometry


def give_masses(root: ElementTree.Element, masses: Mapping[str, float]) -> None:
    """Give masses to links without a valid inertia, with uniform density in the box around their geometry.

    The box encloses the collision geometry, or the visual geometry if there is none. Without readable geometry, the
    link is a ball of radius ``BALL_RADIUS``.

    Args:
        root: XML of the robot, with absolute paths of meshes.
        masses: link to mass [kg].

    Raises:
        ModelError: unknown link, a link with a valid inertia, or a mass that is not positive.
    """
    links = {str(link.get("name")): link for link in root.findall("link")}
    for name, mass in masses.items():
        place_of(str(name), links, "masses: no link", ModelError)
        if isinstance(mass, bool) or not isinstance(mass, int | float) or not 0 < mass < np.inf:
            raise ModelError(f"mass of link '{name}' has to be positive [kg], found {mass!r}")
        link = links[name]
        body = _body(link)
        if body.mass > 0 and np.linalg.eigvalsh(body.inertia)[0] > 0:
            raise ModelError(
                f"masses: link '{name}' has an inertia of its own ({body.mass:g} kg), and masses= is for links "
                f"without a useful one: robot.with_masses({{'{name}': {mass!r}}}) gives it another mass"
            )
        for inertial in link.findall("inertial"):
            link.remove(inertial)
        center, edges = _box(link)
        # A box with uniform density.
        moments = mass / 12 * (np.sum(edges**2) - edges**2)
        tensor = dict.fromkeys(_TENSOR, "0") | dict(zip(("ixx", "iyy", "izz"), map(str, moments.tolist()), strict=True))
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "origin", {"xyz": " ".join(map(str, center.tolist())), "rpy": "0 0 0"})
        ElementTree.SubElement(inertial, "mass", {"value": str(float(mass))})
        ElementTree.SubElement(inertial, "inertia", tensor)


def bodies_of(root: ElementTree.Element) -> dict[str, description.Body]:
    """Link name to its mass, inertia and geometry in the file.

    Args:
        root: root element of the URDF.
    """
    return {str(link.get("name")): _body(link) for link in root.findall("link")}


def _body(link: ElementTree.Element) -> description.Body:
    mass, inertia = _inertia(link)
    return description.Body(mass, inertia, bool(_shapes(link)), lambda: float(np.prod(_box(link)[1])))


def _inertia(link: ElementTree.Element) -> tuple[float, np.ndarray]:
    mass, tensor = link.find("inertial/mass"), link.find("inertial/inertia")
    if mass is None or tensor is None:
        return 0.0, np.zeros((3, 3))
    words = [mass.get("value", "")] + [tensor.get(key, "") for key in _TENSOR]
    numbers = description.read_numbers(" ".join(words), 7)
    if numbers is None:
        return 0.0, np.zeros((3, 3))
    kg, xx, xy, xz, yy, yz, zz = numbers
    return float(kg), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def _box(link: ElementTree.Element) -> tuple[np.ndarray, np.ndarray]:
    """Centre and edges (3,) [m] of the axis-aligned box around a link's geometry, in the link frame."""
    corners = np.array([_corners(shape) for shape in _shapes(link)]).reshape(-1, 3)
    points = corners[np.isfinite(corners).all(axis=1)]
    least_edge = 1e-2  # of the longest edge: a flat box would have a moment of inertia of zero
    if len(points) and np.ptp(points, axis=0).max() > 0:
        edges = np.ptp(points, axis=0)
        return (points.min(axis=0) + points.max(axis=0)) / 2, np.maximum(edges, least_edge * edges.max())
    # The cube with the inertia of a ball: edge^2 / 6 = 2 / 5 radius^2.
    return np.zeros(3), np.full(3, BALL_RADIUS * np.sqrt(12 / 5))


def _shapes(link: ElementTree.Element) -> list[ElementTree.Element]:
    return link.findall("collision") or link.findall("visual")


def _corners(shape: ElementTree.Element) -> np.ndarray:
    """Corners (8, 3) [m] of the box around one geometry, in the link frame; NaN if it cannot be read."""
    bounds, place = _bounds(shape.find("geometry/*")), _pose(shape.find("origin"))
    return np.array([*itertools.product(*bounds.T)]) @ place.rotation.T + place.translation


def _pose(origin: ElementTree.Element | None) -> pin.SE3:
    """Pose of an ``<origin>``, the identity if there is none; NaN if it cannot be read."""
    xyz, rpy = (_vector(None if origin is None else origin.get(key)) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _bounds(geometry: ElementTree.Element | None) -> np.ndarray:
    """Lowest and highest coordinates (2, 3) of a geometry in its own frame; NaN if it cannot be read."""
    from rnc_pin.robots.sources.mesh_formats import read_mesh

    half = np.full(3, np.nan)
    attributes = {} if geometry is None else geometry.attrib
    numbers = (description.read_number(attributes.get(key)) for key in ("radius", "length"))
    radius, length = (np.nan if number is None else number for number in numbers)
    match None if geometry is None else geometry.tag:
        case "mesh":
            file = Path(attributes.get("filename", ""))
            with suppress(ModelError):
                if file.is_absolute():  # a relative path means that the file was not found
                    vertices = read_mesh(file).vertices * _vector(attributes.get("scale"), 1.0)
                    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])
        case "box":
            half = _vector(attributes.get("size")) / 2
        case "sphere":
            half = np.full(3, radius)
        case "cylinder":
            half = np.array([radius, radius, length / 2])
    return np.stack([-half, half])


def _vector(text: str | None, default: float = 0.0) -> np.ndarray:
    numbers = np.full(3, default) if text is None else description.read_numbers(text, 3)
    return np.full(3, np.nan) if numbers is None else numbers
