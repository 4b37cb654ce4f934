"""What a URDF says that no machine is, or says twice, and that urdfdom takes without a word."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from rnc_pin.errors import ModelError, few
from rnc_pin.robots.sources.description import read_numbers
from rnc_pin.robots.sources.mending import ENDLESS

_ONCE = {"link": ("inertial",), "joint": ("origin", "axis", "limit", "dynamics", "mimic")}
_NOT_NEGATIVE = {"dynamics": ("damping", "friction"), "limit": ("effort", "velocity")}


def check_values(root: ElementTree.Element, path: Path) -> list[str]:
    """Look through links and joints; a range whose lower end is above the upper is none, as in some simulators.

    Returns:
        What counts only once, and ranges that are none, in words that can follow the file's name.

    Raises:
        ModelError: damping, friction or a limit that is negative.
    """
    for joint in root.findall("joint"):
        _check_joint(joint, path)
    endless = [str(joint.get("name")) for joint in root.findall("joint") if _is_upside_down(joint)]
    words = "has a lower limit above the upper and is taken to move without end"
    return [f"{words}: joint {few(endless)}"] * bool(endless) + [
        f"has a second <{tag}>, which is left out: {owner} {few(names)}"
        for owner, tags in _ONCE.items()
        for tag in tags
        if (names := list(_more(root, owner, tag)))
    ]


def _check_joint(joint: ElementTree.Element, path: Path) -> None:
    name = f"joint '{joint.get('name')}'"
    if joint.get("type") == "fixed":
        return
    for tag, keys in _NOT_NEGATIVE.items():
        for key in keys:
            number = _number(joint.find(tag), key)
            if number is not None and number < 0:
                raise ModelError(f"{path}: {key} of {name} is negative: {number:g}")


def _is_upside_down(joint: ElementTree.Element) -> bool:
    """Whether a lower limit is above the upper; the range is opened then."""
    limit = joint.find("limit")
    lower, upper = (_number(limit, key) or 0.0 for key in ("lower", "upper"))
    if limit is None or joint.get("type") not in ("revolute", "prismatic") or lower <= upper:
        return False
    limit.set("lower", repr(-ENDLESS))
    limit.set("upper", repr(ENDLESS))
    return True


def _number(element: ElementTree.Element | None, key: str) -> float | None:
    numbers = None if element is None else read_numbers(element.get(key, ""))
    return float(numbers[0]) if numbers is not None and numbers.size == 1 else None


def _more(root: ElementTree.Element, owner: str, tag: str) -> Iterator[str]:
    """Names of links or joints with more than one element of a kind, which lose the others."""
    for each in root.findall(owner):
        others = each.findall(tag)[1:]
        for other in others:
            each.remove(other)
        if others:
            yield str(each.get("name"))
