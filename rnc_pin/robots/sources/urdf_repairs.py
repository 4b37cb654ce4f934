"""Repair of common deviations of URDF files, with a note on each. urdfdom refuses most of them, or ignores them."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree

from rnc_pin.errors import ModelError, few
from rnc_pin.robots.sources.numeric_checks import read_number, read_numbers
from rnc_pin.robots.sources.rounding import PRECISION

Notes: TypeAlias = defaultdict[str, list[str]]
"""Change of the model to the places where it was made, in words."""

ENDLESS = 1e300
"""Value for an infinite limit in the XML: urdfdom does not read ``inf``."""

_LIMITED = ("revolute", "prismatic")
_SHAPES = ("box", "cylinder", "sphere", "mesh")
_COUNTS = {"xyz": 3, "rpy": 3, "size": 3, "scale": 3, "rgba": 4}
_PRODUCTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_ONCE = {"link": ("inertial",), "joint": ("origin", "axis", "limit", "dynamics", "mimic")}
_INSTALLED = (".urdf", ".xacro", ".xml")


def repair(root: ElementTree.Element, path: Path) -> list[str]:
    """Change the XML of a robot in place so that urdfdom accepts it, and remove duplicate elements.

    Returns:
        Notes on the changes to the model; each can follow the file name. Changes of notation only are not reported.
        Other errors are left to urdfdom.

    Raises:
        ModelError: numbers with a decimal comma, or a planar joint in another plane than its own x-y plane.
    """
    notes: Notes = defaultdict(list)
    _name(root, path, notes)
    _numbers(root, path, notes)
    _inertials(root, notes)
    _geometry(root, notes)
    _limits(root, notes)
    _world(root, notes)
    _planar(root, path, notes)
    _duplicates(root, notes)
    _drop_unused(root)
    return [f"{change} {few(places)}" if places else change for change, places in notes.items()]


def _name(root: ElementTree.Element, path: Path, notes: Notes) -> None:
    if root.get("name", "").strip():
        return
    name = path.name
    while name.endswith(_INSTALLED):
        name = name.rpartition(".")[0]
    root.set("name", name)
    notes[f"<robot> has no name and is called '{name}' after its file"] = []


def _numbers(root: ElementTree.Element, path: Path, notes: Notes) -> None:
    """Repair lists of numbers: commas, a single scale, colours without opacity, too many numbers, empty attributes."""
    for owner in [each for tag in ("link", "joint", "material") for each in root.findall(tag)]:
        for element in owner.iter():
            where = f"<{element.tag}> of {owner.tag} '{owner.get('name')}'"
            for key, text in list(element.attrib.items()):
                count = _COUNTS.get(key)
                if count is None:
                    if re.fullmatch(r"\s*[+-]?\d*,\d+\s*", text) and key not in ("name", "filename"):
                        raise ModelError(f"{path}: {where}: {key} is '{text}': write a point for its decimals")
                    continue
                words = text.split()
                if any("," in word.strip(",") for word in words) and len(words) == count:
                    raise ModelError(f"{path}: {where}: {key} is '{text}': write a point for the decimals")
                words = text.replace(",", " ").split()
                if not words:
                    del element.attrib[key]
                    continue
                if key == "scale" and len(words) == 1:
                    words = 3 * words
                if key == "rgba" and len(words) == 3:
                    words = [*words, "1"]
                if key == "rgba":
                    words = [_opaque(word) for word in words]
                if len(words) > count and read_numbers(" ".join(words)) is not None:
                    words = words[:count]
                    if key != "scale":
                        cut = f"{key} of {owner.tag} '{owner.get('name')}'"
                        notes["has too many numbers, the last are ignored:"].append(cut)
                element.set(key, " ".join(words))


def _opaque(word: str) -> str:
    """Clip a colour component that exceeds 1 by rounding; urdfdom refuses values above 1."""
    value = read_number(word)
    return "1" if value is not None and 1 < value <= 1 + PRECISION else word


def _inertials(root: ElementTree.Element, notes: Notes) -> None:
    """Complete inertials: urdfdom requires the mass, the inertia and its six numbers."""
    for link in root.findall("link"):
        for inertial in link.findall("inertial"):
            if inertial.find("mass") is None:
                link.remove(inertial)
                notes["<inertial> without a mass is left out: link"].append(str(link.get("name")))
                continue
            inertia = inertial.find("inertia")
            if inertia is None:
                inertia = ElementTree.SubElement(inertial, "inertia")
                notes["<inertial> without an <inertia> is taken as a point: link"].append(str(link.get("name")))
            for key in _PRODUCTS:
                inertia.set(key, inertia.get(key, "0"))


def _geometry(root: ElementTree.Element, notes: Notes) -> None:
    unknown = f"has unknown geometry, which is ignored (expected one of {', '.join(_SHAPES)}):"
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            capsule = shape.find("geometry/capsule")
            if capsule is not None:  # shape of some simulators, replaced by a cylinder of the same length and width
                capsule.tag = "cylinder"
                radius, length = (read_number(capsule.get(key)) for key in ("radius", "length"))
                if radius is not None and length is not None:
                    capsule.set("length", repr(length + 2 * radius))
            if not any(shape.find(f"geometry/{kind}") is not None for kind in _SHAPES):
                link.remove(shape)
                notes[unknown].append(f"<{shape.tag}> of '{link.get('name')}'")


def _limits(root: ElementTree.Element, notes: Notes) -> None:
    """Complete limits.

    Simulators take a lower limit above the upper one, and a negative effort or velocity, for no limit. A range that the
    file does not state is none either, although urdfdom takes it for 0 to 0.
    """
    for joint in root.findall("joint"):
        name = str(joint.get("name"))
        limit = joint.find("limit")
        if limit is None:
            if joint.get("type") not in _LIMITED:
                continue
            limit = ElementTree.SubElement(joint, "limit")
            _open(limit)
            notes["has no <limit> and is taken as unlimited: joint"].append(name)
        elif joint.get("type") != "fixed" and any(limit.get(key) is None for key in ("effort", "velocity")):
            notes["has no limit of effort or velocity, which is taken as infinite: joint"].append(name)
        if any((read_number(limit.get(key)) or 0.0) < 0 for key in ("effort", "velocity")):
            notes["has a negative limit of effort or velocity, which is taken as infinite: joint"].append(name)
        for key in ("effort", "velocity"):
            if limit.get(key) is None or (read_number(limit.get(key)) or 0.0) < 0:
                limit.set(key, repr(ENDLESS))
        if joint.get("type") not in _LIMITED:
            continue
        lower, upper = (read_number(limit.get(key)) or 0.0 for key in ("lower", "upper"))
        if lower > upper:
            _open(limit)
            notes["has a lower limit above the upper and is taken as unlimited: joint"].append(name)
        elif lower == upper and None in (limit.get("lower"), limit.get("upper")):
            _open(limit)
            notes["has a <limit> without lower and upper and is taken as unlimited: joint"].append(name)


def _open(limit: ElementTree.Element) -> None:
    limit.set("lower", repr(-ENDLESS))
    limit.set("upper", repr(ENDLESS))


def _world(root: ElementTree.Element, notes: Notes) -> None:
    """Add the link ``world`` if it is a parent but not in the file, as in some simulators."""
    links = [link.get("name") for link in root.findall("link")]
    if "world" not in links and any(end.get("link") == "world" for end in root.findall("joint/parent")):
        root.insert(0, ElementTree.Element("link", {"name": "world"}))
        notes["names 'world' as a parent, which is added as a link"] = []


def _planar(root: ElementTree.Element, path: Path, notes: Notes) -> None:
    """Check planar joints: Pinocchio moves them in their own x-y plane, whatever their axis."""
    for joint in root.findall("joint[@type='planar']"):
        axis = joint.find("axis")
        numbers = None if axis is None else read_numbers(axis.get("xyz"))
        if numbers is None:
            notes["planar joint without an axis, which moves in its x-y plane:"].append(str(joint.get("name")))
        elif numbers.size == 3 and numbers[:2].any():
            raise ModelError(
                f"{path}: planar joint '{joint.get('name')}' has axis '{axis.get('xyz')}', which is not supported: "  # type: ignore[union-attr]
                "rotate its origin so that its axis is '0 0 1'"
            )


def _duplicates(root: ElementTree.Element, notes: Notes) -> None:
    """Remove all but the first of elements that are valid only once."""
    for owner, tags in _ONCE.items():
        for tag in tags:
            for each in root.findall(owner):
                others = each.findall(tag)[1:]
                for other in others:
                    each.remove(other)
                if others:
                    notes[f"has a second <{tag}>, which is left out: {owner}"].append(str(each.get("name")))


def _drop_unused(root: ElementTree.Element) -> None:
    """Remove elements that the model does not use and that urdfdom refuses if they are incomplete."""
    seen: set[str] = set()
    for material in root.findall("material"):
        name = str(material.get("name"))
        if name in seen:
            root.remove(material)
        seen.add(name)
    for joint in root.findall("joint"):
        for tag in ("safety_controller", "calibration"):
            for element in joint.findall(tag):
                joint.remove(element)
        for element in joint.findall("dynamics"):
            if element.get("damping") is None and element.get("friction") is None:
                joint.remove(element)
