"""Kind of the base that a draft assumes, as a value without names."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from rnc_pin.io.safe_read import parse_tree

_HEADS = ("First draft for", "NOT CONFIRMED: ", "CHECK: ", "Note: ", "QUESTION: ", "Decided: ", "Assumed: ", "base ")

# What a draft says of a base, by family; the first that fits.
_FAMILIES = {
    "balancing": "balances", "bicycle": "bicycle", "Mecanum": "Mecanum",
    "omni": "omni wheels", "tracks": "on tracks", "skid-steered": "skid-steered", "turret": "turret",
    "steered drives": "steered drives", "tricycle": "tricycle", "car": "like a car", "differential": "differential",
    "one wheel": "one wheel", "forces": "in any direction", "drawn wheels": "wheels are drawn",
    "own planar joints": "joints of the file let it move",
    "floating": "one rigid body|limbs on one body|something that floats|mass in the first link|free joint in the file",
    "bolted": "bolted down",
}  # fmt: skip


@dataclass(frozen=True)
class DraftedBase:
    """Kind of base of a draft."""

    base: str  # "fixed", "planar", "free", or "file" for the base of the file
    family: str  # e.g. "skid-steered"; the draft's own words if none is known
    trailers: int
    wheels: int  # that the draft counts, or that roll
    actuators: int  # inputs of the base: forces and torques on it, and joints between the base and a wheel

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


def base_kind(draft: str, urdf: str) -> DraftedBase:
    """Return the kind of base of a draft for a URDF."""
    words, content = kind_words(draft), yaml.safe_load(draft)
    rolling = _rolling(content)
    counted = re.search(r"(\d+) (?:\w+ )?wheels?\b", words)
    towed = re.search(r"with (\d+) trailer", words)
    return DraftedBase(
        content["robot"].get("base", "file"), _family(words), int(towed[1]) if towed else 0,
        int(counted[1]) if counted else len(rolling), len(_of_base(content, urdf)),
    )  # fmt: skip


def _family(words: str) -> str:
    said = words.partition(": ")[2]
    return next((family for family, pattern in _FAMILIES.items() if re.search(pattern, said)), said)


def _rolling(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [entry for each in content["constraints"] for kind, entry in each.items() if kind.startswith("rolling_")]


def _of_base(content: Mapping[str, Any], urdf: str) -> list[str]:
    """Actuators of the base: names of joints, and an empty string for each force and torque."""
    above = _joints_above(urdf)
    edges = [each["no_side_slip"] for each in content["constraints"] if "no_side_slip" in each]
    carrying = {joint for each in (*_rolling(content), *edges) for joint in above.get(each["frame"], [])}
    given = [each if isinstance(each, str) else "" for each in content["actuators"]]
    return [each for each in given if not each or each in carrying]


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
