"""Shapes and meshes of an MJCF. ``mesh_formats`` reads the files, so that MuJoCo opens none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.robots.sources.description import read_numbers
from rnc_pin.robots.sources.mesh_formats import (
    MOST_TOGETHER,
    LoadedMesh,
    Mesh,
    MeshError,
    MeshShapes,
    check_thickness,
    checked_mesh,
    convex_hull,
    read_mesh,
    scaled_vertices,
)
from rnc_pin.robots.sources.mjcf_model import ModelBuilder, pose

if TYPE_CHECKING:
    import mujoco

_KEPT = ("class", "scale", "inertia", "maxhullvert")
_STAND_IN = "100 100 100 100 -100 -100 -100 100 -100 -100 -100 100"  # corners of a tetrahedron
_MESH = 7  # type of a shape
_MOVED = {"refpos", "refquat"}
_USUAL = {"scale": "1 1 1", "refpos": "0 0 0", "refquat": "1 0 0 0"}


class MeshAssets:
    """Meshes of a file. MuJoCo is given a tetrahedron for each, and the triangles of those that have mass.

    Args:
        root: root element of the file, with absolute paths of meshes; changed in place.
        path: path of the file.

    Raises:
        ModelError: the scale of a mesh is not valid.
    """

    def __init__(self, root: ElementTree.Element, path: Path) -> None:
        self._path = path
        self._all_weigh = any(each.get("inertiafromgeom") == "true" for each in root.findall("compiler"))
        self._attributes: dict[str, dict[str, str]] = {}
        for mesh in root.findall("asset/mesh"):
            name = mesh.get("name") or Path(mesh.get("file", "")).stem
            if _numbers(mesh.attrib, "scale", 3) is None:
                raise ModelError(f"{path}: mesh '{name}': scale takes three numbers, found '{mesh.get('scale')}'")
            self._attributes[name] = dict(mesh.attrib)
            kept = {key: mesh.attrib[key] for key in _KEPT if key in mesh.attrib}
            mesh.attrib.clear()
            mesh.attrib.update(kept, name=name, vertex=_STAND_IN)

    def put_in(self, spec: mujoco.MjSpec) -> None:
        """Put triangles into a ``mujoco.MjSpec``, for the meshes that determine a mass or the size of a shape.

        Raises:
            ModelError: such a mesh cannot be used.
        """
        bodies = [body for body in spec.bodies if self._all_weigh or not body.explicitinertial]
        needed = {geom.meshname for body in bodies[1:] for geom in body.geoms}
        needed |= {geom.meshname for geom in spec.geoms if geom.type != _MESH}
        count, flat = 0, set[str]()
        for mesh in spec.meshes:
            if mesh.name not in needed:
                continue
            try:
                found = self._read(mesh.name)
                count += len(found.triangles)
                if count > MOST_TOGETHER:
                    raise MeshError(f"more than {MOST_TOGETHER:,} triangles in the meshes of the robot")
                if _is_flat(found, np.array(mesh.scale)):
                    flat.add(mesh.name)
            except MeshError as error:
                raise ModelError(f"{self._path}: mesh '{mesh.name}': {error}") from None
            mesh.uservert, mesh.userface = found.vertices.ravel(), found.triangles.ravel()
        for geom in spec.geoms:
            if geom.meshname in flat:  # MuJoCo builds convex hulls of colliding meshes; a flat mesh has none
                geom.contype = geom.conaffinity = 0

    def load(self, uses: Iterable[tuple[str, np.ndarray]]) -> Iterator[LoadedMesh]:
        """Yield the meshes of a robot, given by name and scale (3,).

        Raises:
            ModelError: a mesh cannot be used.
        """
        shapes, read = MeshShapes(), dict[str, Mesh]()
        for name, factors in uses:
            scale = " ".join(map(repr, factors.tolist()))
            attributes = self._attributes[name]
            try:
                if "file" in attributes and not _MOVED & set(attributes):
                    yield shapes.load(Path(attributes["file"]), scale)
                    continue
                if name not in read:
                    read[name] = self._read(name)
                yield shapes.make(read[name], scale)
            except MeshError as error:
                raise ModelError(f"{self._path}: mesh '{name}': {error}") from None

    def _read(self, name: str) -> Mesh:
        attributes = self._attributes[name]
        mesh = read_mesh(Path(attributes["file"])) if "file" in attributes else _inline_triangles(attributes)
        if not _MOVED & set(attributes):
            return mesh
        place, turn = _numbers(attributes, "refpos", 3), _numbers(attributes, "refquat", 4)
        if place is None or turn is None or not turn.any():
            raise MeshError("refpos takes three numbers, refquat four that are not all zero")
        rotation = pin.Quaternion(turn[0], *turn[1:]).normalized().matrix()
        return checked_mesh((mesh.vertices - place) @ rotation, mesh.triangles)


def _numbers(attributes: Mapping[str, str], key: str, count: int) -> np.ndarray | None:
    return read_numbers(attributes.get(key, _USUAL[key]), count)


def _is_flat(mesh: Mesh, scale: np.ndarray) -> bool:
    """True if a mesh is in a plane.

    Raises:
        MeshError: its scale puts vertices too far away.
    """
    vertices = scaled_vertices(mesh, scale)
    try:
        check_thickness(vertices.astype(np.float32).astype(float))  # the precision of MuJoCo
    except MeshError:
        return True
    return False


def _inline_triangles(attributes: Mapping[str, str]) -> Mesh:
    """Return the triangles in a description, or the convex hull if it has only points.

    Raises:
        MeshError: no points, or they are not well formed.
    """
    points = read_numbers(attributes.get("vertex", ""))
    corners = read_numbers(attributes.get("face", ""))
    if points is None or corners is None or points.size % 3 or corners.size % 3 or (corners % 1).any():
        raise MeshError("vertex and face take three numbers per entry")
    if not points.size:
        raise MeshError("has neither a file nor vertices")
    if not corners.size:
        return convex_hull(points)
    if np.abs(corners).max() > points.size:
        raise MeshError("a face has an unknown vertex")
    return checked_mesh(points, corners.astype(np.int64))


# ---------------------------------------------------------------------- shapes


_SHAPES = {
    2: lambda size: coal.Sphere(size[0]),
    3: lambda size: coal.Capsule(size[0], 2 * size[1]),
    4: lambda size: coal.Ellipsoid(size),
    5: lambda size: coal.Cylinder(size[0], 2 * size[1]),
    6: lambda size: coal.Box(2 * size),
}
_COLLISION_ONLY = 3  # groups from here on are not drawn if they collide, as Pinocchio has it


class _Shape(NamedTuple):
    """Shape of a body; ``mesh`` and ``scale`` are those of a mesh."""

    name: str
    kinds: tuple[str, ...]
    joint: int
    frame: int
    placement: pin.SE3
    type: int
    size: np.ndarray
    color: np.ndarray
    mesh: str
    scale: np.ndarray


class MjcfGeometry:
    """Function for the geometry of a kind, "visual" or "collision". It reads meshes when it is called.

    An infinite floor is not part of the robot.

    Args:
        compiled: the ``mujoco.MjModel``.
        built: the model.
        assets: meshes of the file.
    """

    def __init__(self, compiled: mujoco.MjModel, built: ModelBuilder, assets: MeshAssets) -> None:
        self._assets = assets
        known = [k for k in range(compiled.ngeom) if compiled.geom_type[k] in (*_SHAPES, _MESH)]
        self._shapes = [_read(compiled, k, built) for k in known]

    def __call__(self, kind: str) -> pin.GeometryModel:
        """Return the geometry.

        Raises:
            ModelError: a mesh cannot be used.
        """
        geometry, shapes = pin.GeometryModel(), [each for each in self._shapes if kind in each.kinds]
        meshes = self._assets.load([(each.mesh, each.scale) for each in shapes if each.type == _MESH])
        for each in shapes:
            if each.type == _MESH:
                file, scale, shape = next(meshes)
            else:
                shape, scale = _SHAPES[each.type](each.size), np.ones(3)
                file = type(shape).__name__.upper()  # as Pinocchio names them
            geometry.addGeometryObject(
                pin.GeometryObject(
                    each.name, each.joint, each.frame, each.placement, shape, file, scale, False, each.color
                )
            )
        return geometry


def _read(compiled: mujoco.MjModel, k: int, built: ModelBuilder) -> _Shape:
    body, mesh = compiled.geom_bodyid[k], int(compiled.geom_dataid[k])
    carrier = built.carriers[body]
    place = carrier.placement * pose(compiled.geom_pos[k], compiled.geom_quat[k])
    if compiled.geom_type[k] == _MESH:  # MuJoCo rotates meshes to their principal axes
        place = place * pose(compiled.mesh_pos[mesh], compiled.mesh_quat[mesh]).inverse()
    kinds = ("visual", "collision") if compiled.geom_group[k] < _COLLISION_ONLY else ("collision",)
    if not (compiled.geom_contype[k] or compiled.geom_conaffinity[k]):
        kinds = ("visual",)
    material = compiled.geom_matid[k]
    color = compiled.geom_rgba[k] if material < 0 else compiled.mat_rgba[material]
    is_mesh = compiled.geom_type[k] == _MESH
    return _Shape(
        compiled.geom(k).name or f"{'world' if body == 0 else carrier.name}Geom_{k - compiled.body_geomadr[body]}",
        kinds,
        carrier.joint,
        carrier.frame,
        place,
        int(compiled.geom_type[k]),
        np.array(compiled.geom_size[k]),
        np.round(color.astype(float), 6),
        compiled.mesh(mesh).name if is_mesh else "",
        np.array(compiled.mesh_scale[mesh]) if is_mesh else np.ones(3),
    )
