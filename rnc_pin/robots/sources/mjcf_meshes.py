"""Meshes of MJCF: read by ``mesh_formats``; neither Pinocchio's parser nor MuJoCo opens mesh files."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, nearest
from rnc_pin.robots.sources.description import read_numbers
from rnc_pin.robots.sources.mesh_formats import (
    FARTHEST,
    Mesh,
    MeshError,
    check_thickness,
    checked_mesh,
    convex_hull,
    read_mesh,
)
from rnc_pin.robots.sources.mesh_shapes import MOST_TOGETHER, LoadedMesh, MeshShapes, put_in

_KEPT = ("name", "class", "scale", "refpos", "refquat", "inertia", "maxhullvert")
_SIZED = ("size", "fromto", "density", "mesh", "fitscale")


class MjcfMeshes:
    """Meshes of a file, removed from it. Pinocchio receives a ball without mass in place of each.

    Args:
        root: root element of the file, with explicit defaults and absolute mesh folder; changed in place.
        path: path of the file.
    """

    def __init__(self, root: ElementTree.Element, path: Path) -> None:
        compiler = root.find("compiler")
        settings = {} if compiler is None else compiler.attrib
        self._path, self._folder = path, Path(settings.get("meshdir", path.parent))
        self._stripped = settings.get("strippath") == "true"
        self._assets: dict[str, ElementTree.Element] = {}
        self._geoms: dict[str, str] = {}  # Pinocchio's name of a shape to the name of its mesh
        for assets in root.findall("asset"):
            for mesh in assets.findall("mesh"):
                self._assets[mesh_name(mesh)] = mesh
                assets.remove(mesh)
        for body in root.iter("body"):
            for k, geom in enumerate(body.findall("geom")):
                if geom.get("type") == "mesh":
                    self._geoms[geom.get("name") or f"{body.get('name')}Geom_{k}"] = geom.get("mesh", "")
        for geom in root.iter("geom"):
            if geom.get("type") == "mesh":
                for key in _SIZED:
                    geom.attrib.pop(key, None)
                geom.attrib.update(type="sphere", size="1", mass="0")

    def put_in(self, geometry: pin.GeometryModel) -> None:
        """Assign the meshes to the shapes of a geometry model.

        Raises:
            ModelError: unknown mesh, or a mesh that cannot be used.
        """
        shapes, read = MeshShapes(), dict[str, Mesh]()
        meshes: dict[str, LoadedMesh] = {}
        for shape in geometry.geometryObjects:
            name = self._geoms.get(shape.name)
            if name is None:
                continue
            asset = self._assets.get(name)
            if asset is None:
                raise ModelError(f'{self._path}: <geom mesh="{name}">: no such mesh{nearest(name, self._assets)}')
            try:
                meshes[shape.name] = self._load(name, asset, shapes, read)
            except MeshError as error:
                raise ModelError(f"{self._path}: mesh '{name}': {error}") from None
        put_in(geometry, meshes)

    def _load(self, name: str, asset: ElementTree.Element, shapes: MeshShapes, read: dict[str, Mesh]) -> LoadedMesh:
        file, scale = asset.get("file"), asset.get("scale")
        if file:
            return shapes.load(self._folder / (Path(file).name if self._stripped else file), scale)
        if name not in read:
            read[name] = _own_triangles(asset)
        return shapes.make(read[name], scale)


def mesh_name(mesh: ElementTree.Element) -> str:
    """Name of a mesh; by default the name of its file."""
    return mesh.get("name") or Path(mesh.get("file", "")).stem


def write_out(root: ElementTree.Element, path: Path) -> None:
    """Replace every mesh file by checked triangles, so that MuJoCo opens no file.

    Args:
        root: root element of a description with absolute mesh paths; changed in place.
        path: path of the description, for messages.

    Raises:
        ModelError: a mesh cannot be used.
    """
    count, flat = 0, set[str]()
    for mesh in root.findall("asset/mesh"):
        try:
            file = mesh.get("file")
            found = read_mesh(Path(file)) if file else _own_triangles(mesh)
            count += len(found.triangles)
            if count > MOST_TOGETHER:
                raise MeshError(f"more than {MOST_TOGETHER:,} triangles in the meshes of the robot")
            if _is_flat(found, read_numbers(mesh.get("scale", "1 1 1"))):
                flat.add(mesh_name(mesh))
        except MeshError as error:
            raise ModelError(f"{path}: mesh '{mesh_name(mesh)}': {error}") from None
        mesh.set("name", mesh_name(mesh))
        for key in set(mesh.attrib) - set(_KEPT):
            del mesh.attrib[key]
        mesh.set("vertex", " ".join(map(repr, found.vertices.ravel().tolist())))
        mesh.set("face", " ".join(map(str, found.triangles.ravel().tolist())))
    for geom in root.iter("geom"):
        if geom.get("mesh") in flat:  # MuJoCo builds convex hulls of colliding meshes; a flat mesh has none
            geom.attrib.update(contype="0", conaffinity="0")


def _is_flat(mesh: Mesh, scale: np.ndarray | None) -> bool:
    """True if a mesh is in a plane.

    Raises:
        MeshError: its scale is invalid.
    """
    if scale is None or scale.shape != (3,):
        raise MeshError("scale takes three numbers")
    with np.errstate(over="ignore", under="ignore"):
        vertices = mesh.vertices * scale
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > FARTHEST:
        raise MeshError(f"its scale puts vertices beyond {FARTHEST:g}")
    try:
        check_thickness(vertices.astype(np.float32).astype(float))  # the precision of MuJoCo
    except MeshError:
        return True
    return False


def _own_triangles(mesh: ElementTree.Element) -> Mesh:
    """Return the inline triangles of an element, or the convex hull if it has only points.

    Raises:
        MeshError: no points, or they are not well formed.
    """
    points = read_numbers(mesh.get("vertex", ""))
    corners = read_numbers(mesh.get("face", ""))
    if points is None or corners is None or points.size % 3 or corners.size % 3 or (corners % 1).any():
        raise MeshError("vertex and face take three numbers per entry")
    if not points.size:
        raise MeshError("has neither a file nor vertices")
    if not corners.size:
        return convex_hull(points)
    if np.abs(corners).max() > points.size:
        raise MeshError("a face has an unknown vertex")
    return checked_mesh(points, corners.astype(np.int64))
