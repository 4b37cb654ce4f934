"""Obstacles in a scenario file."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import coal
import numpy as np
from pydantic import Field

from rnc_pin.applications.scenario.schema.base import Positive, Strict
from rnc_pin.applications.scenario.schema.derived import Entry, one_of
from rnc_pin.applications.scenario.schema.reference_settings import ReferenceItem
from rnc_pin.collision import Obstacle, ground_shape, load_cells, load_map, load_mesh_shape
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model import Coordinates

_Three = Annotated[list[float], Field(min_length=3, max_length=3)]
_Sides = Annotated[list[Positive], Field(min_length=3, max_length=3)]
_OBSTACLE = Entry(Obstacle, late=("shape", "name", "motion"), forms={"position": _Three})
_MESH = Entry(load_mesh_shape, late=("path",), forms={"scale": float | _Three})


class _Placed(_OBSTACLE.model):  # type: ignore[name-defined, misc]
    name: str | None = None
    """Unique name; by default the shape and its number, such as ``box 1``."""
    motion: ReferenceItem | None = None
    """Motion of x, y, z [m] and yaw [rad], from ``position`` and ``yaw``; at rest by default."""

    @abstractmethod
    def shape(self, folder: Path) -> coal.CollisionGeometry: ...

    def build_all(self, folder: Path, default_name: str) -> Sequence[Obstacle]:
        return (self.build(folder, default_name),)

    def build(self, folder: Path, default_name: str) -> Obstacle:
        name = self.name or default_name
        start = np.array([*self.position, self.yaw])
        places = Coordinates([False, False, False, True], names=["x", "y", "z", "yaw"])
        try:
            motion = None if self.motion is None else self.motion.from_start(start, places)
            return _OBSTACLE.build(self, shape=self.shape(folder), name=name, motion=motion)
        except RncError as error:
            raise ConfigurationError(f"obstacle '{name}': {error}") from None


class BoxObstacle(_Placed):
    """Box."""

    size: _Sides
    """Length of the sides along x, y and z [m]."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Box(*self.size)


class SphereObstacle(_Placed):
    """Sphere."""

    radius: Positive
    """Radius [m]."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Sphere(self.radius)


class CylinderObstacle(SphereObstacle):
    """Cylinder along z."""

    length: Positive
    """Length along z [m]."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Cylinder(self.radius, self.length)


class CapsuleObstacle(SphereObstacle):
    """Capsule along z: a cylinder with a half sphere at each end."""

    length: Positive
    """Length of the cylindrical part along z [m]."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Capsule(self.radius, self.length)


class MeshObstacle(_Placed, _MESH.model):  # type: ignore[name-defined, misc]
    """Convex hull of a mesh."""

    file: str
    """Mesh file, relative to the scenario file; its convex hull is the obstacle."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return _MESH.build(self, path=folder / self.file)


class GroundObstacle(_Placed):
    """Floor: the half space below the plane through ``position``, horizontal without ``roll`` and ``pitch``."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return ground_shape()


class MapObstacle(Strict):
    """Occupied cells of a map of ROS navigation, as boxes."""

    file: str
    """YAML file of the map, relative to the scenario file."""
    name: str | None = None
    """Unique name; its boxes are numbered. By default "map" and its number."""
    height: Positive = 2.0
    """Height of the boxes, which stand on the ground [m]."""
    unknown: bool = False
    """True if unknown cells are obstacles too."""
    cells: Annotated[int, Field(ge=1)] = 1
    """Side of the squares of cells that count as one, which is occupied if any of its cells is."""

    def build_all(self, folder: Path, default_name: str) -> Sequence[Obstacle]:
        name = self.name or default_name
        try:
            return load_map(folder / self.file, name).obstacles(self.height, self.unknown, self.cells)
        except RncError as error:
            raise ConfigurationError(f"obstacle '{name}': {error}") from None


class CellsObstacle(Strict):
    """Cubes around the points of a cloud, or around the surface of a mesh of any form, merged into boxes."""

    file: str
    """Cloud (.pcd, .ply, .xyz) or mesh, relative to the scenario file."""
    side: Positive
    """Side of the cubes [m]."""
    scale: Positive = 1.0
    """Factor of the coordinates."""
    name: str | None = None
    """Unique name; its boxes are numbered. By default "cells" and its number."""
    position: _Three = [0.0, 0.0, 0.0]
    """Origin of the file's frame in the world [m]."""
    yaw: float = 0.0
    """Rotation of the file's frame about the world's z [rad], after roll and pitch."""
    roll: float = 0.0
    """Rotation about x [rad]."""
    pitch: float = 0.0
    """Rotation about y [rad]."""

    def build_all(self, folder: Path, default_name: str) -> Sequence[Obstacle]:
        name = self.name or default_name
        try:
            cells = load_cells(folder / self.file, self.side, self.scale, name)
            return cells.obstacles(self.position, self.yaw, self.roll, self.pitch)
        except RncError as error:
            raise ConfigurationError(f"obstacle '{name}': {error}") from None


ObstacleItem = Annotated[
    _Placed | MapObstacle | CellsObstacle,
    one_of(
        box=BoxObstacle,
        sphere=SphereObstacle,
        cylinder=CylinderObstacle,
        capsule=CapsuleObstacle,
        mesh=MeshObstacle,
        ground=GroundObstacle,
        map=MapObstacle,
        cells=CellsObstacle,
    ),
]


def build_obstacles(items: Sequence[_Placed | MapObstacle | CellsObstacle], folder: Path) -> tuple[Obstacle, ...]:
    """Build the obstacles of a scenario. Paths are relative to ``folder``.

    Raises:
        ConfigurationError: a mesh or a motion cannot be used, or two obstacles share a name.
    """
    found: list[Obstacle] = []
    for number, item in enumerate(items, start=1):
        kind = type(item).__name__.removesuffix("Obstacle").lower()
        known = {each.name for each in found}
        for obstacle in item.build_all(folder, f"{kind} {number}"):
            if obstacle.name in known:
                raise ConfigurationError(f"obstacles: two are named '{obstacle.name}'")
            found.append(obstacle)
    return tuple(found)
