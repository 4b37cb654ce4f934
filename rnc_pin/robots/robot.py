"""Robot class: a Pinocchio model with names and geometry, from a file or another robot (locked, attached, heavier).

Pinocchio adds the inertias of links that are fixed to each other. It stores the inertia of each fixed link in its
frame. The rest of the sum is the inertia of the link that the joint itself moves. The ten dynamic parameters of bodies
about one point are additive, so a link is replaced by adding the difference.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import partial
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, argument, nearest, warn
from rnc_pin.printing import ObjectSummary, SummaryMixin, counted, items
from rnc_pin.robots import robot_files
from rnc_pin.robots.joint_values import JointValue, NamedModel, base_of
from rnc_pin.robots.model_checks import UselessInertia, check_model, check_model_size, massless
from rnc_pin.robots.sources.description import Closure, Description, Mimic, check_acceleration
from rnc_pin.robots.sources.urdf import read_urdf
from rnc_pin.robots.sources.urdf_links import STAND_IN

Base = Literal["fixed", "planar", "free"]
Load = Callable[[str], pin.GeometryModel | None]
"""Function for the geometry of a kind, "visual" or "collision"."""


class Robot(NamedModel, SummaryMixin):
    """Rigid multibody model with its names and geometry.

    Args:
        model: any ``pinocchio.Model``.
        visual_model: visual geometry; None if there is none.
        collision_model: collision geometry; None if there is none.

    Attributes:
        mimics: mimic joints of the file. They are independent joints in the model; a ``NonholonomicSystem`` couples
            them by constraints.
        closures: kinematic loops of an MJCF (``<connect>``, ``<weld>``). The model leaves them open: add
            ``LoopClosure(*closure)`` to the constraints for each.
        references: values of the hinges and slides of an MJCF in the configuration that the file draws, their ``ref``
            [rad or m]; empty for a URDF, whose joints are zero there.
        locked: joint name to value [rad or m] of the locked joints.
        packages: name to folder of the ROS packages that the file names and that were found.
        folders: folders whose files the description may name: its own, its packages' and ``package_dirs``.
        source: entry ``robot`` of a scenario file that loads this robot; None for a model that was made otherwise.

    Raises:
        ModelError: a mass or inertia is not physical, two joints share a name, or a joint moves no mass.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")  # one that comes along; any path will do
        >>> print(robot)
        Robot 'space_robot': 4 degrees of freedom, fixed base
          joints: platform, joint_1, joint_2, joint_3
        >>> q = robot.configuration({"joint_1": 0.3})
        >>> robot.velocity_indices("joint_2")
        slice(2, 3, None)
    """

    def __init__(
        self,
        model: pin.Model,
        visual_model: pin.GeometryModel | None = None,
        collision_model: pin.GeometryModel | None = None,
    ) -> None:
        super().__init__(model)
        self._geometry = LazyGeometry({"visual": visual_model, "collision": collision_model}.get)
        self._lost: Mapping[str, Mapping[str, tuple[str, ...]]] = {}
        self.mimics: tuple[Mimic, ...] = ()
        self.closures: tuple[Closure, ...] = ()
        self.references: Mapping[str, float] = {}
        self.locked: dict[str, float] = {}
        self.packages: Mapping[str, Path] = {}
        self.folders: tuple[Path, ...] = ()
        check_model(model)

    # ------------------------------------------------------------------ construction

    @classmethod
    def from_urdf(
        cls,
        path: str | Path,
        base: Base = "fixed",
        package_dirs: Sequence[str | Path] = (),
        lock: Mapping[str, JointValue] | None = None,
        gravity: Sequence[float] | None = None,
        xacro_arguments: Mapping[str, object] | None = None,
        *,
        snap: bool = True,
        masses: Mapping[str, float] | None = None,
    ) -> Robot:
        """Load a URDF file, or a xacro file, which is expanded first.

        Common deviations from the format are accepted: no limits, no name, too many numbers, macros in a ``.urdf``.
        A ``ModelWarning`` reports each repair that affects the model.

        Expressions in a xacro file only compute values; an expression that could run a program is refused, see
        ``rnc_pin.robots.sources.xacro``. A mimic joint is an independent joint of the model, because Pinocchio's
        Coriolis matrix does not support mimic joints; it is listed in ``mimics``.

        Args:
            path: the file; the name alone is enough for a file shipped with rnc_pin. A file whose name ends in
                ``.xacro`` is expanded.
            base: joint between the root link and the world: "fixed", "planar" (x, y, yaw) or "free". A planar
                or free base is the joint ``root_joint``; its velocity is in the body frame.
            package_dirs: folders of packages, or packages themselves, for ``package://`` paths and xacro's
                ``$(find ...)``. After them come ROS_PACKAGE_PATH, AMENT_PREFIX_PATH, and the folders above the file.
                The file may name only files below these folders, below its own folder and in its packages.
            lock: joints to lock and their values [rad or m].
            gravity: acceleration of gravity in the world frame, (3,) [m/s^2]; default (0, 0, -9.81).
            xacro_arguments: values for the arguments of a xacro file.
            snap: replace rounded angles and axes of joints by exact ones. These are multiples of pi/2, pi/3, pi/4 or
                pi/6 with two decimals or more, and angles within 1e-4 rad of a right angle. A ``ModelWarning``
                reports a change of more than 1e-9.
            masses: link to mass [kg], for links whose inertia is missing or not usable. The mass is uniform in the box
                around the link's collision geometry (visual geometry if there is none). A link without geometry
                becomes a ball of radius 0.05 m. A link with a valid inertia is refused: use ``with_masses`` for it.

        Raises:
            ModelError: the file is missing, is not a URDF, or describes an impossible robot.
        """
        path = robot_files.find_urdf(path)
        read = read_urdf(path, base, package_dirs, xacro_arguments, snap=snap, masses=masses)
        return cls._from_description(path, read, lock, gravity)

    @classmethod
    def from_mjcf(
        cls,
        path: str | Path,
        base: Base | None = None,
        lock: Mapping[str, JointValue] | None = None,
        gravity: Sequence[float] | None = None,
        *,
        package_dirs: Sequence[str | Path] = (),
        snap: bool = True,
    ) -> Robot:
        """Load an MJCF file, compiled by MuJoCo (extra ``mujoco``).

        Bodies, joints, inertias, geometry, damping, armature and gravity are read. Joints without an actuator
        have an effort limit of zero. Contacts and sensors are not read. ``mimics`` lists the equalities of joints,
        ``closures`` the ``<connect>`` and ``<weld>``; a ``ModelWarning`` names other equalities and tendons.

        Args:
            path: the file.
            base: None keeps the base of the file, which may have a free joint, hinges and slides. "fixed",
                "planar" or "free", as for a URDF, replaces a free joint.
            lock: joints to lock and their values [rad or m].
            gravity: acceleration of gravity in the world frame, (3,) [m/s^2]; default from the file.
            package_dirs: additional folders for included files and meshes, besides the file's own and its package.
            snap: replace rounded axes of joints and orientations of bodies by exact ones, as for a URDF.

        Raises:
            ModelError: the file is missing, is not MJCF, names files elsewhere, or describes an impossible robot; or
                MuJoCo is not installed.
        """
        path = robot_files.find_mjcf(path)
        from rnc_pin.robots.sources.mjcf import read_mjcf  # not for those who read a URDF

        read = read_mjcf(path, base, [Path(each) for each in package_dirs], snap=snap)
        return cls._from_description(path, read, lock, gravity)

    @classmethod
    def _from_description(
        cls, path: Path, read: Description, lock: Mapping[str, JointValue] | None, gravity: Sequence[float] | None
    ) -> Robot:
        model, geometry = read.model, read.geometry
        with ModelError.at(path):
            check_model_size(model)
        if gravity is not None:
            model.gravity.linear = check_acceleration(gravity)
        if lock:
            change = partial(locked_model, model, dict(lock))
            geometry, (model, _) = partial(_changed_geometry, change, [geometry]), change()
        with ModelError.at(path):
            try:
                robot = cls(model)
            except UselessInertia as error:
                # The model alone knows no links of the file: with them, the remedy names a mass for each.
                error.joints = massless(model, read.bodies)
                raise
        robot._geometry = LazyGeometry(geometry)
        robot._lost = read.lost
        robot.mimics, robot.closures, robot.references = read.mimics, read.closures, read.references
        # Mimics refer only to joints with one value.
        robot.locked = {name: float(np.ravel(at)[0]) for name, at in (lock or {}).items() if np.size(at) == 1}
        robot.packages, robot.folders = read.packages, read.folders
        return robot

    @classmethod
    def from_example(
        cls,
        name: str,
        base: Base = "fixed",
        lock: Mapping[str, JointValue] | None = None,
        gravity: Sequence[float] | None = None,
        *,
        snap: bool = True,
        masses: Mapping[str, float] | None = None,
    ) -> Robot:
        """Load a robot of the example-robot-data package by the name of its URDF.

        Args:
            name: e.g. ``"panda"`` or ``"tiago_no_hand"``.
            base: joint between the root link and the world, as for a URDF.
            lock: joints to lock and their values [rad or m].
            gravity: acceleration of gravity in the world frame, (3,) [m/s^2]; default (0, 0, -9.81).
            snap: replace rounded angles and axes by exact ones, as for a URDF.
            masses: link to mass [kg], as for a URDF.

        Raises:
            ModelError: there is no such example.
        """
        path, packages = robot_files.find_example(name)
        return cls.from_urdf(path, base, [packages], lock, gravity, snap=snap, masses=masses)

    def attach(self, other: Robot, frame: str, placement: pin.SE3 | None = None) -> Robot:
        """Return a new robot with another robot mounted on a frame of this one, e.g. an arm on a satellite.

        Gravity is this robot's. The mass of the other robot's base link is included.

        Args:
            other: robot to mount, with a fixed base.
            frame: name of a frame of this robot.
            placement: pose of the other robot's base in that frame; default identity.

        Raises:
            ModelError: unknown frame, a base that is not fixed, or both have a joint or frame of the same name.
        """
        index = self.frame_id(frame)
        if "root_joint" in other.joint_names:
            raise ModelError(
                f"robot '{other.name}' has a moving base: load it with {argument('base', 'fixed')} to mount it"
            )
        change = partial(attached_model, self.model, other.model, index, placement)
        robot = Robot(change()[0])
        loads = [self._geometry.get, other._geometry.get]
        robot._geometry = LazyGeometry(partial(_changed_geometry, change, loads))
        robot.mimics = (*self.mimics, *other.mimics)
        # The mounted robot moves with its carrier: a loop with the world of its own file no longer holds.
        robot.closures = (*self.closures, *(each for each in other.closures if "universe" not in each[:2]))
        if len(robot.closures) < len(self.closures) + len(other.closures):
            warn(f"robot '{other.name}': its loop closures with the world are omitted, because it is mounted")
        robot.references = {**self.references, **other.references}
        robot.locked = {**self.locked, **other.locked}
        # Of packages with one name, this robot's folder counts, as its gravity does.
        robot.packages = {**other.packages, **self.packages}
        robot.folders = (*self.folders, *other.folders)
        return robot

    def with_masses(self, masses: Mapping[str, LinkMass]) -> Robot:
        """Return a new robot with other link masses, e.g. for parameter studies. This robot does not change.

        A new mass scales the rotational inertia of the link and keeps its centre of mass.
        Links that are fixed to each other, and links behind locked joints, each have their own mass.

        Args:
            masses: link to mass [kg], or to a ``pinocchio.Inertia`` in the link frame, which replaces the inertia.

        Raises:
            ModelError: unknown link, a link without a mass to scale, or a mass that is not positive.

        Example:
            >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
            >>> heavy = robot.with_masses({"link_3": 5.0})
            >>> robot.model.inertias[4].mass, heavy.model.inertias[4].mass
            (1.0, 5.0)
        """
        if not isinstance(masses, Mapping):
            raise ModelError(f"masses have to be a mapping of links to masses [kg], found {type(masses).__name__}")
        # A shallow copy shares meshes and records of the file.
        robot, changed = copy(self), self.model.copy()
        robot.model, robot.locked = changed, dict(self.locked)
        links = {frame.name: k for k, frame in enumerate(changed.frames) if frame.type == pin.FrameType.BODY}
        for name, mass in masses.items():
            if name not in links:
                raise ModelError(f"no link '{name}' in robot '{self.name}'{nearest(str(name), links)}")
            frame = changed.frames[links[name]]
            # From the changed model: several links can be parts of one body.
            keeper, joint = _keeper(changed, links[name]), frame.parentJoint
            own = _moved_link(changed, joint) if keeper is None else keeper.placement.act(keeper.inertia)
            old = np.array(own.toDynamicParameters())
            parameters = _new(name, mass, old, frame.placement, self.name)
            whole = np.array(changed.inertias[joint].toDynamicParameters())
            # A single link is scaled exactly, without the rounding errors of a sum and a difference.
            alone = np.abs(whole - old).max() <= _ROUNDING * np.abs(whole).max()
            total = parameters if alone else whole + parameters - old
            changed.inertias[joint] = pin.Inertia.FromDynamicParameters(total)
            # The record has to follow the sum, or the next change of a mass would start from the old one.
            if keeper is not None:
                keeper.inertia = keeper.placement.actInv(pin.Inertia.FromDynamicParameters(parameters))
        check_model(changed)
        return robot

    # ------------------------------------------------------------------ geometry

    @property
    def visual_model(self) -> pin.GeometryModel | None:
        """Visual geometry; meshes are read on first access.

        Boxes replace meshes of a URDF that are missing or not readable; a ``ModelWarning`` lists them.
        """
        return self._geometry.get("visual")

    @property
    def stand_ins(self) -> frozenset[str]:
        """Names of the visual boxes that replace missing meshes; do not take measurements from them."""
        visual = self.visual_model
        names = [] if visual is None else [shape.name for shape in visual.geometryObjects]
        return frozenset(name for name in names if name.endswith(STAND_IN))

    @property
    def collision_model(self) -> pin.GeometryModel | None:
        """Collision geometry without missing meshes; meshes are read on first access."""
        return self._geometry.get("collision")

    @property
    def has_collision_shapes(self) -> bool:
        """True if a link has collision geometry; meshes are read for the answer."""
        geometry = self.collision_model
        return geometry is not None and len(geometry.geometryObjects) > 0

    @property
    def drawn_geometry(self) -> pin.GeometryModel | None:
        """Geometry of pictures and pages: the visual one; without visual shapes the collision geometry, if any."""
        models = map(self._geometry.get, ("visual", "collision"))  # collision meshes are read only if they are drawn
        return next((model for model in models if model is not None and len(model.geometryObjects)), None)

    def missing_meshes(self, kind: Literal["visual", "collision"]) -> Mapping[str, tuple[str, ...]]:
        """Return names of the meshes of a URDF that are missing or not readable, by link; empty for a mounted robot.

        Args:
            kind: geometry that the meshes belong to.
        """
        self._geometry.get(kind)
        return self._lost.get(kind, {})

    # ------------------------------------------------------------------ print

    def _summary(self) -> ObjectSummary:
        title = f"Robot '{self.name}': {counted(self.nv, 'degree')} of freedom, {base_of(self.model)} base"
        return ObjectSummary(title, [("joints", items(self.joint_names))])


class LazyGeometry:
    """Visual and collision geometry of a model.

    Meshes are slow to load, and a run without pictures needs none. A pickle or copy loads them again, because they are
    large.

    Args:
        load: function that loads the geometry of a kind, "visual" or "collision"; None if there is none.
    """

    def __init__(self, load: Load) -> None:
        self._load = load
        self._models: dict[str, pin.GeometryModel | None] = {}

    def get(self, kind: str) -> pin.GeometryModel | None:
        """Geometry of a kind, or None.

        Args:
            kind: "visual" or "collision".
        """
        if kind not in self._models:
            self._models[kind] = self._load(kind)
        return self._models[kind]

    def __getstate__(self) -> dict[str, object]:
        """Return the state for pickle and copy."""
        return {"_load": self._load, "_models": {}}


def _changed_geometry(
    change: Callable[[Sequence[pin.GeometryModel | None]], tuple[pin.Model, pin.GeometryModel]],
    loads: Sequence[Load],
    kind: str,
) -> pin.GeometryModel:
    """Geometry of a kind after a change of models, such as ``locked_model``."""
    return change([load(kind) for load in loads])[1]


def locked_model(
    model: pin.Model, lock: Mapping[str, JointValue], shapes: Sequence[pin.GeometryModel | None] = (None,)
) -> tuple[pin.Model, pin.GeometryModel]:
    """Return a model without the locked joints, with its geometry. Each link keeps a record of its own inertia.

    Args:
        model: the full model; it is not changed.
        lock: joint name to value of each locked joint [rad or m].
        shapes: geometry of the full model; none by default.
    """
    named = NamedModel(model)
    joints = [named.joint_id(name) for name in lock]
    if "root_joint" in lock and model.joints[named.joint_id("root_joint")].nv > 1:
        raise ModelError(f"'root_joint' cannot be locked: load the robot with {argument('base', 'fixed')} instead")
    # Pinocchio reduces model and geometry in one call, so the model is reduced again for each kind of geometry.
    found, geometry = _built(pin.buildReducedModel, [model], shapes, joints, named.configuration(lock))
    for name, joint in zip(lock, joints, strict=True):
        # Pinocchio gives the frame of a locked joint the inertia of all links that the joint moved.
        found.frames[found.getFrameId(name, pin.FrameType.FIXED_JOINT)].inertia = _moved_link(model, joint)
    return found, geometry


def attached_model(
    carrier: pin.Model,
    other: pin.Model,
    frame: int,
    placement: pin.SE3 | None = None,
    shapes: Sequence[pin.GeometryModel | None] = (None, None),
) -> tuple[pin.Model, pin.GeometryModel]:
    """Return two models joined into one, with their geometry. Gravity is the carrier's.

    Args:
        carrier: model that carries the other.
        other: attached model.
        frame: index of the carrier's frame.
        placement: pose of the other model's base in that frame; identity by default.
        shapes: geometry of both; none by default.

    Raises:
        ModelError: both have a joint or frame of the same name.
    """
    for what, first, second in (
        ("joint", list(carrier.names)[1:], list(other.names)[1:]),
        ("frame", [each.name for each in carrier.frames][1:], [each.name for each in other.frames][1:]),
    ):
        for name in second:
            if name in first:
                raise ModelError(f"robots '{carrier.name}' and '{other.name}' both have a {what} '{name}'")
    model, geometry = _built(pin.appendModel, [carrier, other], shapes, frame, placement or pin.SE3.Identity())
    model.name = f"{carrier.name} with {other.name}"
    model.gravity = carrier.gravity  # appendModel takes the gravity of the second
    return model, geometry


def _built(
    build: Callable[..., tuple[pin.Model, pin.GeometryModel]],
    models: Sequence[pin.Model],
    shapes: Sequence[pin.GeometryModel | None],
    *arguments: object,
) -> tuple[pin.Model, pin.GeometryModel]:
    """Result of a function of Pinocchio that finds frames by name alone: it is given models with unique frame names."""
    copies, names = [model.copy() for model in models], dict[str, str]()
    for model in copies:
        # Pinocchio refuses a lower limit above the upper one, which nothing else reads.
        model.lowerVelocityLimit = np.minimum(model.lowerVelocityLimit, model.upperVelocityLimit)
        counts = Counter(frame.name for frame in model.frames)
        for index, frame in enumerate(model.frames):
            if counts[frame.name] > 1 and index and frame.type != pin.FrameType.JOINT:  # frames of joints keep theirs
                names[f"{frame.name} (frame {index})"] = frame.name
                frame.name = f"{frame.name} (frame {index})"
    model, geometry = build(*copies, *(each or pin.GeometryModel() for each in shapes), *arguments)
    for frame in model.frames:
        frame.name = names.get(frame.name, frame.name)
    return model, geometry


# ---------------------------------------------------------------------- other link masses


LinkMass: TypeAlias = "float | pin.Inertia"
_ROUNDING = 1e-12  # rounding error, relative to a body's mass


def _keeper(model: pin.Model, index: int) -> pin.Frame | None:
    """Frame that records the inertia of a link alone; None for the link that a joint moves, which has no record.

    Pinocchio's own rule: the frame of a fixed joint stores the inertia of its child, and a joint's model stores the
    sum.
    """
    frames, frame = model.frames, model.frames[index]
    if _weighs(frame):
        return frame
    if frames[frame.parentFrame].type == pin.FrameType.FIXED_JOINT:
        return frames[frame.parentFrame]
    kind = frame.type, frame.parentJoint
    bodies = [(k, each) for k, each in enumerate(frames) if (each.type, each.parentJoint) == kind]
    fixed = pin.FrameType.FIXED_JOINT
    first = next(k for k, each in bodies if not _weighs(each) and frames[each.parentFrame].type != fixed)
    return None if first == index else frame


def _weighs(frame: pin.Frame) -> bool:
    return bool(frame.inertia.mass or frame.inertia.inertia.any())


def _moved_link(model: pin.Model, joint: int) -> pin.Inertia:
    """Inertia of the link that a joint moves, in its frame: the sum without what frames record of other links."""
    own = model.inertias[joint]
    for frame in model.frames:
        if frame.parentJoint == joint and _weighs(frame):
            own = own - frame.placement.act(frame.inertia)
    return own


def _new(name: str, mass: object, old: np.ndarray, placement: pin.SE3, robot: str) -> np.ndarray:
    """Dynamic parameters (10,) of a link with another mass or inertia, in its joint."""
    if isinstance(mass, pin.Inertia):
        if not (mass.mass > 0 and np.isfinite(mass.toDynamicParameters()).all()):
            raise ModelError(f"inertia for link '{name}' has to have a positive mass and finite entries, found {mass}")
        return np.array(placement.act(mass).toDynamicParameters())
    if isinstance(mass, bool) or not isinstance(mass, int | float | np.integer | np.floating) or not 0 < mass < np.inf:
        raise ModelError(f"mass of link '{name}' has to be positive [kg], or a pinocchio.Inertia, found {mass!r}")
    if not old[0] > _ROUNDING:
        raise ModelError(
            f"link '{name}' of robot '{robot}' has no mass of its own that could be scaled: give a pinocchio.Inertia"
        )
    # Same density distribution: the first moment and the inertia scale with the mass.
    return old * (float(mass) / old[0])
