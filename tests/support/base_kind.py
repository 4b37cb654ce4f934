"""Kind of the base that a draft assumes, as a value without names."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import yaml

from rnc_pin.io.safe_read import parse_tree

_HEADS = ("First draft for", "NOT CONFIRMED: ", "CHECK: ", "Note: ", "QUESTION: ", "Decided: ", "Assumed: ", "base ")

# What a draft says of a base, by family; the first that fits.
_FAMILIES = {
    "snake": "a snake", "sphere": "a ball that", "balancing": "balances", "bicycle": "bicycle", "Mecanum": "Mecanum",
    "omni": "omni wheels", "tracks": "on tracks", "skid-steered": "skid-steered", "turret": "turret",
    "steered drives": "steered drives", "tricycle": "tricycle", "car": "like a car", "differential": "differential",
    "one wheel": "one wheel", "forces": "in any direction", "drawn wheels": "wheels are drawn",
    "own planar joints": "joints of the file let it move",
    "floating": "one rigid body|limbs on one body|something that floats|mass in the first link|free joint in the file",
    "bolted": "bolted down",
}  # fmt: skip


@dataclass(frozen=True)
class BaseKind:
    """Kind of base.

    Attributes:
        base: "fixed", "planar", "free", or "file" for the base of the file.
        family: e.g. "skid-steered"; the draft's own words if none is known.
        trailers: how many are towed.
        wheels: how many roll; of wheels that are only drawn, how many the draft counts.
        actuators: inputs of the base: forces and torques on it, and joints between the base and a wheel.
    """

    base: str
    family: str
    trailers: int
    wheels: int
    actuators: int

    def __str__(self) -> str:
        towing = f", {self.trailers} trailers" if self.trailers else ""
        return f"{self.base} {self.family}{towing}, {self.wheels} wheels, {self.actuators} inputs"


def comments(draft: str) -> list[str]:
    """Remarks of a draft, each in one line: those above its entries, then those beside them."""
    above: list[str] = []
    wraps = False
    for line in draft.splitlines():
        said = line.removeprefix("# ") if line.startswith("# ") else ""
        if said.startswith(_HEADS) or (said and not wraps):
            above.append(said)
        elif said:
            above[-1] += f" {said}"
        wraps = bool(said)
    return above + [line.partition("  # ")[2] for line in draft.splitlines() if line[:1] == " " and "  # " in line]


def kind_words(draft: str) -> str:
    """Words of a draft for its base, from "base" on; empty if it has none."""
    return next((each for each in comments(draft) if each.startswith("base ")), "")


def base_kind(draft: str, urdf: str) -> BaseKind:
    """Return the kind of base of a draft for a URDF."""
    words, content = kind_words(draft), yaml.safe_load(draft)
    rolling = _rolling(content)
    counted = re.search(r"(\d+) (?:\w+ )?wheels?\b", words)
    towed = re.search(r"with (\d+) trailer", words)
    return BaseKind(
        content["robot"].get("base", "file"), _family(words), int(towed[1]) if towed else 0,
        len(rolling) or (int(counted[1]) if counted else 0), len(_of_base(content, urdf)),
    )  # fmt: skip


def explanation(before: BaseKind, after: BaseKind, draft: str, concerned: Iterable[str]) -> str:
    """Return the remark of a draft that says why its kind is not the one before, or an empty string.

    It names the former family, or wheels and actuators that are concerned. A question may name the option of the former
    base instead. What the draft is sure of does not count, and neither does ``--base`` as a general alternative.

    Args:
        before: kind that was expected.
        after: kind of the draft.
        draft: the draft.
        concerned: joints and links that the difference is about.
    """
    names = [re.compile(rf"(?<![\w/.-]){re.escape(each)}(?![\w/-])") for each in concerned]
    if before.family != after.family:
        names.append(re.compile(_FAMILIES.get(before.family, re.escape(before.family)), re.IGNORECASE))
    for each in comments(draft):
        asks = each.startswith("QUESTION: ")
        if each.startswith(("base ", "First draft", "Decided: ")) or ("--base" in each and not asks):
            continue
        if any(name.search(each) for name in names) or (asks and f"--base {before.base}" in each):
            return each
    return ""


def base_parts(draft: str, urdf: str) -> tuple[set[str], set[str]]:
    """Frames and joints of the wheels that roll, and actuators of the base that are joints."""
    content, above = yaml.safe_load(draft), _joints_above(urdf)
    frames = [each["frame"] for each in _rolling(content)]
    wheels = {*frames, *(above[each][0] for each in frames if above.get(each))}
    return wheels, {*_of_base(content, urdf)} - {""}


def wheel_axles(draft: str, urdf: str) -> tuple[list[list[str]], list[str]]:
    """Joints of the wheels that roll on the base itself, by axle from rear to front, and the other driven joints.

    The heading of the first wheel is forward. Only wheels that are parallel to it belong to an axle.
    """
    content, above = yaml.safe_load(draft), _joints_above(urdf)
    on_base = {above[each["frame"]][0]: each["radius"] for each in _rolling(content) if len(above[each["frame"]]) == 1}
    robot = parse_tree(urdf)
    joints = {each.find("child").get("link"): each for each in robot.findall("joint")}
    places: list[tuple[float, str]] = []
    heading = None
    for link, joint in joints.items():
        if joint.get("name") not in on_base:
            continue
        placement = _at_zero(link, joints)
        axis = joint.find("axis")
        axle = placement.rotation @ np.array((axis.get("xyz") if axis is not None else "1 0 0").split(), float)
        along = np.cross(axle / np.linalg.norm(axle), [0.0, 0.0, 1.0])
        heading = along if heading is None else heading
        if abs(along @ heading) > 0.99:
            places.append((float(heading @ placement.translation), joint.get("name", "")))
    axles: list[list[str]] = []
    last = -np.inf
    for place, name in sorted(places):
        if place - last > 0.5 * on_base[name]:
            axles.append([])
        axles[-1].append(name)
        last = place
    wheels = {name for _, name in places}
    return axles, [each for each in content["actuators"] if isinstance(each, str) and each not in wheels]


def _family(words: str) -> str:
    said = words.partition(": ")[2]
    return next((family for family, pattern in _FAMILIES.items() if re.search(pattern, said)), said)


def _rolling(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [entry for each in content["constraints"] for kind, entry in each.items() if kind.startswith("rolling_")]


def _of_base(content: Mapping[str, Any], urdf: str) -> list[str]:
    """Actuators of the base: names of joints, and an empty string for each force and torque."""
    above = _joints_above(urdf)
    carrying = {joint for each in _rolling(content) for joint in above.get(each["frame"], [])}
    given = [each if isinstance(each, str) else "" for each in content["actuators"]]
    return [each for each in given if not each or each in carrying]


def _at_zero(link: str, joints: Mapping[str, ElementTree.Element]) -> pin.SE3:
    """Placement of a link in the root link, with all joints at zero; joints by the names of their children."""
    placement = pin.SE3.Identity()
    while link in joints:
        origin = joints[link].find("origin")
        said = origin.attrib if origin is not None else {}
        place, angles = (np.array(said.get(key, "0 0 0").split(), float) for key in ("xyz", "rpy"))
        placement = pin.SE3(pin.rpy.rpyToMatrix(angles), place) * placement
        link = joints[link].find("parent").get("link")
    return placement


def _joints_above(urdf: str) -> dict[str, list[str]]:
    """Movable joints between a link, or a joint, and the root, the nearest first."""
    robot = parse_tree(urdf)
    joints = {each.find("child").get("link"): each for each in robot.findall("joint")}
    above: dict[str, list[str]] = {}
    for link in (each.get("name", "") for each in robot.findall("link")):
        chain, at = [], link
        while at in joints:
            joint = joints[at]
            if joint.get("type") != "fixed":
                chain.append(joint.get("name", ""))
            at = joint.find("parent").get("link")
        above[link] = chain
    for link, joint in joints.items():
        above.setdefault(joint.get("name", ""), above[link])
    return above
