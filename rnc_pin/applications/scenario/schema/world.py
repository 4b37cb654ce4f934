"""Robot and obstacles of a scenario file."""

from __future__ import annotations

import os.path
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

import coal
import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from rnc_pin.applications.scenario.schema.derived import Entry, one_of
from rnc_pin.applications.scenario.schema.motions import ReferenceItem
from rnc_pin.collision import Obstacle, ground_shape, load_map, load_mesh_shape
from rnc_pin.errors import ConfigurationError, RncError, place_of
from rnc_pin.io import Json, Strict
from rnc_pin.model import Coordinates, NotNegative, Positive
from rnc_pin.robots import Robot, find_mjcf, find_shipped, find_urdf

_Three = Annotated[list[float], Field(min_length=3, max_length=3)]


class Attachment(Strict):
    """Robot with a fixed base, mounted on a frame of another robot."""

    robot: RobotSource
    """The mounted robot."""
    frame: str
    """Frame of the carrying robot."""
    xyz: _Three = [0.0, 0.0, 0.0]
    """Position of the base of the mounted robot in that frame [m]."""
    rpy: _Three = [0.0, 0.0, 0.0]
    """Roll, pitch and yaw of the base of the mounted robot in that frame [rad]."""


class RobotSource(Strict):
    """Source of the robot: one of ``urdf``, ``mjcf`` and ``example``."""

    urdf: str | None = None
    """URDF or xacro file, relative to the scenario file, or the name of a file that rnc_pin contains."""
    mjcf: str | None = None
    """MJCF file, relative to the scenario file."""
    example: str | None = None
    """Name of a robot of example-robot-data."""
    base: Literal["fixed", "planar", "free"] = "fixed"
    """Joint between the root link and the world. For an MJCF file the default is the base in the file."""
    package_dirs: list[str] = []
    """Further folders of files and packages that the robot's file may use, relative to the scenario file."""
    xacro_arguments: dict[str, str | float | bool] = {}
    """Arguments of a xacro file: name to value."""
    lock: dict[str, float | list[float]] = {}
    """Joints to lock: name to position [rad or m]."""
    masses: dict[str, float] = {}
    """Masses of links without a valid inertia: name to mass [kg], distributed over the geometry of the link."""
    armature: dict[str, NotNegative] = {}
    """Rotor inertia by joint, times the square of its gear ratio [kg m^2 or kg]; it replaces that of the file."""
    snap: bool = True
    """True to correct rounded angles and axes of joints in the file to their exact values."""
    gravity: _Three | None = None
    """Gravity vector in the world frame [m/s^2]."""

    attach: list[Attachment] = []
    """Robots mounted on this one."""

    @model_validator(mode="after")
    def _one_source(self) -> RobotSource:
        if [self.urdf, self.mjcf, self.example].count(None) != 2:
            raise ValueError("expected one of 'urdf', 'mjcf' and 'example'")
        if self.xacro_arguments and self.urdf is None:
            raise ValueError("'xacro_arguments' belongs to 'urdf'")
        if self.package_dirs and self.example is not None:
            raise ValueError("'package_dirs' belongs to 'urdf' and 'mjcf'")
        if self.masses and self.mjcf is not None:
            raise ValueError("'masses' belongs to 'urdf' and 'example'")
        return self

    def build(self, folder: Path) -> Robot:
        robot = self._alone(folder)
        for name, inertia in self.armature.items():
            robot.model.armature[place_of(name, robot.velocity_names, "armature: no joint")] = inertia
        for each in self.attach:
            turn = pin.rpy.rpyToMatrix(np.array(each.rpy))
            robot = robot.attach(each.robot.build(folder), each.frame, pin.SE3(turn, np.array(each.xyz)))
        return robot

    def _alone(self, folder: Path) -> Robot:
        lock, snap, masses = self.lock or None, self.snap, self.masses
        packages = [folder / each for each in self.package_dirs]
        if self.example is not None:
            return Robot.from_example(self.example, self.base, lock, self.gravity, snap=snap, masses=masses)
        if self.mjcf is not None:
            base = self.base if "base" in self.model_fields_set else None
            path = find_mjcf(self.mjcf, folder)
            return Robot.from_mjcf(path, base, lock, self.gravity, package_dirs=packages, snap=snap)
        assert self.urdf is not None
        arguments = self.xacro_arguments or None
        path = find_urdf(self.urdf, folder)
        return Robot.from_urdf(path, self.base, packages, lock, self.gravity, arguments, snap=snap, masses=masses)


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

    def build(self, folder: Path, name: str) -> Sequence[Obstacle]:
        start = np.array([*self.position, self.yaw])
        places = Coordinates([False, False, False, True], names=["x", "y", "z", "yaw"])
        motion = None if self.motion is None else self.motion.from_start(start, places)
        return (_OBSTACLE.build(self, shape=self.shape(folder), name=name, motion=motion),)


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
    """YAML file of the map, relative to the scenario file; or a map of the package: warehouse.yaml."""
    name: str | None = None
    """Unique name; its boxes are numbered. By default "map" and its number."""
    height: Positive = 2.0
    """Height of the boxes, which stand on the ground [m]."""
    unknown: bool = False
    """True if unknown cells are obstacles too."""
    cells: Annotated[int, Field(ge=1)] = 1
    """Side of the squares of cells that count as one, which is occupied if any of its cells is."""

    def build(self, folder: Path, name: str) -> Sequence[Obstacle]:
        return load_map(find_shipped(self.file, folder), name).obstacles(self.height, self.unknown, self.cells)


ObstacleItem = Annotated[
    _Placed | MapObstacle,
    one_of(
        box=BoxObstacle,
        sphere=SphereObstacle,
        cylinder=CylinderObstacle,
        capsule=CapsuleObstacle,
        mesh=MeshObstacle,
        ground=GroundObstacle,
        map=MapObstacle,
    ),
]


def absolute_files(raw: Mapping[str, Json], folder: Path, keys: Sequence[str] = ("csv", "file")) -> dict[str, Json]:
    """Return a part of a scenario with absolute paths of the files that it names. Files that are not there stay.

    Args:
        raw: the part.
        folder: folder that the paths are relative to.
        keys: keys of files.
    """

    def absolute(key: str, value: Json) -> Json:
        if isinstance(value, Mapping):
            return absolute_files(value, folder, keys)
        if isinstance(value, list):
            return [absolute(key, each) for each in value]
        named = key in keys and isinstance(value, str) and os.path.isfile(folder / value)
        return str((folder / str(value)).resolve()) if named else value

    return {key: absolute(key, value) for key, value in raw.items()}


def build_obstacles(items: Sequence[_Placed | MapObstacle], folder: Path) -> tuple[Obstacle, ...]:
    """Build the obstacles of a scenario. Paths are relative to ``folder``.

    Raises:
        ConfigurationError: a mesh or a motion cannot be used, or two obstacles share a name.
    """
    found: list[Obstacle] = []
    for number, item in enumerate(items, start=1):
        name = item.name or f"{type(item).__name__.removesuffix('Obstacle').lower()} {number}"
        known = {each.name for each in found}
        try:
            built = item.build(folder, name)
        except RncError as error:
            raise ConfigurationError(f"obstacle '{name}': {error}") from None
        for obstacle in built:
            if obstacle.name in known:
                raise ConfigurationError(f"obstacles: two are named '{obstacle.name}'")
            found.append(obstacle)
    return tuple(found)
