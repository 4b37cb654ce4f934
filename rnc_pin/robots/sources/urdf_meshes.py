"""Meshes of a URDF: search, report of missing ones, and boxes for links that lose all their meshes.

A robot can be simulated without meshes, so missing meshes cause one warning and no error.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, ModelWarning, few
from rnc_pin.robots.sources.description import GEOMETRY, geometry_errors
from rnc_pin.robots.sources.mesh_formats import MeshError
from rnc_pin.robots.sources.mesh_shapes import LoadedMesh, MeshShapes, put_in
from rnc_pin.robots.sources.numeric_checks import read_numbers
from rnc_pin.robots.sources.packages import Packages, package_uri

STAND_IN = "_stand_in"
"""Suffix of the names of boxes that replace meshes; Pinocchio's own names of shapes end in a number."""

_LIGHTEST = 30.0  # [kg/m^3] least density of a box: many files give small links far too large inertias
_THINNEST = 0.05  # shortest side, relative to the longest side
_COLOR = np.array([0.55, 0.6, 0.66, 0.75])


class Meshes:
    """Geometry of a URDF, without missing meshes.

    Args:
        root: root element; names of files that are found become absolute paths.
        path: path of the file, for messages.
        packages: locations of packages, and folders whose files may be named.
    """

    def __init__(self, root: ElementTree.Element, path: Path, packages: Packages) -> None:
        self._root, self._path = root, path
        self._missing: dict[str, str] = {}  # file name to its expected package or folder
        self._lost: dict[str, dict[str, tuple[str, ...]]] = {kind: {} for kind in GEOMETRY}
        self._warned = False
        for element in root.iter():
            if element.tag not in ("mesh", "texture") or "filename" not in element.attrib:
                continue
            name = package_uri(element.attrib["filename"])
            element.set("filename", name)
            try:
                found = packages.file(name)
            except ModelError as error:
                raise ModelError(f"{path}: {error}") from None
            if found is not None:
                element.set("filename", str(found))
            elif element.tag == "mesh":
                self._missing[name] = self._home(name)

    def geometry(self, model: pin.Model, kind: str) -> pin.GeometryModel:
        """Return the geometry of a kind, "visual" or "collision". Visual boxes replace links that lose all meshes.

        Raises:
            ModelError: a shape other than a mesh cannot be built.
        """
        root = deepcopy(self._root)
        missing, faults = dict[str, str](), dict[str, str]()
        shapes, bare = MeshShapes(), dict[str, ElementTree.Element]()
        loaded: dict[str, LoadedMesh] = {}
        gone: dict[str, tuple[str, ...]] = {}
        for link in root.findall("link"):
            name, kept = str(link.get("name")), 0
            for shape in link.findall(kind):
                mesh = _mesh_of(shape)
                found = None if mesh is None else self._load(mesh, shapes, missing, faults)
                if mesh is not None and found is None:
                    link.remove(shape)
                    gone[name] = (*gone.get(name, ()), Path(mesh.get("filename", "")).name)
                    continue
                if found is not None:
                    loaded[f"{name}_{kept}"] = found  # Pinocchio's name
                kept += 1
            if name in gone and not kept:
                bare[name] = link
        self._lost[kind] = gone
        geometry = self._build(model, root, kind)
        put_in(geometry, loaded)
        if kind == "visual":
            for name, link in bare.items():
                _stand_in(geometry, model, name, link)
        if (missing or faults) and not self._warned:
            self._warned = True
            self._warn(missing, faults)
        return geometry

    def lost(self, kind: str) -> Mapping[str, tuple[str, ...]]:
        """Names of the meshes that ``geometry`` of a kind left out, by link."""
        return self._lost[kind]

    def _load(
        self, mesh: ElementTree.Element, shapes: MeshShapes, missing: dict[str, str], faults: dict[str, str]
    ) -> LoadedMesh | None:
        """Return the shape of a ``<mesh>``, or None if it is missing or cannot be used."""
        name = mesh.get("filename", "")
        if name in self._missing:
            missing[name] = self._missing[name]
            return None
        try:
            return shapes.load(Path(name), mesh.get("scale"))
        except MeshError as error:
            faults[name] = str(error)
        return None

    def _build(self, model: pin.Model, root: ElementTree.Element, kind: str) -> pin.GeometryModel:
        """Build the geometry by Pinocchio, with a box in place of each mesh; Pinocchio's mesh loader is not used."""
        for parent in root.iter():
            for place, mesh in enumerate(parent):
                if mesh.tag == "mesh":
                    parent[place] = ElementTree.Element("box", size="1 1 1")
        text = ElementTree.tostring(root, encoding="unicode")
        with geometry_errors(self._path):
            return pin.buildGeomFromUrdfString(model, text, GEOMETRY[kind], None, [])  # file names are absolute

    def _warn(self, missing: Mapping[str, str], faults: Mapping[str, str]) -> None:
        parts = []
        if missing:
            homes = [f"{home} ({count})" for home, count in Counter(missing.values()).most_common()]
            remedy = (
                "give the folder of packages with package_dirs (--package-dir, ROS_PACKAGE_PATH)"
                if any(home.startswith("package") for home in missing.values())
                else "put them there"
            )
            parts.append(f"{_meshes(len(missing))} not found: {few(homes, 6)}; {remedy}")
        if faults:
            why = [f"{Path(name).name} ({fault})" for name, fault in faults.items()]
            parts.append(f"{_meshes(len(faults))} not readable: {few(why)}")
        text = f"{self._path}: {'; '.join(parts)}; boxes of the inertia's size stand in"
        warnings.warn(text, ModelWarning, stacklevel=6)

    def _home(self, name: str) -> str:
        """Package or folder where a file is expected, in words."""
        scheme, separator, rest = name.partition("://")
        if separator and scheme in ("package", "model"):
            return f"package '{rest.partition('/')[0]}'"
        return f"folder '{(self._path.parent / (rest if separator else name)).parent}'"


def _meshes(count: int) -> str:
    return "1 mesh was" if count == 1 else f"{count} meshes were"


def _mesh_of(shape: ElementTree.Element) -> ElementTree.Element | None:
    """Return the ``<mesh>`` of a shape, or None. Urdfdom uses the first element of the geometry."""
    geometry = shape.find("geometry")
    first = None if geometry is None else next(iter(geometry), None)
    return first if first is not None and first.tag == "mesh" else None


# ---------------------------------------------------------------------- stand-ins


def _stand_in(geometry: pin.GeometryModel, model: pin.Model, name: str, link: ElementTree.Element) -> None:
    box = equivalent_box(link)
    if box is None or not model.existFrame(name, pin.FrameType.BODY):
        return
    sides, placement = box
    index = model.getFrameId(name, pin.FrameType.BODY)
    frame = model.frames[index]
    shape = pin.GeometryObject(name + STAND_IN, frame.parentJoint, index, frame.placement * placement, coal.Box(*sides))
    shape.meshColor = _COLOR
    geometry.addGeometryObject(shape)


def equivalent_box(link: ElementTree.Element) -> tuple[np.ndarray, pin.SE3] | None:
    """Return the solid box with the inertia of a ``<link>``: sides (3,) [m] and its pose in the link frame.

    None if the link has no mass. A box of very low density is reduced, and a flat box gets a minimum thickness.
    """
    mass = _attribute(link.find("inertial/mass"), "value", 1)
    if mass is None or mass[0] <= 0:
        return None
    element = link.find("inertial/inertia")
    entries = {key: _attribute(element, key, 1) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
    xx, yy, zz, xy, xz, yz = (0.0 if entry is None else float(entry[0]) for entry in entries.values())
    moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1.0
    squares = 6.0 * (moments.sum() - 2.0 * moments) / mass[0]
    longest = float(np.sqrt(max(squares.max(), 1e-6)))
    sides = np.maximum(np.sqrt(np.maximum(squares, 0.0)), _THINNEST * longest)
    sides *= min(1.0, float(np.cbrt(mass[0] / _LIGHTEST / sides.prod())))
    origin = link.find("inertial/origin")
    xyz, rpy = (_attribute(origin, key, 3) for key in ("xyz", "rpy"))
    turn = np.eye(3) if rpy is None else pin.rpy.rpyToMatrix(*rpy)
    return sides, pin.SE3(turn @ axes, np.zeros(3) if xyz is None else xyz)


def _attribute(element: ElementTree.Element | None, key: str, count: int) -> np.ndarray | None:
    return None if element is None else read_numbers(element.get(key), count)
