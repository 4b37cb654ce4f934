"""Obstacles: shapes at a constant pose, or with a prescribed motion."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.collision.convex_shapes import bounding_box, convex_shape, hull_of
from rnc_pin.errors import InputError, ModelError, nearest
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.mesh_formats import MeshError, read_mesh


class MotionPoint(Protocol):
    """Value of a motion at one time, such as a ``ReferencePoint``."""

    @property
    def position(self) -> np.ndarray: ...
    @property
    def velocity(self) -> np.ndarray: ...


class ObstacleMotion(Protocol):
    """Motion of an obstacle: x, y, z [m] and yaw [rad] over time, such as a ``Reference`` of four numbers."""

    size: int

    def at(self, t: float) -> MotionPoint: ...


@dataclass(frozen=True)
class Obstacle:
    """Convex body in the world.

    Args:
        shape: a coal shape: ``coal.Box(x, y, z)``, ``coal.Sphere(radius)``, ``coal.Cylinder(radius, length)`` and
            ``coal.Capsule(radius, length)`` along z, ``coal.Halfspace(normal, offset)``, or the result of
            ``load_mesh_shape``. A mesh counts as its hull. ``ground_shape()`` is a floor.
        position: position of the shape's centre in the world (3,) [m]; of a mesh, of its file's origin; of a floor,
            of a point on it.
        yaw: rotation about the world's z [rad], after roll and pitch.
        roll: rotation about x [rad].
        pitch: rotation about y [rad].
        name: unique name.
        motion: x, y, z and yaw over time; it replaces ``position`` and ``yaw``. Roll and pitch are constant.
        ignored_links: names of links whose distances to this obstacle do not matter, such as wheels on a floor.

    Raises:
        InputError: a number is not finite, a size is not positive, the motion does not have four numbers, or
            ``ignored_links`` are no names.
        ModelError: the shape is not convex and not a mesh.

    Example:
        >>> import coal
        >>> table = rnc.collision.Obstacle(coal.Box(0.6, 1.0, 0.05), position=(1.2, 0.0, 0.7), name="table")
        >>> table.placement(0.0).translation
        array([1.2, 0. , 0.7])
        >>> to_the_left = rnc.planning.MinimumJerk([2.0, -1.0, 0.5, 0.0], [2.0, 1.0, 0.5, 0.0], duration=4.0)
        >>> person = rnc.collision.Obstacle(coal.Capsule(0.3, 1.2), name="person", motion=to_the_left)
        >>> person.twist(2.0)[:3].round(3)  # linear velocity at its own origin
        array([0.   , 0.938, 0.   ])
    """

    shape: coal.CollisionGeometry
    position: ArrayLike = (0.0, 0.0, 0.0)
    yaw: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    name: str = "obstacle"
    motion: ObstacleMotion | None = None
    ignored_links: Sequence[str] = ()

    def __post_init__(self) -> None:
        title = f"obstacle '{self.name}'"
        try:
            numbers = np.array([*np.ravel(self.position), self.yaw, self.roll, self.pitch], dtype=float)
        except (TypeError, ValueError):
            raise InputError(f"{title}: position and angles have to be numbers") from None
        if numbers.size != 6 or not np.isfinite(numbers).all():
            raise InputError(f"{title}: expected three finite numbers for the position, and finite angles")
        if self.motion is not None and self.motion.size != 4:
            raise InputError(f"{title}: its motion has {self.motion.size} numbers, expected x, y, z and yaw")
        if not isinstance(self.shape, coal.CollisionGeometry):
            raise ModelError(f"{title}: expected a coal shape, found {type(self.shape).__name__}")
        sizes = _sizes(self.shape)
        if not all(0 < size < np.inf for size in sizes):
            raise InputError(f"{title}: sizes have to be positive and finite, found {[float(size) for size in sizes]}")
        if isinstance(self.ignored_links, str) or not all(isinstance(each, str) for each in self.ignored_links):
            raise InputError(f"{title}: ignored_links takes names of links, found {self.ignored_links!r}")
        object.__setattr__(self, "ignored_links", tuple(self.ignored_links))
        if not isinstance(self.shape, coal.Halfspace):
            object.__setattr__(self, "shape", convex_shape(self.shape, self.name))
        bounding_box(self.shape, self.name)
        fixed = numbers[:3].copy()
        fixed.flags.writeable = False
        object.__setattr__(self, "position", fixed)

    def __getstate__(self) -> dict[str, object]:
        """State for a pickle: coal cannot pickle half spaces."""
        state = dict(vars(self))
        if isinstance(self.shape, coal.Halfspace):
            state["shape"] = self.shape.n.copy(), float(self.shape.d)
        return state

    def __setstate__(self, state: dict[str, object]) -> None:
        shape = state["shape"]
        vars(self).update(state, shape=coal.Halfspace(*shape) if isinstance(shape, tuple) else shape)
        self.position.setflags(write=False)  # type: ignore[union-attr]  # __post_init__ made an array

    @property
    def unbounded(self) -> bool:
        """True for a half space, which has no outline."""
        return isinstance(self.shape, coal.Halfspace)

    def placement(self, t: float) -> pin.SE3:
        """Pose in the world at time t [s]."""
        pose = self._pose(t)
        return pin.SE3(pin.rpy.rpyToMatrix(self.roll, self.pitch, float(pose[3])), pose[:3].copy())

    def twist(self, t: float) -> np.ndarray:
        """Velocity (6,) at time t [s]: linear at its origin [m/s], then angular [rad/s], in the world."""
        if self.motion is None:
            return np.zeros(6)
        rate = self.motion.at(t).velocity
        return np.array([rate[0], rate[1], rate[2], 0.0, 0.0, rate[3]])

    def at_rest(self, t: float) -> Obstacle:
        """The obstacle at rest where it is at time t [s]."""
        if self.motion is None:
            return self
        pose = self._pose(t)
        return replace(self, motion=None, position=pose[:3], yaw=float(pose[3]))

    def _pose(self, t: float) -> np.ndarray:
        if self.motion is None:
            return np.append(np.asarray(self.position), self.yaw)
        return np.asarray(self.motion.at(t).position, dtype=float)


def ground_shape() -> coal.Halfspace:
    """Half space below the plane z = 0 of its own frame: the shape of a floor.

    Example:
        >>> wheels = ("wheel_left_link", "wheel_right_link")
        >>> floor = rnc.collision.Obstacle(rnc.collision.ground_shape(), name="floor", ignored_links=wheels)
        >>> floor.unbounded
        True
    """
    return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)


def check_ignored_links(obstacles: Iterable[Obstacle], robot: Robot) -> None:
    """Check that the robot has the links that obstacles ignore.

    Raises:
        ModelError: it has no such link.
    """
    for obstacle in obstacles:
        for name in obstacle.ignored_links:
            if not robot.model.existFrame(name):
                links = [frame.name for frame in robot.model.frames if frame.type == pin.FrameType.BODY]
                close = nearest(name, links)
                raise ModelError(f"obstacle '{obstacle.name}': ignored_links: no link '{name}'{close}")


def _sizes(shape: coal.CollisionGeometry) -> list[float]:
    """Radii, lengths and sides of a primitive [m]."""
    sizes = [getattr(shape, key) for key in ("radius", "halfLength") if hasattr(shape, key)]
    return [*sizes, *(np.ravel(shape.halfSide) if hasattr(shape, "halfSide") else ())]


def load_mesh_shape(path: str | Path, scale: float | ArrayLike = 1.0) -> coal.CollisionGeometry:
    """Return the convex hull of a mesh file, read by the checked readers of robot files.

    Args:
        path: a .dae, .glb, .gltf, .msh, .obj, .ply or .stl file.
        scale: factor or three factors of its coordinates.

    Raises:
        ModelError: the file cannot be read, or its points have no hull.
    """
    factors = np.asarray(scale, dtype=float)
    if factors.shape not in ((), (3,)) or not (np.isfinite(factors).all() and factors.all()):
        raise ModelError(f"mesh '{path}': scale takes one number or three, not zero, found {factors.tolist()}")
    try:
        mesh = read_mesh(Path(path))
    except MeshError as error:
        raise ModelError(f"mesh '{path}': {error}") from None
    points = np.asarray(mesh.vertices * factors)
    if not np.isfinite(points).all():
        raise ModelError(f"mesh '{path}': its scale gives coordinates that are not finite")
    return hull_of(points, str(path))
