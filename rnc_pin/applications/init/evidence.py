"""Evidence about joints: axes, limits, efforts, the words in names, what has a motor; and decisions with confidence."""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from rnc_pin.errors import few
from rnc_pin.robots import Robot

SURE = 0.95
"""Confidence in what the file or the user states."""
LIKELY = 0.8
"""Confidence in what geometry or efforts show."""
GUESSED = 0.5
"""Confidence in what names or habit suggest."""
ASKS = 0.6
"""Confidence below which a draft asks."""


@dataclass(frozen=True)
class Alternative:
    """Another answer.

    Attributes:
        answer: the answer, in words.
        choices: fields of ``DraftOptions`` that choose it, such as {"base": "planar"} or {"driven": ["left"]}.
    """

    answer: str
    choices: Mapping[str, bool | str | Sequence[str]]

    @property
    def command(self) -> str:
        """Options of ``rnc-pin init``, as typed."""
        words: list[str] = []
        for name, value in self.choices.items():
            if isinstance(value, bool):
                words.append(f"--{name}" if value else f"--no-{name}")
            else:
                words += [f"--{name} {each}" for each in ([value] if isinstance(value, str) else value)]
        return " ".join(words)


@dataclass(frozen=True)
class DraftDecision:
    """One decision of a draft.

    Attributes:
        question: what was decided, as a question.
        answer: the answer of the draft.
        confidence: confidence between 0 and 1.
        evidence: what the answer rests on.
        alternatives: other answers, with the choices that lead to them.
    """

    question: str
    answer: str
    confidence: float
    evidence: str
    alternatives: tuple[Alternative, ...] = ()

    @property
    def is_open(self) -> bool:
        """True if the draft asks, because the confidence is low."""
        return self.confidence < ASKS and bool(self.alternatives)

    def __str__(self) -> str:
        others = "; ".join(f"{each.answer}: {each.command}" for each in self.alternatives)
        said = f"{self.question} {self.answer} ({100 * self.confidence:.0f} % sure: {self.evidence})"
        return f"{said}. Otherwise {others}" if others else said


_PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def words_of(*names: str) -> list[str]:
    """Return the words of names in lower case: ``baseFootprint_2`` has the words base and footprint.

    Args:
        *names: names of links, joints or files.
    """
    return [part.lower() for name in names for part in _PARTS.findall(name)]


def has_word(pattern: str, *names: str) -> bool:
    """Return whether a word of the names, or two neighbouring words joined by "_", match a pattern from end to end.

    So "roller" is not found in "controller", and "foot" not in "footprint". A plural with "s" matches too.

    Args:
        pattern: regular expression of a whole word.
        *names: names of links, joints or files.
    """
    whole = re.compile(f"(?:{pattern})s?")
    # "king_pin", "kingPin" and "king-pin" are one word for a person.
    pairs = ("_".join(pair) for name in names for pair in itertools.pairwise(words_of(name)))
    return any(whole.fullmatch(each) for each in (*words_of(*names), *pairs))


def joint_limits(robot: Robot, name: str) -> tuple[float, float]:
    """Position limits of a joint [rad or m]; infinite if the file gives none.

    Args:
        robot: the robot.
        name: name of the joint.
    """
    joint = robot.model.joints[robot.joint_id(name)]
    if joint.nq != 1:  # cosine and sine of a continuous joint: the model's limits are those of these two numbers
        return -np.inf, np.inf
    low, high = robot.model.lowerPositionLimit[joint.idx_q], robot.model.upperPositionLimit[joint.idx_q]
    # Equal limits are zeros that an exporter wrote for none; where they are meant, the joint is locked before.
    return (float(low), float(high)) if low < high else (-np.inf, np.inf)


def joint_range(robot: Robot, name: str, leaders: tuple[str, ...] = ()) -> tuple[float, float]:
    """Position limits of a joint at which its mimic joints are within their limits too [rad or m].

    The lower value is above the upper one if there is no such position. ``leaders`` are joints that it mimics itself.

    Args:
        robot: the robot.
        name: name of the joint.
        leaders: joints that it mimics itself.
    """
    low, high = joint_limits(robot, name)
    leaders = (*leaders, name)
    for follower in robot.mimics:
        # Mimic joints of a file may form a circle: each joint counts once.
        is_new = follower.joint in robot.joint_names and follower.joint not in leaders
        if follower.of == name and follower.multiplier and is_new:
            reach = joint_range(robot, follower.joint, leaders)  # its own followers limit it, too
            ends = [(end - follower.offset) / follower.multiplier for end in reach]
            first, last = ends if follower.multiplier > 0 else reversed(ends)  # not sorted: low > high tells "none"
            low, high = max(low, first), min(high, last)
    return low, high


def effort_limit(robot: Robot, name: str) -> float:
    """Effort limit of a joint with one degree of freedom [N or N m]; 0 if the file gives none.

    Args:
        robot: the robot.
        name: name of the joint.
    """
    return float(robot.model.upperEffortLimit[robot.velocity_indices(name).start])


_ONLY_READS = re.compile("state_?publisher|p3d|odometry_?publisher", re.IGNORECASE)


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
    driven: Collection[str] = ()
    passive: Collection[str] = ()

    def says(self, joint: str) -> bool | None:
        """Return whether options and lists call a joint driven, or None if both are silent.

        Args:
            joint: name of the joint.
        """
        # An option counts more than the file: it is how a user corrects a draft.
        if joint in self.driven or joint in self.passive:
            return joint in self.driven
        if joint in self.named:
            return True
        # A file that lists motors joint by joint would list this one too.
        return False if self.is_list else None

    def driven_of(self, joints: Collection[str], usual: Iterable[str]) -> DrivenJoints:
        """Return the driven ones of several joints of one kind, such as wheels.

        Args:
            joints: joint names.
            usual: those that usually are driven, if nothing else tells.
        """
        # From statements over numbers to words: each step is taken only if the one before tells nothing.
        named = [each for each in joints if self.says(each)]
        sources = list(dict.fromkeys("an option" if each in self.driven else self.named[each] for each in named))
        if named:
            return DrivenJoints(tuple(named), SURE, f"named by {few(sources)}")
        possible = [each for each in joints if each not in self.passive]
        usual = [each for each in usual if each in possible] or possible
        for group in (usual, possible):  # an infinite effort is none that the file states
            strong = [each for each in group if 0 < self.efforts.get(each, 0.0) < np.inf]
            weak = [each for each in group if self.efforts.get(each) == 0]
            if strong and weak:
                return DrivenJoints(tuple(strong), LIKELY, f"effort 0 of {few(weak)}")
        # A file may state efforts of motors, and no limit at all for wheels that turn freely.
        stated = [each for each in possible if 0 < self.efforts.get(each, 0.0) < np.inf]
        if 0 < len(stated) < len(possible):
            return DrivenJoints(tuple(stated), LIKELY, "only they have an effort in the file")
        drives = "drive|driven|driving|traction|motor|powered|propulsion"
        called = [each for each in possible if has_word(drives, each)]
        # A word on every wheel, such as "motor", distinguishes none.
        if called and len(called) < len(possible):
            return DrivenJoints(tuple(called), GUESSED, "by their names")
        sure = LIKELY if len(usual) == len(possible) else GUESSED
        return DrivenJoints(tuple(usual), sure, "as usual, because the file names no motor")

    def unlisted(self, joints: Collection[str]) -> list[str]:
        """Return the joints beside the base that options or the file's list of motors leave out.

        A list of a URDF that names none of several joints is a list of the base alone.

        Args:
            joints: names of the joints beside the base.
        """
        left = [each for each in joints if self.says(each) is False]
        several = 3  # number of joints beside the base above which a list that names none is one of the base alone
        # An arm of four joints has motors, whoever forgot to list them; one or two joints may well hang loose.
        of_base = not self.is_complete and len(left) == len(joints) > several
        return [each for each in left if each in self.passive] if of_base else left


class DrivenJoints(NamedTuple):
    """Driven joints among several of one kind.

    Attributes:
        joints: their names.
        confidence: confidence between 0 and 1.
        evidence: what says so.
    """

    joints: tuple[str, ...]
    confidence: float
    evidence: str


def mimic_drivers(robot: Robot, drives: DriveEvidence) -> dict[str, str]:
    """Return the driver of each joint that moves with it by a mimic of the file.

    The driver is the leader, or a follower if the file or an option gives the motor to it. A locked leader stays the
    driver.

    Args:
        robot: the robot.
        drives: evidence for which joints have a motor.
    """
    follows = {each.joint: each.of for each in robot.mimics if each.joint in robot.joint_names}
    still = {each.joint for each in robot.mimics if not each.multiplier}  # these stand, and can lead nothing
    groups: dict[str, list[str]] = {}
    for joint in follows:
        groups.setdefault(_last_leader(joint, follows), []).append(joint)
    drivers: dict[str, str] = {}
    for leader, followers in groups.items():
        able = [leader, *(each for each in followers if each not in still)] if leader in robot.joint_names else [leader]
        # That for whose motor most speaks: a statement counts more than an effort.
        driver = max(able, key=lambda each: (drives.says(each) is True, drives.efforts.get(each, 0.0) > 0))
        # One motor moves the whole group, whatever efforts the file gives to the others.
        drivers |= {joint: driver for joint in (leader, *followers) if joint != driver}
    return drivers


def _last_leader(joint: str, follows: Mapping[str, str]) -> str:
    """Last leader in a joint's chain of mimics; the chain may be a circle."""
    seen = {joint}
    while joint in follows and follows[joint] not in seen:
        joint = follows[joint]
        seen.add(joint)
    return joint


def named_as_driven(robot: ElementTree.Element) -> tuple[dict[str, str], bool]:
    """Return what names each driven joint of a URDF, and whether the file lists motors by joint.

    Args:
        robot: root element of the URDF.
    """
    joints = {str(joint.get("name")) for joint in robot.findall("joint")}
    # A joint with state interfaces alone is measured, not driven.
    sources = {".//ros2_control/joint[command_interface]": "ros2_control", ".//transmission/joint": "a transmission"}
    found = ((str(each.get("name")), source) for path, source in sources.items() for each in robot.iterfind(path))
    listed = {joint: source for joint, source in found if joint in joints}  # files keep entries of removed joints
    # Plugins have elements such as <left_joint> or <joint_name>, with names that blanks or commas separate.
    plugins = [each for each in robot.iterfind("gazebo/plugin") if not _ONLY_READS.search(str(each.attrib))]
    texts = [element.text or "" for each in plugins for element in each.iter() if "joint" in element.tag.lower()]
    plugged = {joint: "a plugin" for text in texts for joint in re.split(r"[\s,]+", text) if joint in joints}
    # A transmission says more than a plugin, whose names may be those of the base alone.
    return {**plugged, **listed}, bool(listed)
