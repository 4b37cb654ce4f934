"""Robot of a draft at its start values: the pose of its base, its geometry as points, and tolerances for its numbers.

Points find the ground, the wheels and their radii. Files round to a few digits, and workshops build to a degree and a
millimetre.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init.evidence import DriveEvidence, mimic_drivers
from rnc_pin.errors import ModelError
from rnc_pin.io import Json
from rnc_pin.robots import Robot

ALIGNED = 0.0175
"""Angle [rad], or its sine, below which two directions are equal: 1 degree, e.g. toe-in or the lean of a kingpin."""
SAME = 1e-3
"""Share of a range, or of a radius, below which two values are equal; it bounds rounding, not workmanship."""
PLACED = 3e-3
"""Distance [m] below which two positions are equal, e.g. the axles of two wheels of one axle line."""
INDEPENDENT = 1e-3
"""Sine of the angle between actuators (or outputs) below which they are linearly dependent."""


def placed(length: float) -> float:
    """Return the distance [m] below which two positions on a part of this length are equal: a tenth of small parts.

    Args:
        length: length of the part [m].
    """
    return min(PLACED, 0.1 * length)


def first_smallest(values: Sequence[float] | np.ndarray, slack: float) -> int:
    """Return the index of the first value within ``slack`` of the smallest; rounding does not change it.

    Args:
        values: the values.
        slack: difference below which two values are equal.
    """
    array = np.asarray(values)
    # Not argmin: of two equal values, rounding on another computer would choose the other, and the draft would differ.
    return int(np.flatnonzero(array <= array.min() + slack)[0])


Kind: TypeAlias = Literal["collision", "visual"]
GEOMETRY: tuple[Kind, ...] = ("collision", "visual")

_CIRCLE = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)


@dataclass(frozen=True)
class Shape:
    """One geometry object: points, and a margin around their convex hull.

    Attributes:
        joint: index of the parent joint.
        name: name of the geometry.
        points: points in the world frame (k, 3) [m].
        margin: radius around the points [m].
        axis: axis of a cylinder in the world frame (3,); zero for other shapes.
    """

    joint: int
    name: str
    points: np.ndarray
    margin: float
    axis: np.ndarray

    @property
    def bottom(self) -> float:
        """Height of the lowest point [m]."""
        return float(self.points[:, 2].min() - self.margin)

    @property
    def middle(self) -> np.ndarray:
        """Mean of its points (3,) [m]."""
        return np.asarray(self.points.mean(axis=0))

    @property
    def radius(self) -> float:
        """Radius of a cylinder [m]."""
        return float(np.linalg.norm(across(self.points - self.middle, self.axis), axis=1).max())

    @property
    def is_disk(self) -> bool:
        """True for a cylinder that is short beside its radius."""
        return bool(self.axis.any() and np.ptp(self.points @ self.axis) < 1.5 * self.radius)


def shapes(robot: Robot, kind: Kind, q: np.ndarray) -> list[Shape]:
    """Return the "visual" or "collision" geometry at a configuration (nq,); empty if files are missing.

    Args:
        robot: the robot.
        kind: "visual" or "collision".
        q: configuration (nq,).
    """
    geometry = None
    with suppress(ModelError):  # a draft needs no shapes: names and inertias are left
        geometry = robot.visual_model if kind == "visual" else robot.collision_model
    if geometry is None:
        return []
    data, placed = robot.model.createData(), geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, geometry, placed, q)
    stand_ins = robot.stand_ins if kind == "visual" else frozenset()
    found = []
    for item, placement in zip(geometry.geometryObjects, placed.oMg, strict=True):
        local = _points(item)
        if local is None or item.name in stand_ins:  # skip boxes that only stand for an inertia
            continue
        points, margin = local
        axis = placement.rotation[:, 2] * (type(item.geometry).__name__ == "Cylinder")
        world = points @ placement.rotation.T + placement.translation
        found.append(Shape(item.parentJoint, item.name, world, margin, axis))
    return found


def _points(item: pin.GeometryObject) -> tuple[np.ndarray, float] | None:
    geometry, kind = item.geometry, type(item.geometry).__name__
    if kind == "Sphere":
        return np.zeros((1, 3)), float(geometry.radius)
    if kind in ("Cylinder", "Cone"):
        circle = np.stack([np.cos(_CIRCLE), np.sin(_CIRCLE), np.zeros_like(_CIRCLE)], axis=1) * geometry.radius
        end = np.array([0.0, 0.0, geometry.halfLength])
        return np.concatenate([circle + end, circle - end]), 0.0
    if kind == "Capsule":
        return np.array([[0, 0, geometry.halfLength], [0, 0, -geometry.halfLength]]), float(geometry.radius)
    if kind == "Ellipsoid":  # its ends only: a wheel that is drawn as one is smaller between them
        return np.concatenate([np.diag(geometry.radii), -np.diag(geometry.radii)]), 0.0
    if kind == "Box":
        return np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * geometry.halfSide, 0.0
    if kind.startswith("BVHModel"):
        points = np.array(geometry.vertices(), dtype=float).reshape(-1, 3)
        # One NaN would make every height of the ground NaN.
        return (points, 0.0) if len(points) and np.isfinite(points).all() else None
    return None  # planes and height fields have no size of their own


class Disk(NamedTuple):
    """Disk about an axle.

    Attributes:
        radius: radius [m].
        bottom: height of the lowest point [m].
        width: width along the axle [m].
    """

    radius: float
    bottom: float
    width: float


def fitted_disk(parts: list[Shape], center: np.ndarray, axle: np.ndarray) -> Disk | None:
    """Return the disk that shapes form about an axle near ``center``, or None if they are not round or far from it.

    Radius and roundness are those about the middle of the shapes, which files place a little beside the axle, or about
    the axle if that is smaller: an odd number of rollers reaches farther on one side.

    Args:
        parts: shapes in the world frame.
        center: point on the axle in the world frame (3,) [m].
        axle: direction of the axle in the world frame (3,), of unit length.
    """
    upward = np.array([0.0, 0.0, 1.0]) - axle[2] * axle
    upward /= np.linalg.norm(upward)
    forward = np.cross(axle, upward)
    axes = np.column_stack([forward, upward, axle])
    low = np.min([((part.points - center) @ axes).min(axis=0) - part.margin for part in parts], axis=0)
    high = np.max([((part.points - center) @ axes).max(axis=0) + part.margin for part in parts], axis=0)
    extents = high - low
    middle = (high + low)[:2] / 2
    beside = center + middle[0] * forward + middle[1] * upward
    radius = min(max(_reach(part, own, axle) for part in parts) for own in (beside, center))
    # 3 mm are workmanship for the smallest wheels too; a shape farther away moves around the axle, as a crank does.
    is_near = float(np.linalg.norm(middle)) < max(0.2 * radius, PLACED)
    # Coarse meshes are round: ten sides have extents of 1 to 0.95. A hexagon has 0.87.
    is_round = extents[:2].min() > 0.9 * extents[:2].max() and is_near
    # A square has equal extents too, but its corners are farther away than its sides.
    if not is_round or 2 * radius > 1.1 * extents[:2].max():
        return None
    return Disk(radius, min(part.bottom for part in parts), float(extents[2]))


def _reach(part: Shape, own: np.ndarray, axle: np.ndarray) -> float:
    """Largest distance of a shape from the axle through a point (3,) [m].

    A cylinder whose axis is the axle up to rounding reaches as far as its radius, not as its raised edge.
    """
    middle, along = part.middle, axle
    if part.axis.any() and np.linalg.norm(np.cross(part.axis, axle)) < ALIGNED:
        along = part.axis
    beside = across(middle - own, axle)
    return float(np.linalg.norm(across(part.points - middle, along) + beside, axis=1).max()) + part.margin


def across(vectors: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Component of vectors (..., 3) perpendicular to a unit axis (3,).

    Args:
        vectors: vectors (..., 3).
        axis: unit axis (3,).
    """
    return np.asarray(vectors - (vectors @ axis)[..., None] * axis)


@dataclass(frozen=True)
class FileNames:
    """Names of a file that the model does not contain.

    Attributes:
        title: names of the file and of the robot.
        plugins: names and files of its plugins.
        meshes: files of the meshes of each link.
    """

    title: str = ""
    plugins: str = ""
    meshes: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class RobotAtStart:
    """Robot at its start values, with the base pose of the file.

    Attributes:
        robot: the robot.
        start: start values of joints with one degree of freedom.
        names: names in the file that the model does not contain.
        drives: evidence for which joints have a motor.
        is_urdf: True for a URDF; a base cannot replace free joints of a URDF.
        is_rigid: True if the file has no movable joint; the robot then has a free base.
    """

    robot: Robot
    start: dict[str, float]
    names: FileNames
    drives: DriveEvidence
    is_urdf: bool = True
    is_rigid: bool = False

    @cached_property
    def q(self) -> np.ndarray:
        """Configuration at the start (nq,)."""
        return self.robot.configuration(self.start)

    @cached_property
    def data(self) -> pin.Data:
        """Placements and joint Jacobians at the start."""
        data = self.robot.model.createData()
        pin.computeJointJacobians(self.robot.model, data, self.q)
        pin.updateFramePlacements(self.robot.model, data)
        return data

    @cached_property
    def shapes(self) -> dict[Kind, list[Shape]]:
        """Shapes of the "collision" and the "visual" geometry.

        A body behind the base that lacks a mesh has no shapes of that geometry: the rest, such as the hub of a wheel
        without its tyre, would give a wrong size.
        """
        every = {kind: shapes(self.robot, kind, self.q) for kind in GEOMETRY}
        return {kind: [each for each in every[kind] if each.joint not in self.without_mesh[kind]] for kind in GEOMETRY}

    @cached_property
    def without_mesh(self) -> dict[Kind, set[int]]:
        """Indices of the joints behind the base that carry links whose "collision" or "visual" geometry lacks a mesh.

        The base itself keeps what is left: its lowest point tells the ground, and nothing measures its radius.
        """
        found: dict[Kind, set[int]] = {kind: set() for kind in GEOMETRY}
        for kind in GEOMETRY:
            with suppress(ModelError):  # geometry that cannot be read at all
                links = [self.robot.frame_id(each) for each in self.robot.missing_meshes(kind)]
                joints = {int(self.robot.model.frames[link].parentJoint) for link in links}
                found[kind] = joints.difference(range(self.root + 1))
        return found

    @property
    def all_shapes(self) -> list[Shape]:
        """Shapes of both geometries."""
        return [each for kind in GEOMETRY for each in self.shapes[kind]]

    @property
    def drawn(self) -> list[Shape]:
        """Shapes of the "visual" geometry, or of the other one if there are none."""
        return self.shapes["visual"] or self.shapes["collision"]

    @cached_property
    def ground(self) -> float:
        """Height of the lowest drawn shape [m]."""
        return min((each.bottom for each in self.drawn), default=0.0)

    @cached_property
    def single_joints(self) -> list[int]:
        """Indices of the joints with one degree of freedom behind the base."""
        model = self.robot.model
        return [index for index in range(self.root + 1, model.njoints) if model.joints[index].nv == 1]

    def turning_axis(self, joint: int) -> np.ndarray:
        """Return the axis in the world frame (3,) of a joint with one degree of freedom; zero for a prismatic joint.

        Args:
            joint: index of the joint.
        """
        return self._column(joint)[3:]

    def _column(self, joint: int) -> np.ndarray:
        """Column (6,) of the Jacobian of a joint with one degree of freedom, in the world axes."""
        model = self.robot.model
        jacobian = pin.getJointJacobian(model, self.data, joint, pin.LOCAL_WORLD_ALIGNED)
        column: np.ndarray = jacobian.reshape(6, model.nv)[:, model.joints[joint].idx_v]  # reshaped, in case nv is 1
        return column

    @cached_property
    def own_planar_joints(self) -> tuple[str, ...]:
        """Joints of the file's own planar base: two horizontal slides and a vertical revolute joint, or none."""
        model = self.robot.model
        joints: list[str] = []
        index, slides, turns = 0, 0, 0
        while len(model.children[index]) == 1 and len(joints) < 3:
            index = int(model.children[index][0])
            if model.joints[index].nv != 1:
                return ()
            along, axis = np.split(self._column(index), 2)
            # Counted, not compared in order: the two slides may carry the turn, or it them.
            slides += not axis.any() and abs(along[2]) < ALIGNED
            turns += abs(axis[2]) > 0.999
            joints.append(str(model.names[index]))
        return tuple(joints) if (slides, turns) == (2, 1) else ()

    @cached_property
    def root(self) -> int:
        """Index of the joint that carries the base; 0 if the base is fixed to the world."""
        if self.own_planar_joints:
            return self.robot.joint_id(self.own_planar_joints[-1])
        model = self.robot.model
        # Of several bodies at the world, none carries the others.
        return 1 if model.joints[1].nv > 1 and len(model.children[0]) == 1 else 0

    @property
    def root_joint(self) -> str:
        """Name of the joint that carries the base; "universe" if the base is fixed to the world."""
        return str(self.robot.model.names[self.root])

    @property
    def has_free_joint(self) -> bool:
        """True if a free joint of the file carries the base."""
        return bool(self.root) and self.robot.model.joints[self.root].nv == 6 and not self.is_rigid

    @cached_property
    def free_joints(self) -> dict[str, list[float]]:
        """Names and values of joints with several degrees of freedom."""
        values, joints = self.robot.joint_values(self.q), list(self.robot.model.joints)
        names = [name for name, joint in zip(self.robot.model.names, joints, strict=True) if joint.nv > 1]
        return {name: np.atleast_1d(values[name]).tolist() for name in names}

    def driver(self, joint: str) -> str:
        """Return the joint that drives a joint by a mimic of the file, or the joint itself.

        Args:
            joint: name of the joint.
        """
        driver = mimic_drivers(self.robot, self.drives).get(joint, joint)
        # A locked leader is no joint of this robot any more: its follower then stands for itself.
        return driver if driver in self.robot.joint_names else joint

    def are_in_loops(self, one: str, other: str) -> bool:
        """Return whether loop closures of the file couple two joints, through other loops too.

        Args:
            one: name of one joint.
            other: name of the other joint.
        """
        model, robot = self.robot.model, self.robot
        loops: list[set[int]] = []
        for closure in robot.closures:
            ends = [set(model.supports[model.frames[robot.frame_id(name)].parentJoint]) for name in closure[:2]]
            loops.append(ends[0] ^ ends[1])  # joints that carry both ends do not move one against the other
        reached = {robot.joint_id(one)}
        for _ in loops:  # through one more loop each time
            reached = reached.union(*(loop for loop in loops if loop & reached))
        return robot.joint_id(other) in reached

    @cached_property
    def frame(self) -> str:
        """Frame of the base: ``base_link`` if it exists, else the first link."""
        frames = [name for name in self.robot.links_of(self.root) if name != "universe"]
        # REP 105 names the frame of a base so; the first link is often a footprint on the ground.
        if "base_link" in frames:
            return "base_link"
        return frames[0] if frames else self.body_frame(max(self.root, 1))

    @cached_property
    def placement(self) -> pin.SE3:
        """Placement of the base's frame in the world."""
        return self.data.oMf[self.robot.frame_id(self.frame)]

    def along(self, direction: np.ndarray, frame: str = "") -> str:
        """Return the local axis of a frame nearest to a direction in the world frame (3,); the first one in a tie.

        Args:
            direction: direction in the world frame (3,).
            frame: name of the frame; empty for the frame of the base.
        """
        placement = self.data.oMf[self.robot.frame_id(frame or self.frame)]
        return "xyz"[first_smallest(-np.abs(placement.rotation.T @ direction), ALIGNED)]

    def own_axis(self, direction: np.ndarray, frame: str = "") -> str | list[float]:
        """Return the axis of a frame along a direction in the world frame (3,), or its components if it is oblique.

        Args:
            direction: unit vector in the world frame (3,).
            frame: name of the frame; empty for the frame of the base.
        """
        along = self.data.oMf[self.robot.frame_id(frame or self.frame)].rotation.T @ direction
        is_named = np.abs(along).max() > np.cos(2 * ALIGNED)  # 2 degrees: the axle and the frame each have one
        return self.along(direction, frame) if is_named else [round(float(each), 9) for each in along]

    def knife_edge(self, axle: np.ndarray, point: np.ndarray, frame: str = "") -> dict[str, Json]:
        """Return the settings of a knife edge across an axle; its point only if it is beside the origin of the frame.

        Args:
            axle: direction of the axle in the world frame (3,).
            point: point of the edge in the world frame (3,) [m].
            frame: name of the frame; empty for the frame of the base.
        """
        name = frame or self.frame
        at = [round(float(each), 6) + 0.0 for each in self.data.oMf[self.robot.frame_id(name)].actInv(point)]
        return {"frame": name, "axis": self.own_axis(axle, name), **({"at": at} if any(at) else {})}

    def body_frame(self, joint: int) -> str:
        """Return the name of the body frame at the joint's placement, or of the joint's own frame if there is none.

        Args:
            joint: index of the joint.
        """
        for link in self.robot.links_of(joint):
            # Links behind fixed joints belong to the same body, and lie elsewhere.
            if np.allclose(self.robot.model.frames[self.robot.frame_id(link)].placement.translation, 0.0):
                return link
        return str(self.robot.model.names[joint])

    def links_on(self, joint: int) -> list[tuple[str, np.ndarray]]:
        """Return the links that a joint moves, with the origins of their frames in the world frame (3,) [m].

        Args:
            joint: index of the joint.
        """
        links = self.robot.links_of(joint)
        return [(name, self.data.oMf[self.robot.frame_id(name)].translation.copy()) for name in links]

    @cached_property
    def title(self) -> tuple[str, ...]:
        """Names of the whole robot: of its file, its model, its plugins and the frame of its base.

        Links of one rigid body count too. Those of other robots do not: "rotor" may be a part of an arm's motor.
        """
        links = [str(frame.name) for frame in self.robot.model.frames] if self.is_rigid else []
        return self.names.title, self.robot.model.name, self.names.plugins, self.frame, *links

    def names_on(self, *joints: str) -> tuple[str, ...]:
        """Return the names of joints, of the links on them, and of the meshes of these links.

        Args:
            *joints: names of joints; "universe" for the world.
        """
        indices = {0 if joint == "universe" else self.robot.joint_id(joint) for joint in joints}
        links = [str(frame.name) for frame in self.robot.model.frames if frame.parentJoint in indices]
        return *joints, *links, *(self.names.meshes.get(link, "") for link in links)
