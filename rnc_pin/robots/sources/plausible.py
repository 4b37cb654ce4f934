"""Checks for impossible values and duplicate elements of a URDF, which urdfdom accepts without a message."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from rnc_pin.errors import ModelError, few
from rnc_pin.robots.sources.description import read_number

_ONCE = {"link": ("inertial",), "joint": ("origin", "axis", "limit", "dynamics", "mimic")}
_NOT_NEGATIVE = {"dynamics": ("damping", "friction"), "limit": ("effort", "velocity")}


def check_values(root: ElementTree.Element, path: Path) -> list[str]:
    """Check the values of joints, and remove duplicate elements that are valid only once.

    Returns:
        Texts on the removed elements; each can follow the file name.

    Raises:
        ModelError: damping, friction or a limit is negative.
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
    """Remove all but the first element of a kind; yield the names of the links or joints concerned."""
    for each in root.findall(owner):
        others = each.findall(tag)[1:]
        for other in others:
            each.remove(other)
        if others:
            yield str(each.get("name"))
