"""Shapes for coal, and pairs of them: primitives as they are, the hull of each mesh, obstacles; distances by coal.

The distance between two convex shapes is signed, and its rate follows from the nearest points. A mesh of triangles has
neither: coal reports the depth of one pair of triangles where two meshes overlap. A hull contains its mesh, so that a
distance of hulls is never larger than the distance of the meshes.

A joint that turns a shape of revolution about its own axis, such as a wheel, does not move it.
"""

from __future__ import annotations

import copyreg
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product
from pathlib import Path
from typing import NamedTuple, Protocol

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Float, Int
from rnc_pin.errors import InputError, ModelError, SimulationError, nearest
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.mesh_formats import read_mesh
from rnc_pin.robots.sources.mesh_readers import Mesh, convex_hull


def convex_shape(shape: coal.CollisionGeometry, name: str) -> coal.CollisionGeometry:
    """Return a convex shape that contains a shape: itself if it is convex, else the hull of its vertices.

    Args:
        shape: shape of a collision model.
        name: its name, for errors.

    Raises:
        ModelError: the shape is neither convex nor a mesh, such as a plane or a height field.
    """
    primitives = (coal.Box, coal.Sphere, coal.Cylinder, coal.Capsule, coal.Cone, coal.Ellipsoid, coal.Convex)
    if isinstance(shape, primitives):
        return shape
    if not isinstance(shape, coal.BVHModelBase):
        kind = type(shape).__name__
        raise ModelError(f"shape '{name}' is a {kind}: distances need a box, sphere, cylinder, capsule or mesh")
    return hull_of(np.array(shape.vertices()), name)


def hull_of(points: np.ndarray, name: str) -> coal.Convex:
    """Return the convex hull of points (n, 3) [m]. Points in a plane get a small thickness.

    coal takes at most 255 edges at a corner. Flat faces are triangulated anew if a corner has more; if that does not
    help, as at the tip of a fine cone, the box around the points takes the place of their hull.

    Args:
        points: the points, in any order.
        name: name of the shape, for errors.

    Raises:
        ModelError: the points have no hull.
    """
    try:
        mesh = convex_hull(points)
    except ModelError:
        points = _thickened(points)
        with ModelError.at(f"mesh '{name}'"):
            mesh = convex_hull(points)
    corners = np.array(list(product(*zip(points.min(axis=0), points.max(axis=0), strict=True))))
    # Joggled input of Qhull gives triangles without flat faces, whose fans have too many edges at one corner.
    for attempt in (partial(convex_hull, points, joggled=True), partial(convex_hull, corners)):
        try:
            return _convex(mesh)
        except RuntimeError:  # too many edges at a corner
            mesh = attempt()
    return _convex(mesh)


def _convex(mesh: Mesh) -> coal.Convex:
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in mesh.vertices:
        vertices.append(vertex)
    for corners in mesh.triangles.tolist():
        triangles.append(coal.Triangle(*corners))
    return coal.Convex(vertices, triangles)


def _thickened(points: np.ndarray) -> np.ndarray:
    """Points (6n, 3), moved by a small distance along the principal axes."""
    centered = points - points.mean(axis=0)
    extent = max(float(np.ptp(points, axis=0).max(initial=0.0)), 1e-3)
    thickness = 1e-3  # of the hull of a flat mesh, over its extent: GJK needs a volume
    axes = np.linalg.eigh(centered.T @ centered)[1].T * (0.5 * thickness * extent)
    return np.concatenate([points + sign * axis for axis in axes for sign in (1.0, -1.0)])


def bounding_box(shape: coal.CollisionGeometry, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return centre and half sides, (3,) each [m], of the box around a shape in its own frame.

    The box of a half space ends at its surface, if its normal is an axis, and 1000 km away.

    Args:
        shape: any shape of coal.
        name: its name, for errors.

    Raises:
        ModelError: the shape is not finite.
    """
    # coal computes the box of a new shape only when it is asked to.
    shape.computeLocalAABB()
    low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
    largest = 1e3  # [m]; no finite bounding sphere is of use beyond it
    beyond = 1e6  # [m]; half side of the box that stands for a half space in the broad phase
    if isinstance(shape, coal.Halfspace):
        low, high = np.clip(low, -beyond, beyond), np.clip(high, -beyond, beyond)
    elif not (np.abs([low, high]) < largest).all():
        raise ModelError(f"shape '{name}' extends beyond {largest:g} m: distances need a finite shape")
    return 0.5 * (low + high), 0.5 * (high - low)


class SpinningShapes:
    """Shapes of revolution whose joint turns about their axis, and the poses that they have without this turn.

    Args:
        model: model of the robot.
        shapes: convex shapes; only those with a carrier are looked at.
        carriers: joint that carries each of the first shapes.
        rotations, origins: poses of the shapes in their joints, (s, 3, 3) and (s, 3) [m].
        radii: radii of the spheres around the shapes [m].

    Attributes:
        shapes: indices (n,) of the shapes that spin.
        axes: axis of each joint that turns about one axis, in its frame (njoints, 3); NaN for other joints.
        wobble: largest distance (s,) of a point of each shape from an exact shape of revolution [m].
    """

    def __init__(
        self,
        model: pin.Model,
        shapes: Sequence[coal.CollisionGeometry],
        carriers: Int[Array, " k"],
        rotations: Float[Array, "s 3 3"],
        origins: Float[Array, "s 3"],
        radii: Float[Array, " s"],
    ) -> None:
        self.axes, self.wobble = axes_of_rotation(model), np.zeros(len(shapes))
        found = []
        # [m]; axes in files have few digits: 1.5708 for a right angle moves the rim of a wheel by 1e-6 m.
        most_wobble = 2e-6
        of_revolution = (coal.Cylinder, coal.Capsule, coal.Cone)  # about the z axes of their frames
        for k, joint in enumerate(carriers.tolist()):
            axis = self.axes[joint]
            turns = not np.isnan(axis).any() and model.joints[joint].nv == 1
            if not turns or not isinstance(shapes[k], (coal.Sphere, *of_revolution)):
                continue
            across = np.cross(axis, rotations[k, :, 2])
            tilt = 0.0 if isinstance(shapes[k], coal.Sphere) else float(np.linalg.norm(across))
            # How far the axis of the shape is away from the joint's, at its middle and by its tilt.
            wobble = float(np.linalg.norm(np.cross(axis, origins[k]))) + tilt * float(radii[k])
            if wobble < most_wobble:
                found.append(k)
                self.wobble[k] = wobble
        self.shapes = np.array(found, dtype=int)
        joints = carriers[self.shapes]
        self._parents = np.array([model.parents[joint] for joint in joints.tolist()], dtype=int)
        placed = [model.jointPlacements[joint].rotation for joint in joints.tolist()]
        self._rotations = np.array(placed).reshape(-1, 3, 3) @ rotations[self.shapes]

    def without_spin(
        self, rotations: Float[Array, "n s 3 3"], joints: Float[Array, "n j 3 3"]
    ) -> Float[Array, "n s 3 3"]:
        """Rotations of all shapes; spinning shapes are turned as if their joints stood at zero.

        Args:
            rotations: rotations of all shapes in the world.
            joints: rotations of all joints in the world.
        """
        # The caller keeps both: its exact poses place the shapes, the still ones bound their motion.
        still = rotations.copy()
        still[:, self.shapes] = joints[:, self._parents] @ self._rotations
        return still


def axes_of_rotation(model: pin.Model) -> Float[Array, "njoints 3"]:
    """Axis of each joint that turns about one axis, in its frame; NaN for other joints.

    Args:
        model: model of the robot.
    """
    axes, q = np.full((model.njoints, 3), np.nan), pin.neutral(model)
    revolute = "JointModelR"  # bounded and unbounded, along an axis of the frame or not
    for k, joint in enumerate(list(model.joints)[1:], start=1):
        if joint.shortname().startswith(revolute) and joint.nv == 1:
            data = joint.createData()
            joint.calc(data, q)
            axes[k] = np.ravel(data.S)[3:]
        elif joint.shortname() == "JointModelPlanar":
            axes[k] = [0.0, 0.0, 1.0]
    return axes


# ------------------------------------------------------------------ obstacles


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


# coal cannot pickle half spaces.
copyreg.pickle(coal.Halfspace, lambda shape: (coal.Halfspace, (shape.n.copy(), float(shape.d))))


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
            # All numbers at once: one message for what is no number.
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
        # coal has half spaces, whose hull would be a slab.
        if not isinstance(self.shape, coal.Halfspace):
            object.__setattr__(self, "shape", convex_shape(self.shape, self.name))
        bounding_box(self.shape, self.name)
        # An own array that nobody can change: an obstacle is a value.
        fixed = numbers[:3].copy()
        fixed.flags.writeable = False
        object.__setattr__(self, "position", fixed)

    def __reduce__(self) -> tuple[object, ...]:
        """Make the same obstacle again: the array of a pickle would be writable."""
        return type(self), tuple(vars(self).values())

    @property
    def unbounded(self) -> bool:
        """True for a half space, which has no outline."""
        return isinstance(self.shape, coal.Halfspace)

    def placement(self, t: float) -> pin.SE3:
        """Pose in the world at time t [s].

        Args:
            t: time [s].
        """
        pose = self._pose(t)
        return pin.SE3(pin.rpy.rpyToMatrix(self.roll, self.pitch, float(pose[3])), pose[:3].copy())

    def twist(self, t: float) -> np.ndarray:
        """Velocity (6,) at time t [s]: linear at its origin [m/s], then angular [rad/s], in the world.

        Args:
            t: time [s].
        """
        if self.motion is None:
            return np.zeros(6)
        rate = self.motion.at(t).velocity
        return np.array([rate[0], rate[1], rate[2], 0.0, 0.0, rate[3]])

    def at_rest(self, t: float) -> Obstacle:
        """The obstacle at rest where it is at time t [s].

        Args:
            t: time [s].
        """
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

    Args:
        obstacles: the obstacles.
        robot: the robot.

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
    # Each primitive of coal has some of these attributes, and no common method.
    sizes = [getattr(shape, key) for key in ("radius", "halfLength") if hasattr(shape, key)]
    return [*sizes, *(np.ravel(shape.halfSide) if hasattr(shape, "halfSide") else ())]


def load_mesh_shape(path: str | Path, scale: float | ArrayLike = 1.0) -> coal.CollisionGeometry:
    """Return the convex hull of a mesh file, read by the checked readers of robot files.

    Args:
        path: a .dae, .obj or .stl file; with the extra ``meshes`` also .glb, .gltf or .ply.
        scale: factor or three factors of its coordinates.

    Raises:
        ModelError: the file cannot be read, or its points have no hull.
    """
    factors = np.asarray(scale, dtype=float)
    if factors.shape not in ((), (3,)) or not (np.isfinite(factors).all() and factors.all()):
        raise ModelError(f"mesh '{path}': scale takes one number or three, not zero, found {factors.tolist()}")
    with ModelError.at(f"mesh '{path}'"):
        mesh = read_mesh(Path(path))
    points = np.asarray(mesh.vertices * factors)
    if not np.isfinite(points).all():
        raise ModelError(f"mesh '{path}': its scale gives coordinates that are not finite")
    return hull_of(points, str(path))


class LinkPair(NamedTuple):
    """Two shapes by index in the geometry, and their names: the name of the link, or of the obstacle.

    Attributes:
        first: index of the shape of a link.
        second: index of the other shape.
        names: names of the two bodies.
    """

    first: int
    second: int
    names: tuple[str, str]

    @property
    def label(self) -> str:
        """Both names in one text."""
        return f"{self.names[0]} / {self.names[1]}"


class OmittedPair(NamedTuple):
    """Pair that is not checked, and the reason.

    Attributes:
        names: names of the two bodies.
        reason: the reason, in words.
        depth: depth of the overlap [m]; zero for other reasons.
    """

    names: tuple[str, str]
    reason: str
    depth: float = 0.0

    def __str__(self) -> str:
        return f"{' / '.join(self.names)}: {self.reason}"


@dataclass(frozen=True)
class PairSelection:
    """Rules by which pairs of links are selected. Every link is always checked against every obstacle.

    Attributes:
        pairs: pairs of links to check, by name; None checks all pairs, except pairs that the other rules exclude.
        disabled: pairs of links to omit, by name.
        links: True to check links against each other; obstacles always count.
    """

    pairs: Sequence[tuple[str, str]] | None = None
    disabled: Sequence[tuple[str, str]] = ()
    links: bool = True


def select_pairs(
    model: pin.Model, names: Sequence[str], joints: Sequence[int], selection: PairSelection
) -> tuple[list[LinkPair], list[OmittedPair]]:
    """Return the pairs of links to check, and the pairs that a rule omits. Shapes of one rigid body are no pair.

    Args:
        model: model of the robot.
        names: link of each shape.
        joints: parent joint of each shape.
        selection: rules.

    Raises:
        ModelError: a rule names a link without collision geometry.
    """
    wanted = None if selection.pairs is None else _checked(selection.pairs, names)
    disabled = _checked(selection.disabled, names)
    kept: list[LinkPair] = []
    omitted: list[OmittedPair] = []
    for first, second in combinations(range(len(names)) if selection.links else (), 2):
        a, b = joints[first], joints[second]
        pair = names[first], names[second]
        # Both shapes are on one rigid body: their distance never changes.
        if a == b:
            continue
        if wanted is not None:
            if frozenset(pair) in wanted:
                kept.append(LinkPair(first, second, pair))
        elif frozenset(pair) in disabled:
            omitted.append(OmittedPair(pair, "disabled"))
        # Links of one joint touch at it by design.
        elif model.parents[a] == b or model.parents[b] == a:
            omitted.append(OmittedPair(pair, "adjacent links"))
        else:
            kept.append(LinkPair(first, second, pair))
    return kept, omitted


def _checked(pairs: Iterable[tuple[str, str]], names: Sequence[str]) -> set[frozenset[str]]:
    found = set()
    for pair in pairs:
        if len(pair) != 2 or isinstance(pair, str):
            raise ModelError(f"expected a pair of links, found {pair!r}")
        for name in pair:
            if name not in names:
                raise ModelError(f"no link '{name}' with collision geometry{nearest(str(name), dict.fromkeys(names))}")
        found.add(frozenset(pair))
    return found


# ------------------------------------------------------------------ measurement


@dataclass(frozen=True)
class PairDistances:
    """Distances of k pairs at one configuration and time.

    Attributes:
        pairs: indices of the pairs in ``CollisionDistances.pairs``, each once.
        distance: signed distances [m]; negative for penetration: minus the shortest translation that separates.
        point_a: nearest points of the first bodies, in the world [m].
        point_b: nearest points of the second bodies, in the world [m].
        normal: unit vectors from the first to the second body, ``point_b - point_a = distance * normal``.
        jacobian: rows of the rates: ``d_dot = jacobian @ v + drift``.
        drift: part of the rates that the prescribed motion of obstacles causes [m/s].
    """

    pairs: Int[np.ndarray, " k"]
    distance: Float[np.ndarray, " k"]
    point_a: Float[np.ndarray, "k 3"]
    point_b: Float[np.ndarray, "k 3"]
    normal: Float[np.ndarray, "k 3"]
    jacobian: Float[np.ndarray, "k nv"]
    drift: Float[np.ndarray, " k"]

    def __post_init__(self) -> None:
        for array in vars(self).values():
            array.flags.writeable = False

    def rates(self, v: np.ndarray) -> np.ndarray:
        """Rates (k,) of the distances [m/s] at a velocity v (nv,).

        Args:
            v: velocity of the robot.
        """
        return np.asarray(self.jacobian @ v + self.drift)


NUMBERS = 10
"""Numbers of a pair: distance, normal from the first to the second body, nearest points of both, in the world."""

_GJK, _EPA = 1e-9, 1e-6
"""Tolerances of coal: with these, distances are correct to 1e-7 m and depths to 2e-6 m. Its default for GJK is wrong by
up to 4e-5 m for cylinders, and a finer one for EPA makes it fail."""
_GJK_OF_TOUCHING = 1e-7
"""Tolerance for pairs of which EPA fails: of cylinders that touch along a line, 1 in 100 poses."""
_FAILED = -1e6  # [m]; coal returns the smallest float if EPA fails


def _request(tolerance: float) -> coal.DistanceRequest:
    request = coal.DistanceRequest()
    request.gjk_tolerance, request.epa_tolerance = tolerance, _EPA
    iterations = 256  # twice coal's default of 128: the finer tolerance needs more
    request.gjk_max_iterations = iterations
    return request


class PairMeasurement:
    """Measurement of pairs at given poses. One object serves one thread at a time.

    Pinocchio's ``computeDistance`` and coal's ``ComputeDistance`` start from their last result, so that the last digits
    would depend on the history. ``coal.distance`` starts anew.

    Args:
        shapes: convex shapes.
        pairs: pairs of them.
    """

    def __init__(self, shapes: Sequence[coal.CollisionGeometry], pairs: Sequence[LinkPair]) -> None:
        self._pairs, self._poses = pairs, [coal.Transform3s() for _ in shapes]
        request, result = _request(_GJK), coal.DistanceResult()
        self._request_of_touching = _request(_GJK_OF_TOUCHING)
        self._result = result
        # Arguments are made once: placements are written into the same objects.
        poses = self._poses
        self._arguments = [(shapes[a], poses[a], shapes[b], poses[b], request, result) for a, b, _ in pairs]

    def measure(
        self, pairs: Int[np.ndarray, " k"], rotations: Float[np.ndarray, "s 3 3"], origins: Float[np.ndarray, "s 3"]
    ) -> Float[np.ndarray, "k 10"]:
        """Numbers of pairs at poses of the shapes.

        Args:
            pairs: indices of the pairs.
            rotations: rotations of all shapes in the world.
            origins: origins of all shapes in the world [m].

        Raises:
            SimulationError: coal finds no depth of a penetration.
        """
        listed = pairs.tolist()
        columns = rotations.swapaxes(1, 2).copy()  # coal copies matrices that are stored by rows
        for k in {shape for pair in listed for shape in self._pairs[pair][:2]}:
            self._poses[k].setTransform(columns[k].T, origins[k])
        found = np.empty((len(listed), NUMBERS))
        result, arguments = self._result, self._arguments
        for row, pair in zip(found, listed, strict=True):
            result.clear()
            # The comparison is false for NaN too.
            if not coal.distance(*arguments[pair]) > _FAILED:
                result.clear()
                if not coal.distance(*arguments[pair][:4], self._request_of_touching, result) > _FAILED:
                    raise SimulationError(f"coal found no penetration depth of {self._pairs[pair].label}")
            row[0], row[1:4] = result.min_distance, result.normal
            row[4:7], row[7:] = result.getNearestPoint1(), result.getNearestPoint2()
        return found
