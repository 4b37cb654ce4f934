"""Evidence for which joints have a motor: options, lists of the file, efforts, names."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from rnc_pin.applications.init.decision import GUESSED, LIKELY, SURE
from rnc_pin.applications.init.joint_properties import has_word
from rnc_pin.errors import few

_ONLY_READS = re.compile("state_?publisher|p3d|odometry_?publisher", re.IGNORECASE)
_DRIVES = "drive|driven|driving|traction|motor|powered|propulsion"
_MANY = 3  # number of joints beside the base above which a list that names none of them is a list of the base alone
_OPTION = "an option"


@dataclass(frozen=True)
class DriveEvidence:
    """Evidence for which joints have a motor, the strongest first: options, lists of the file, efforts.

    Attributes:
        named: by joint, where the file names it as driven: "a transmission", "ros2_control", "a plugin", "an actuator".
        is_list: True if the file lists motors by joint, as transmissions, ros2_control and actuators of an MJCF do; a
            plugin only names the joints of the base.
        efforts: effort limit by joint [N or N m], infinite if the file gives none.
        is_complete: True if the file cannot leave out a motor: an MJCF names all of them.
        driven: joints that the user called driven.
        passive: joints that the user called passive.
    """

    named: Mapping[str, str]
    is_list: bool
    efforts: Mapping[str, float]
    is_complete: bool = False
    driven: frozenset[str] = frozenset()
    passive: frozenset[str] = frozenset()

    def says(self, joint: str) -> bool | None:
        """Return whether options and lists call a joint driven, or None if both are silent."""
        if joint in self.driven or joint in self.passive:
            return joint in self.driven
        if joint in self.named:
            return True
        return False if self.is_list else None

    def drives(self, joint: str) -> bool:
        """Return whether a joint is probably driven, without other joints of its kind to compare it with."""
        said = self.says(joint)
        if said is None and self.named:
            return False
        return self.efforts.get(joint, 0.0) > 0 if said is None else said

    def driven_of(self, joints: Collection[str], usual: Iterable[str]) -> DrivenJoints:
        """Return the driven ones of several joints of one kind, such as wheels.

        Args:
            joints: joint names.
            usual: those that usually are driven, if nothing else tells.
        """
        named = [each for each in joints if self.says(each)]
        sources = list(dict.fromkeys(self.source(each) for each in named))
        if named:
            return DrivenJoints(tuple(named), SURE, f"named by {few(sources)}")
        possible = [each for each in joints if each not in self.passive]
        usual = [each for each in usual if each in possible] or possible
        for group in (usual, possible):  # an infinite effort is none that the file states
            strong = [each for each in group if 0 < self.efforts.get(each, 0.0) < np.inf]
            weak = [each for each in group if self.efforts.get(each) == 0]
            if strong and weak:
                return DrivenJoints(tuple(strong), LIKELY, f"effort 0 of {few(weak)}")
        called = [each for each in possible if has_word(_DRIVES, each)]
        if called and len(called) < len(possible):
            return DrivenJoints(tuple(called), GUESSED, "by their names")
        sure = LIKELY if len(usual) == len(possible) else GUESSED
        return DrivenJoints(tuple(usual), sure, "as usual, because the file names no motor")

    def source(self, joint: str) -> str:
        """Return what names a joint as driven."""
        return _OPTION if joint in self.driven else self.named[joint]

    def unlisted(self, joints: Collection[str]) -> list[str]:
        """Return the joints beside the base that options or the file's list of motors leave out.

        A list of a URDF that names none of several joints is a list of the base alone.
        """
        left = [each for each in joints if self.says(each) is False]
        of_base = not self.is_complete and len(left) == len(joints) > _MANY
        return [each for each in left if each in self.passive] if of_base else left


@dataclass(frozen=True)
class DrivenJoints:
    """Driven joints among several of one kind.

    Attributes:
        joints: their names.
        confidence: confidence between 0 and 1.
        evidence: what says so.
    """

    joints: tuple[str, ...]
    confidence: float
    evidence: str


def named_as_driven(robot: ElementTree.Element) -> tuple[dict[str, str], bool]:
    """Return what names each driven joint of a URDF, and whether the file lists motors by joint."""
    joints = {str(joint.get("name")) for joint in robot.findall("joint")}
    listed = {
        **dict.fromkeys(_ros2_control(robot), "ros2_control"),
        **dict.fromkeys(_transmissions(robot), "a transmission"),
    }
    listed = {joint: source for joint, source in listed.items() if joint in joints}
    return {**{joint: "a plugin" for joint in _plugins(robot) if joint in joints}, **listed}, bool(listed)


def _transmissions(robot: ElementTree.Element) -> Iterator[str]:
    for joint in robot.iterfind(".//transmission/joint"):
        yield str(joint.get("name"))


def _ros2_control(robot: ElementTree.Element) -> Iterator[str]:
    for joint in robot.iterfind(".//ros2_control/joint"):
        if joint.find("command_interface") is not None:
            yield str(joint.get("name"))


def _plugins(robot: ElementTree.Element) -> Iterator[str]:
    """Names in elements such as ``<left_joint>`` or ``<joint_name>``, separated by blanks or commas."""
    for plugin in robot.iterfind("gazebo/plugin"):
        if _ONLY_READS.search(f"{plugin.get('name')} {plugin.get('filename')}"):
            continue
        for element in plugin.iter():
            if "joint" in element.tag.lower() and element.text:
                yield from re.split(r"[\s,]+", element.text.strip())
