"""Robot file of a draft, with the masses and locked joints that a simulation needs."""

from __future__ import annotations

import dataclasses
import os
import shlex
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from rnc_pin.applications.init.evidence import DriveEvidence, effort_limit, named_as_driven
from rnc_pin.applications.init.robot_at_start import GEOMETRY, PLACED, FileNames, shapes
from rnc_pin.applications.scenario.files import robot_names, urdf_path
from rnc_pin.applications.scenario.schema.scenario import admitted
from rnc_pin.applications.scenario.schema.world import RobotSource
from rnc_pin.errors import ModelError, nearest, place_of
from rnc_pin.io import Json
from rnc_pin.robots import Massless, Robot, UselessInertia, mass_of_box
from rnc_pin.robots.sources import Packages, parse_urdf, parse_xml, read_number

Lock = Mapping[str, float | list[float]]


@dataclass(frozen=True)
class DraftOptions:
    """User's choices that replace guesses of a draft.

    Attributes:
        base: "fixed", "planar" or "free".
        xacro_arguments: values for the arguments of a xacro file.
        package_dirs: folders of packages.
        lock: joints to lock, with their values.
        driven: joints with a motor.
        passive: joints without a motor.
        balance: whether the base balances; None if the draft decides.
        rollers: whether the wheels have rollers, as Mecanum and omni wheels do; None if the draft decides.
    """

    base: str | None = None
    xacro_arguments: Mapping[str, Json] | None = None
    package_dirs: Sequence[Path] = ()
    lock: Mapping[str, float] | None = None
    driven: Sequence[str] = ()
    passive: Sequence[str] = ()
    balance: bool | None = None
    rollers: bool | None = None

    def with_choices(self, new: Mapping[str, bool | str | Sequence[str]]) -> DraftOptions:
        """Return these choices with those of an alternative; its joints are added to the joints named before.

        Args:
            new: fields of these options with their values.
        """
        joined: dict[str, Any] = {
            name: value if isinstance(value, bool | str) else (*vars(self)[name], *value) for name, value in new.items()
        }
        return dataclasses.replace(self, **joined)


class Source:
    """Robot file that can be loaded with different bases.

    Args:
        name: a file, the name of a URDF shipped with rnc_pin or of a robot of example-robot-data.
        folder: folder of the scenario.
        wishes: user's choices that replace guesses.

    Attributes:
        folder: folder of the scenario.
        options: user's choices.
        entry: robot entry of the scenario, without base and locked joints.
        masses: mass [kg] by link, for links without a usable inertia.
        held: joints to lock, with their values.
        notes: changes to joints, a line each.

    Raises:
        ModelError: the robot does not exist.
    """

    def __init__(self, name: str, folder: Path, wishes: DraftOptions) -> None:
        self.name, self.folder, self.options = Path(name).name, folder, wishes
        self.entry = _entry(name, folder)
        if wishes.xacro_arguments:
            self.entry["xacro_arguments"] = dict(wishes.xacro_arguments)
        if wishes.package_dirs:
            self.entry["package_dirs"] = [str(each.resolve()) for each in wishes.package_dirs]
        self.masses: dict[str, float] = {}
        self.held = dict(wishes.lock or {})
        self.notes: list[str] = []

    def load(self, base: str | None, lock: Lock | None = None) -> Robot:
        """Return the robot; a joint that moves no mass is locked or its links get a mass, from now on.

        Args:
            base: "fixed", "planar", "free", or None for the base of the file.
            lock: joints to lock, with their values [rad or m].
        """
        while True:  # a mass given to one link shows the next joint that moves none
            try:
                robot = self.load_unchanged(base, lock)
            except UselessInertia as error:
                if not self._repair_inertias(error.joints):
                    raise
                continue
            # Carried links would hide it: the base itself would turn without inertia about its own axes.
            link = None if base in (None, "fixed") else _weightless_base(robot)
            if link is None or link in self.masses:
                return robot
            self.masses[link] = mass_of_box(_volume(robot))

    def load_unchanged(self, base: str | None, lock: Lock | None = None) -> Robot:
        """Return the robot without such changes; a joint that moves no mass is an error.

        Args:
            base: "fixed", "planar", "free", or None for the base of the file.
            lock: joints to lock, with their values [rad or m].
        """
        raw = {**self.robot_entry(base), "lock": {**self.held, **(lock or {})}}
        return admitted(RobotSource, raw, "robot").build(self.folder)

    def robot_entry(self, base: str | None) -> dict[str, Json]:
        """Return the robot entry with a base.

        Args:
            base: "fixed", "planar", "free", or None for the base of the file.
        """
        masses: dict[str, Json] = {"masses": dict(self.masses)} if self.masses else {}
        return {**self.entry, **masses, **({} if base is None else {"base": base})}

    def load_for_detection(self) -> tuple[Robot, bool]:
        """Return the robot without an added base and False, or with a free base and True if it is one rigid body.

        Joints whose limits leave no motion are locked from now on.
        """
        self._lock_motionless()
        base = None if self.is_mjcf else "fixed"
        try:
            robot = self.load(base)
            return self.load(base) if self._lock_leaders(robot) else robot, False
        except ModelError:
            # A URDF of one link has no joint at all; on a free base it has six. An MJCF has its base in the file.
            with suppress(ModelError):
                if not self.is_mjcf and (robot := self.load_unchanged("free")).nv == 6:
                    return robot, True
            raise

    @property
    def is_mjcf(self) -> bool:
        """True for an MJCF file, which names its actuators."""
        return "mjcf" in self.entry

    @property
    def remarks(self) -> list[str]:
        """Additions to the file, a line each."""
        said = f"links without a useful inertia are given one, WEIGH them: {', '.join(self.masses)}"
        return [*self.notes, said] if self.masses else self.notes

    def names(self) -> FileNames:
        """Return names that the model does not contain."""
        root = self._urdf
        if root is None:
            return FileNames(self.name)
        # Plugins of sensors are named after cameras and lasers: they say nothing of the base.
        sensors = {id(each) for sensor in root.iter("sensor") for each in sensor.iter("plugin")}
        plugins = [value for each in root.iter("plugin") if id(each) not in sensors for value in each.attrib.values()]
        meshes = {
            str(link.get("name")): " ".join(Path(each.get("filename", "")).name for each in link.iter("mesh"))
            for link in root.iter("link")
        }
        return FileNames(f"{self.name} {root.get('name', '')}", " ".join(plugins), meshes)

    def drive_evidence(self, robot: Robot) -> DriveEvidence:
        """Return which joints have a motor, as far as options and the file tell.

        Args:
            robot: the robot.

        Raises:
            ModelError: an option names an unknown joint.
        """
        options = self.options
        for option, joints in (("driven", options.driven), ("passive", options.passive)):
            for joint in joints:
                place_of(joint, robot.joint_names, f"--{option} {joint}: no joint", ModelError)
        single = robot.single_joint_names
        efforts = {name: effort_limit(robot, name) for name in single}
        if self._urdf is None:  # an MJCF: only joints with an actuator have an effort, without a limit an infinite one
            named, is_list = {name: "an actuator" for name in single if efforts[name] > 0}, any(efforts.values())
        else:
            named, is_list = named_as_driven(self._urdf)
        return DriveEvidence(named, is_list, efforts, self.is_mjcf, options.driven, options.passive)

    @cached_property
    def _urdf(self) -> ElementTree.Element | None:
        """Root element of a URDF, expanded; None for an MJCF."""
        path, options = urdf_path(self.entry, self.folder), self.options
        if path is None:
            return None
        return parse_urdf(path, options.xacro_arguments, Packages(path.parent, options.package_dirs))

    def remember_packages(self, robot: Robot) -> None:
        """Add package folders that another shell would not find to the entry.

        Args:
            robot: the robot.
        """
        given = [each.resolve() for each in self.options.package_dirs]
        # Packages of ROS_PACKAGE_PATH: the shell that runs the scenario may not have it.
        path = urdf_path(self.entry, self.folder) or self.folder
        near = Packages(path.parent)
        found = [folder for name, folder in robot.packages.items() if not near.is_near(name, folder)]
        far = [each for each in found if not {each, *each.parents} & set(given)]
        if given or far:
            folder = self.folder.resolve()
            self.entry["package_dirs"] = [os.path.relpath(each, folder) for each in dict.fromkeys([*given, *far])]

    def _lock_motionless(self) -> None:
        if self._urdf is None:
            return
        still: dict[str, float] = {}
        for joint in self._urdf.findall("joint"):
            limit = joint.find("limit")
            if limit is None or joint.get("type") not in ("revolute", "prismatic") or joint.find("mimic") is not None:
                continue
            low, high = (read_number(limit.get(key)) for key in ("lower", "upper"))
            if low is not None and high is not None and 0 <= high - low < PLACED:
                still[str(joint.get("name"))] = (low + high) / 2
        movable = sum(joint.get("type") != "fixed" for joint in self._urdf.findall("joint"))
        # Equal limits everywhere are an exporter's zeros. On some joints only, they are meant.
        if still and len(still) == movable:
            self.notes.append("the file states no limits: lower and upper are equal for every joint")
            return
        self.hold(still, "the limits of the file leave no motion", still)

    def hold(self, joints: Iterable[str], why: str, values: Mapping[str, float] | None = None) -> None:
        """Lock joints from now on, at zero or at given values, and note the reason.

        Args:
            joints: names of joints.
            why: reason, in words.
            values: values of the joints [rad or m]; 0 for a joint without one.
        """
        new = {name: (values or {}).get(name, 0.0) for name in joints if name not in self.held}
        self.held.update(new)
        if new:
            self.notes.append(f"locked, because {why}: {', '.join(new)}")

    def _lock_leaders(self, robot: Robot) -> bool:
        """Lock the joints that mimic joints locked by the user follow; return True if there are any."""
        new: dict[str, float] = {}
        chosen = dict(self.options.lock or {})
        for mimic in [each for _ in robot.mimics for each in robot.mimics]:  # mimic joints can form chains
            joint, of, multiplier, offset = mimic
            # The leader alone would move; the pair was meant to stand.
            if joint in chosen and of in robot.joint_names and of not in chosen and multiplier:
                chosen[of] = new[of] = round((chosen[joint] - offset) / multiplier, 9) + 0.0
                self.notes.append(f"locked together with {joint}, which mimics it: {of}")
        self.held.update(new)
        return bool(new)

    def mass_of_base(self) -> float:
        """Return the mass of the first link [kg]; 0 for a ground or world link."""
        with suppress(ModelError):
            return float(self.load_unchanged("free").model.inertias[1].mass)
        return 0.0

    def _repair_inertias(self, joints: Sequence[Massless]) -> bool:
        """Give links a mass, or lock joints without any child mass or shape; return True if something changed."""
        base = "root_joint"  # a massless base gets a mass; it is not locked
        # Without mass and shape, a joint moves a frame: it is locked. With a shape, somebody forgot the mass.
        idle = [each.joint for each in joints if each.idle and not each.shaped and each.joint != base]
        given = {link: mass for each in joints if each.joint not in idle for link, mass in each.masses.items()}
        new = {link: mass for link, mass in given.items() if link not in self.masses}
        if new:  # joints that carry these links move some mass from now on
            self.masses.update(new)
            return True
        before = len(self.held)
        self.hold(idle, "they move no mass")
        return len(self.held) > before


def _weightless_base(robot: Robot) -> str | None:
    """First link of a movable base that has a shape but no mass, or None."""
    if robot.model.inertias[1].mass > 0 or not _volume(robot):
        return None
    return next(iter(robot.links_of(1)), None)


def _volume(robot: Robot) -> float:
    """Volume of the box around the shapes of the base [m^3]."""
    q = robot.configuration()
    everything = [[each for each in shapes(robot, kind, q) if each.joint == 1] for kind in GEOMETRY]
    parts = next((each for each in everything if each), [])
    if not parts:
        return 0.0
    low = np.min([each.points.min(axis=0) - each.margin for each in parts], axis=0)
    high = np.max([each.points.max(axis=0) + each.margin for each in parts], axis=0)
    return float(np.prod(high - low))


def _entry(source: str, folder: Path) -> dict[str, Json]:
    path = Path(source).expanduser()
    if os.path.isfile(path):
        if path.suffix in (".yaml", ".yml"):
            raise ModelError(f"{path}: that is a scenario, not a robot: run it with: rnc-pin run {shlex.quote(source)}")
        # The root element and not the ending tells: both formats end in .xml.
        is_mjcf = path.suffix != ".xacro" and parse_xml(path).tag == "mujoco"
        return {"mjcf" if is_mjcf else "urdf": os.path.relpath(path.resolve(), folder.resolve())}
    if os.path.isdir(path):
        raise ModelError(f"'{source}' is a folder, expected a robot's file")
    if source not in robot_names():
        raise ModelError(f"no robot '{source}': neither a file nor a name{nearest(source, robot_names())}")
    return {"urdf" if source.endswith(".urdf") else "example": source}
