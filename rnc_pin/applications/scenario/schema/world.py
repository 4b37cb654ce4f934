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

from rnc_pin.applications.scenario.schema.derived import one_of
from rnc_pin.applications.scenario.schema.motions import ReferenceItem
from rnc_pin.collision import Obstacle, ground_shape, load_map, load_mesh_shape
from rnc_pin.errors import RncError, check_unique, place_of
from rnc_pin.io import Json, Strict
from rnc_pin.model import Coordinates, NotNegative, Positive
from rnc_pin.robots import Robot, find_mjcf, find_shipped, find_urdf

_Three = Annotated[list[float], Field(min_length=3, max_length=3)]


class Attachment(Strict):
    """Robot with a fixed base, mounted on a frame of another robot.

    Attributes:
        robot: the mounted robot.
        frame: frame of the carrying robot.
        xyz: position of the base of the mounted robot in that frame [m].
        rpy: roll, pitch and yaw of the base of the mounted robot in that frame [rad].
    """

    robot: RobotSource
    frame: str
    xyz: _Three = [0.0, 0.0, 0.0]
    rpy: _Three = [0.0, 0.0, 0.0]


class RobotSource(Strict):
    """Source of the robot: one of ``urdf``, ``mjcf`` and ``example``.

    Attributes:
        urdf: URDF or xacro file, relative to the scenario file, or the name of a file that rnc_pin contains.
        mjcf: MJCF file, relative to the scenario file.
        example: name of a robot of example-robot-data.
        base: joint between the root link and the world. For an MJCF file the default is the base in the file.
        package_dirs: further folders of files and packages that the robot's file may use, relative to the scenario
            file.
        xacro_arguments: arguments of a xacro file: name to value.
        lock: joints to lock: name to position [rad or m].
        masses: masses of links without a valid inertia: name to mass [kg], distributed over the geometry of the link.
        armature: rotor inertia by joint, times the square of its gear ratio [kg m^2 or kg]; it replaces the file's.
        snap: True to correct rounded angles and axes of joints in the file to their exact values.
        gravity: gravity vector in the world frame [m/s^2].
        attach: robots mounted on this one.
    """

    urdf: str | None = None
    mjcf: str | None = None
    example: str | None = None
    base: Literal["fixed", "planar", "free"] = "fixed"
    package_dirs: list[str] = []
    xacro_arguments: dict[str, str | float | bool] = {}
    lock: dict[str, float | list[float]] = {}
    masses: dict[str, float] = {}
    armature: dict[str, NotNegative] = {}
    snap: bool = True
    gravity: _Three | None = None

    attach: list[Attachment] = []

    @model_validator(mode="after")
    def _one_source(self) -> RobotSource:
        # Settings without effect are refused: a user would look for it.
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
        # Before others are mounted: their joints have names and armatures of their own.
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
            base = self.base if "base" in self.model_fields_set else None  # an MJCF states its base
            path = find_mjcf(self.mjcf, folder)
            return Robot.from_mjcf(path, base, lock, self.gravity, package_dirs=packages, snap=snap)
        assert self.urdf is not None
        arguments = self.xacro_arguments or None
        path = find_urdf(self.urdf, folder)
        return Robot.from_urdf(path, self.base, packages, lock, self.gravity, arguments, snap=snap, masses=masses)


_Sides = Annotated[list[Positive], Field(min_length=3, max_length=3)]


class _Placed(Strict):
    """Obstacle at a place, at rest or in motion.

    Attributes:
        position: position of the shape's centre in the world (3,) [m]; of a mesh, of its file's origin; of a floor, of
            a point on it.
        yaw: rotation about the world's z [rad], after roll and pitch.
        roll: rotation about x [rad].
        pitch: rotation about y [rad].
        ignored_links: names of links whose distances to this obstacle do not matter, such as wheels on a floor.
        name: unique name; by default the shape and its number, such as ``box 1``.
        motion: motion of x, y, z [m] and yaw [rad], from ``position`` and ``yaw``; at rest by default.
    """

    position: _Three = [0.0, 0.0, 0.0]
    yaw: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    ignored_links: list[str] = []
    name: str | None = None
    motion: ReferenceItem | None = None

    @abstractmethod
    def shape(self, folder: Path) -> coal.CollisionGeometry: ...

    def build(self, folder: Path, name: str) -> Sequence[Obstacle]:
        start = np.array([*self.position, self.yaw])
        places = Coordinates([False, False, False, True], names=["x", "y", "z", "yaw"])
        motion = None if self.motion is None else self.motion.from_start(start, places)
        shape, angles = self.shape(folder), (self.yaw, self.roll, self.pitch)
        return (Obstacle(shape, self.position, *angles, name, motion, self.ignored_links),)


class BoxObstacle(_Placed):
    """Box.

    Attributes:
        size: length of the sides along x, y and z [m].
    """

    size: _Sides

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Box(*self.size)


class SphereObstacle(_Placed):
    """Sphere.

    Attributes:
        radius: radius [m].
    """

    radius: Positive

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Sphere(self.radius)


class CylinderObstacle(SphereObstacle):
    """Cylinder along z.

    Attributes:
        length: length along z [m].
    """

    length: Positive

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Cylinder(self.radius, self.length)


class CapsuleObstacle(CylinderObstacle):
    """Capsule along z: a cylinder with a half sphere at each end.

    Attributes:
        length: length of the cylindrical part along z [m].
    """

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return coal.Capsule(self.radius, self.length)


class MeshObstacle(_Placed):
    """Convex hull of a mesh.

    Attributes:
        scale: factor or three factors of its coordinates.
        file: mesh file, relative to the scenario file; its convex hull is the obstacle.
    """

    scale: float | _Three = 1.0
    file: str

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return load_mesh_shape(folder / self.file, self.scale)


class GroundObstacle(_Placed):
    """Floor: the half space below the plane through ``position``, horizontal without ``roll`` and ``pitch``."""

    def shape(self, folder: Path) -> coal.CollisionGeometry:
        return ground_shape()


class MapObstacle(Strict):
    """Occupied cells of a map of ROS navigation, as boxes.

    Attributes:
        file: YAML file of the map, relative to the scenario file; or a map of the package: warehouse.yaml.
        name: unique name; its boxes are numbered. By default "map" and its number.
        height: height of the boxes, which stand on the ground [m].
        unknown: True if unknown cells are obstacles too.
        cells: side of the squares of cells that count as one, which is occupied if any of its cells is.
    """

    file: str
    name: str | None = None
    height: Positive = 2.0
    unknown: bool = False
    cells: Annotated[int, Field(ge=1)] = 1

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

    Args:
        items: entries of the file.
        folder: base of relative paths.

    Raises:
        RncError: a mesh or a motion cannot be used, or two obstacles share a name.
    """
    found: list[Obstacle] = []
    for number, item in enumerate(items, start=1):
        name = item.name or f"{type(item).__name__.removesuffix('Obstacle').lower()} {number}"
        with RncError.at(f"obstacle '{name}'"):  # an error names a mesh or a motion, a reader looks for the obstacle
            found += item.build(folder, name)
    # Verdicts, records and pages tell obstacles by their names.
    check_unique([each.name for each in found], "obstacles: two are named")
    return tuple(found)
