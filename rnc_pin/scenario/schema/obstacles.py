"""Obstacles in a scenario file."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import coal
import numpy as np
from pydantic import Field, Tag

from rnc_pin.collision import Obstacle, ground_shape, load_mesh_shape
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.scenario.schema.base import BY_KIND, Positive, Strict
from rnc_pin.scenario.schema.reference_settings import ReferenceItem

_Three = Annotated[list[float], Field(min_length=3, max_length=3)]
_Sides = Annotated[list[Positive], Field(min_length=3, max_length=3)]


class _ObstacleArguments(Strict):
    name: str | None = None
    """Unique name; by default the shape and its number, such as ``box 1``."""
    position: _Three = [0.0, 0.0, 0.0]
    """Position of the middle of the shape in the world [m]; of a mesh, of its file's origin; of a floor, of a point."""
    yaw: float = 0.0
    """Rotation about the world's z [rad], after roll and pitch."""
    roll: float = 0.0
    """Rotation about x [rad]."""
    pitch: float = 0.0
    """Rotation about y [rad]."""
    motion: ReferenceItem | None = None
    """Motion of x, y, z [m] and yaw [rad], from ``position`` and ``yaw``; at rest by default."""
    ignored_links: list[str] = []
    """Links whose distances to the obstacle do not matter, such as wheels on a floor."""

    @abstractmethod
    def shape(self, folder: Path) -> coal.CollisionGeometry: ...

    def build(self, folder: Path, default_name: str) -> Obstacle:
        name = self.name or default_name
        start = np.array([*self.position, self.yaw])
        try:
            motion = None if self.motion is None else self.motion.build(start, Coordinates([False, False, False, True]))
            angles = self.yaw, self.roll, self.pitch
            return Obstacle(self.shape(folder), self.position, *angles, name, motion, tuple(self.ignored_links))
        except RncError as error:
            raise ConfigurationError(f"obstacle '{name}': {error}") from None


class _BoxArguments(_ObstacleArguments):
    size: _Sides
    """Length of the sides along x, y and z [m]."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Box(*self.size)


class _SphereArguments(_ObstacleArguments):
    radius: Positive
    """Radius [m]."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Sphere(self.radius)


class _CylinderArguments(_SphereArguments):
    length: Positive
    """Length along z [m]."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Cylinder(self.radius, self.length)


class _CapsuleArguments(_SphereArguments):
    length: Positive
    """Length of the cylindrical part along z [m]."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Capsule(self.radius, self.length)


class _MeshArguments(_ObstacleArguments):
    file: str
    """Mesh file, relative to the scenario file; its convex hull is the obstacle."""
    scale: float | _Three = 1.0
    """Factor or three factors of its coordinates."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return load_mesh_shape(folder / self.file, self.scale)


class _GroundArguments(_ObstacleArguments):
    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return ground_shape()


class BoxObstacle(Strict):
    """Box."""

    box: _BoxArguments


class SphereObstacle(Strict):
    """Sphere."""

    sphere: _SphereArguments


class CylinderObstacle(Strict):
    """Cylinder along z."""

    cylinder: _CylinderArguments


class CapsuleObstacle(Strict):
    """Capsule along z: a cylinder with a half sphere at each end."""

    capsule: _CapsuleArguments


class MeshObstacle(Strict):
    """Convex hull of a mesh."""

    mesh: _MeshArguments


class GroundObstacle(Strict):
    """Floor: the half space below the plane through ``position``, horizontal without ``roll`` and ``pitch``."""

    ground: _GroundArguments


ObstacleItem = Annotated[
    Annotated[BoxObstacle, Tag("box")]
    | Annotated[SphereObstacle, Tag("sphere")]
    | Annotated[CylinderObstacle, Tag("cylinder")]
    | Annotated[CapsuleObstacle, Tag("capsule")]
    | Annotated[MeshObstacle, Tag("mesh")]
    | Annotated[GroundObstacle, Tag("ground")],
    BY_KIND,
]


def build_obstacles(items: Sequence[Strict], folder: Path) -> tuple[Obstacle, ...]:
    """Build the obstacles of a scenario. Paths are relative to ``folder``.

    Raises:
        ConfigurationError: a mesh or a motion cannot be used, or two obstacles share a name.
    """
    found: list[Obstacle] = []
    for number, item in enumerate(items, start=1):
        (kind,) = type(item).model_fields
        arguments: _ObstacleArguments = getattr(item, kind)
        obstacle = arguments.build(folder, f"{kind} {number}")
        if any(obstacle.name == each.name for each in found):
            raise ConfigurationError(f"obstacles: two are named '{obstacle.name}'")
        found.append(obstacle)
    return tuple(found)
