"""What a URDF says that no machine is, or says twice, and that urdfdom takes without a word."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from rnc_pin.errors import ModelError, few
from rnc_pin.robots.sources.description import read_number

_ONCE = {"link": ("inertial",), "joint": ("origin", "axis", "limit", "dynamics", "mimic")}
_NOT_NEGATIVE = {"dynamics": ("damping", "friction"), "limit": ("effort", "velocity")}


def check_values(root: ElementTree.Element, path: Path) -> list[str]:
    """Look through links and joints; of what counts only once the second is left out.

    Returns:
        What was left out, in words that can follow the file's name.

    Raises:
        ModelError: damping, friction or a limit that is negative.
    """
    for joint in root.findall("joint"):
        _check_joint(joint, path)
    return [
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
            element = joint.find(tag)
            number = None if element is None else read_number(element.get(key))
            if number is not None and number < 0:
                raise ModelError(f"{path}: {key} of {name} is negative: {number:g}")


def _more(root: ElementTree.Element, owner: str, tag: str) -> Iterator[str]:
    """Names of links or joints with more than one element of a kind, which lose the others."""
    for each in root.findall(owner):
        others = each.findall(tag)[1:]
        for other in others:
            each.remove(other)
        if others:
            yield str(each.get("name"))
