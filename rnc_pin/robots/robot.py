"""Robot class: a Pinocchio model with names and geometry, and its construction from files and other robots."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, ModelWarning, argument
from rnc_pin.printing import ObjectSummary, SummaryMixin, counted, items
from rnc_pin.robots import robot_files
from rnc_pin.robots.derived_models import AttachedModel, LazyGeometry, LinkMass, LockedModel, with_link_masses
from rnc_pin.robots.joint_values import JointValue, NamedModel, base_of
from rnc_pin.robots.model_checks import UselessInertia, check_model, check_model_size, massless, remedy
from rnc_pin.robots.sources.description import Closure, Description, Mimic, check_acceleration
from rnc_pin.robots.sources.urdf import read_urdf
from rnc_pin.robots.sources.urdf_links import STAND_IN

Base = Literal["fixed", "planar", "free"]


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
        far_packages: ``packages`` that were found by ``package_dirs`` or the environment, not in the folders
            above the file.
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
        self._geometry = LazyGeometry(visual=visual_model, collision=collision_model)
        self._lost: Callable[[str], Mapping[str, tuple[str, ...]]] | None = None
        self.mimics: tuple[Mimic, ...] = ()
        self.closures: tuple[Closure, ...] = ()
        self.references: Mapping[str, float] = {}
        self.locked: dict[str, float] = {}
        self._frozen: frozenset[str] = frozenset()  # all locked joints, also those with several values
        self.packages: Mapping[str, Path] = {}
        self.far_packages: Mapping[str, Path] = {}
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
        def admitted(model: pin.Model) -> Robot:
            try:
                return cls(model)
            except UselessInertia as error:
                # The model alone knows no links of the file: with them, the remedy names a mass for each.
                error.joints = massless(model, read.bodies)  # with suggested masses for the file's links
                error.args = (f"{path}: {error.what}: {remedy(error.joints)}",)
                raise error from None
            except ModelError as error:
                raise error.within(path) from None

        model = read.model
        with ModelError.at(path):
            check_model_size(model)
        if gravity is not None:
            model.gravity.linear = check_acceleration(gravity)
        locked = LockedModel(model, lock) if lock else None
        robot = admitted(model if locked is None else locked.model)
        robot._geometry = LazyGeometry(read.geometry if locked is None else partial(locked.geometry, read.geometry))
        robot._lost = read.lost
        robot.mimics, robot.closures, robot.references = read.mimics, read.closures, read.references
        robot._frozen = frozenset(lock or ())
        for name, value in (lock or {}).items():
            if np.size(value) == 1:  # mimics refer only to joints with one value
                robot.locked[name] = float(np.ravel(value)[0])
        robot.packages, robot.far_packages = read.packages, read.far_packages
        robot.folders = read.folders
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
        attached = AttachedModel(self.model, other.model, index, placement)
        robot = Robot(attached.model)
        robot._geometry = LazyGeometry(partial(attached.geometry, self._geometry, other._geometry))
        robot.mimics = (*self.mimics, *other.mimics)
        # The mounted robot moves with its carrier: a loop with the world of its own file no longer holds.
        robot.closures = (*self.closures, *(each for each in other.closures if "universe" not in each[:2]))
        if len(robot.closures) < len(self.closures) + len(other.closures):
            text = f"robot '{other.name}': its loop closures with the world are omitted, because it is mounted"
            warnings.warn(text, ModelWarning, stacklevel=2)
        robot.references = {**self.references, **other.references}
        robot.locked = {**self.locked, **other.locked}
        robot._frozen = self._frozen | other._frozen
        # Of packages with one name, this robot's folder counts, as its gravity does.
        robot.packages = {**other.packages, **self.packages}
        robot.folders = (*self.folders, *other.folders)
        robot.far_packages = {**other.far_packages, **self.far_packages}
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
        model = with_link_masses(self.model, masses, self._frozen, self.name)
        check_model(model)
        # A shallow copy shares meshes and records of the file; what masses change is replaced.
        robot = copy(self)
        robot.model, robot.locked, robot._geometry = model, dict(self.locked), copy(self._geometry)
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
        return {} if self._lost is None else self._lost(kind)

    # ------------------------------------------------------------------ print

    def _summary(self) -> ObjectSummary:
        title = f"Robot '{self.name}': {counted(self.nv, 'degree')} of freedom, {base_of(self.model)} base"
        return ObjectSummary(title, [("joints", items(self.joint_names))])
