"""Repairs of robot files: rounded numbers, and what tools that wrote a URDF got wrong.

urdfdom refuses most of the wrong parts, or ignores them. Each repair adds a note.

Files contain ``1.57`` for a right angle and ``0.7071`` for the square root of 0.5. Constraints detect parallel axles
with a tolerance of 1e-8. A wheel with a toe angle of 1e-6 rad is parallel to no other, so rounding costs the robot
degrees of freedom.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Sequence
from decimal import Decimal
from typing import TypeAlias
from xml.etree import ElementTree

import numpy as np

from rnc_pin.errors import ModelError, argument, few
from rnc_pin.robots.sources.description import read_number, read_numbers

PRECISION = 2e-6
"""Relative error of any number in a file, from single precision or unit conversions."""
TOLERANCE = 1e-4
"""Tolerance [rad] within which a value is taken as a multiple of pi/2, or as a coordinate axis."""
REPORTED = 1e-9
"""Changes up to this value are not reported: they are the last digits of a printed double."""


def is_rounding(text: str, value: float) -> bool:
    """True if a number as written is ``value``, rounded or truncated at its own number of decimals (at least two).

    Fewer decimals are also valid if the number is within ``PRECISION`` of the result: ``1.5700012`` is ``1.57``.

    Args:
        text: the number as written.
        value: the exact value.
    """
    number = float(text)
    # Decimals as written: trailing zeros say nothing, and an exponent moves the point.
    own = max(0, -int(Decimal(text).normalize().as_tuple().exponent))
    least_decimals = 2  # a number with fewer decimals is intentional
    return any(
        _off(number, value, places) < (1e-3 * 10.0**-places if places == own else PRECISION * abs(number))
        for places in range(least_decimals, own + 1)
    )


def _off(number: float, value: float, places: int) -> float:
    """Distance of a number from ``value`` rounded or truncated at ``places`` decimals."""
    unit = 10.0**-places
    # Some exporters cut decimals off instead of rounding.
    cut = math.copysign(math.floor(abs(value) / unit) * unit, value)
    return min(abs(number - round(value, places)), abs(number - cut))


def snapped_angle(text: str) -> float:
    """Return the multiple of pi of which an angle [rad] as written is a rounding.

    This is a multiple of pi/2, pi/3, pi/4 or pi/6 rounded or truncated at the number's own decimals, or a multiple of
    pi/2 within ``TOLERANCE``. Any other number is returned without change.

    Args:
        text: the angle as written.
    """
    angle = float(text)
    right_angle = math.pi / 2
    # Right angles are the rule in robots: for them any number of decimals is accepted.
    right = round(angle / right_angle) * right_angle
    if abs(angle - right) <= TOLERANCE:
        return right
    fractions = (math.pi / 4, math.pi / 6)  # these include all multiples of pi/2 and pi/3
    multiples = (round(angle / fraction) * fraction for fraction in fractions)
    return next((each for each in multiples if is_rounding(text, each)), angle)


def snapped_direction(texts: Sequence[str]) -> list[float]:
    """Return the exact components of which a direction, or a unit quaternion, as written is a rounding.

    Each component has to be a rounding, at its own decimals, of 0, 1 or the cosine of a common angle, and the exact
    vector has length 1. Alternatively, all but one are within ``TOLERANCE`` of zero and the length is near 1. Any other
    direction is returned without change.

    Args:
        texts: its components as written.
    """
    numbers = [float(text) for text in texts]
    length = math.hypot(*numbers)
    largest = max(numbers, key=abs)
    if abs(length - 1) <= TOLERANCE and sum(abs(number) > TOLERANCE for number in numbers) == 1:
        return [math.copysign(1.0, number) if number == largest else 0.0 for number in numbers]
    exact = [_cosine(text, number) for text, number in zip(texts, numbers, strict=True)]
    unit_tolerance = 1e-9  # exact components give the length 1 to rounding, wrong guesses do not
    return exact if abs(math.hypot(*exact) - 1) < unit_tolerance else numbers


def _cosine(text: str, number: float) -> float:
    cosines = (0.0, 0.5, math.sqrt(1 / 3), math.sqrt(1 / 2), math.sqrt(2 / 3), math.sqrt(3) / 2, 1.0)
    for cosine in cosines:
        value = math.copysign(cosine, number) if cosine else 0.0
        if abs(number - value) <= PRECISION or (cosine == 0 and abs(number) <= TOLERANCE) or is_rounding(text, value):
            return value
    return number


def snap(root: ElementTree.Element, places: Sequence[tuple[str, str, str]]) -> list[str]:
    """Replace rounded numbers by exact ones.

    Args:
        root: root element of the file, changed in place.
        places: joints or bodies, the path of an element inside, and its attribute: angles [rad], ``rpy`` or ``euler``;
            or a direction or a unit quaternion.

    Returns:
        Text on the changes, which can follow the file name; none if there is nothing to report.
    """
    changes: list[tuple[float, str]] = []
    for tag, path, key in places:
        for owner in root.iter(tag):
            element = owner.find(path)
            # Words that are no numbers are left to the parser, which refuses them with their line.
            if element is not None and read_numbers(element.get(key)) is not None:
                where = f"{tag} '{owner.get('name', '')}'"
                changes += [(change, where) for change in _make_exact(element, key) if change > REPORTED]
    if not changes:
        return []
    said = "1 angle or axis is" if len(changes) == 1 else f"{len(changes)} angles or axes are"
    largest, where = max(changes, key=lambda each: each[0])
    return [
        f"{said} rounded in the file and made exact (largest change {largest:.0e} rad, {where}); "
        f"{argument('snap', False)} keeps them"
    ]


def _make_exact(element: ElementTree.Element, key: str) -> list[float]:
    """Make the numbers of an attribute exact. Return the change of each angle [rad], or of the direction."""
    words = element.attrib[key].split()
    given = np.array([float(each) for each in words])
    is_axis = key not in ("rpy", "euler")
    exact = np.array(snapped_direction(words) if is_axis else [snapped_angle(each) for each in words])
    # The length of an axis has no meaning: only its direction is compared.
    lengths = [float(np.linalg.norm(numbers)) if is_axis else 1.0 for numbers in (given, exact)]
    if not all(lengths):
        return []
    changes = np.abs(given / lengths[0] - exact / lengths[1])
    texts = [word if old == new else repr(new) for word, old, new in zip(words, given, exact.tolist(), strict=True)]
    element.set(key, " ".join(texts))
    return [changes.max()] if is_axis else changes.tolist()


Notes: TypeAlias = defaultdict[str, list[str]]
"""Change of the model to the places where it was made, in words."""

ENDLESS = 1e300
"""Value for an infinite limit in the XML: urdfdom does not read ``inf``."""


def repair(root: ElementTree.Element, file: str) -> list[str]:
    """Change the XML of a robot in place so that urdfdom accepts it, and remove duplicate elements.

    Args:
        root: root element of the file, changed in place.
        file: name of the file.

    Returns:
        Notes on the changes to the model; each can follow the file name. Changes of notation only are not reported.
        Other errors are left to urdfdom.

    Raises:
        ModelError: numbers with a decimal comma, or a planar joint in another plane than its own x-y plane.
    """
    # In this order: later repairs rely on names and numbers that earlier ones made valid.
    notes: Notes = defaultdict(list)
    _name(root, file, notes)
    _numbers(root, notes)
    _inertials(root, notes)
    _geometry(root, notes)
    _limits(root, notes)
    _world(root, notes)
    _planar(root, notes)
    _duplicates(root, notes)
    _drop_unused(root)
    return [f"{change} {few(places)}" if places else change for change, places in notes.items()]


def _name(root: ElementTree.Element, file: str, notes: Notes) -> None:
    if not root.get("name", "").strip():
        name = re.sub(r"(\.urdf|\.xacro|\.xml)+$", "", file)
        root.set("name", name)
        notes[f"<robot> has no name and is called '{name}' after its file"] = []


def _numbers(root: ElementTree.Element, notes: Notes) -> None:
    """Repair lists of numbers: commas, a single scale, colours without opacity, too many numbers, empty attributes."""
    counts = {"xyz": 3, "rpy": 3, "size": 3, "scale": 3, "rgba": 4}
    for owner in [each for tag in ("link", "joint", "material") for each in root.findall(tag)]:
        for element in owner.iter():
            where = f"<{element.tag}> of {owner.tag} '{owner.get('name')}'"
            for key, text in list(element.attrib.items()):
                count = counts.get(key)
                if count is None:
                    if re.fullmatch(r"\s*[+-]?\d*,\d+\s*", text) and key not in ("name", "filename"):
                        raise ModelError(f"{where}: {key} is '{text}': write a point for its decimals")
                    continue
                words = text.split()
                # As many words as numbers, some with a comma inside: these commas are decimals and not separators.
                if any("," in word.strip(",") for word in words) and len(words) == count:
                    raise ModelError(f"{where}: {key} is '{text}': write a point for the decimals")
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
    products = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
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
            for key in products:
                inertia.set(key, inertia.get(key, "0"))


def _geometry(root: ElementTree.Element, notes: Notes) -> None:
    shapes = ("box", "cylinder", "sphere", "mesh")
    unknown = f"has unknown geometry, which is ignored (expected one of {', '.join(shapes)}):"
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            capsule = shape.find("geometry/capsule")
            if capsule is not None:  # shape of some simulators, replaced by a cylinder of the same length and width
                capsule.tag = "cylinder"
                radius, length = (read_number(capsule.get(key)) for key in ("radius", "length"))
                if radius is not None and length is not None:
                    capsule.set("length", repr(length + 2 * radius))
            if not any(shape.find(f"geometry/{kind}") is not None for kind in shapes):
                link.remove(shape)
                notes[unknown].append(f"<{shape.tag}> of '{link.get('name')}'")


def _limits(root: ElementTree.Element, notes: Notes) -> None:
    """Complete limits.

    Simulators take a lower limit above the upper one, and a negative effort or velocity, for no limit. A range that the
    file does not state is none either, although urdfdom takes it for 0 to 0.
    """
    unlimited = {"lower": repr(-ENDLESS), "upper": repr(ENDLESS)}
    for joint in root.findall("joint"):
        name, limit = str(joint.get("name")), joint.find("limit")
        has_range = joint.get("type") in ("revolute", "prismatic")
        if limit is None:
            if has_range:
                ElementTree.SubElement(joint, "limit", unlimited | dict.fromkeys(("effort", "velocity"), repr(ENDLESS)))
                notes["has no <limit> and is taken as unlimited: joint"].append(name)
            continue
        missing = [key for key in ("effort", "velocity") if limit.get(key) is None]
        negative = [key for key in ("effort", "velocity") if (read_number(limit.get(key)) or 0.0) < 0]
        if missing and joint.get("type") != "fixed":
            notes["has no limit of effort or velocity, which is taken as infinite: joint"].append(name)
        if negative:
            notes["has a negative limit of effort or velocity, which is taken as infinite: joint"].append(name)
        limit.attrib |= dict.fromkeys((*missing, *negative), repr(ENDLESS))
        lower, upper = (read_number(limit.get(key)) or 0.0 for key in ("lower", "upper"))
        if has_range and lower > upper:
            limit.attrib |= unlimited
            notes["has a lower limit above the upper and is taken as unlimited: joint"].append(name)
        elif has_range and lower == upper and None in (limit.get("lower"), limit.get("upper")):
            limit.attrib |= unlimited
            notes["has a <limit> without lower and upper and is taken as unlimited: joint"].append(name)


def _world(root: ElementTree.Element, notes: Notes) -> None:
    """Add the link ``world`` if it is a parent but not in the file, as in some simulators."""
    links = [link.get("name") for link in root.findall("link")]
    if "world" not in links and any(end.get("link") == "world" for end in root.findall("joint/parent")):
        root.insert(0, ElementTree.Element("link", {"name": "world"}))
        notes["names 'world' as a parent, which is added as a link"] = []


def _planar(root: ElementTree.Element, notes: Notes) -> None:
    """Check planar joints: Pinocchio moves them in their own x-y plane, whatever their axis."""
    for joint in root.findall("joint[@type='planar']"):
        axis = joint.find("axis")
        numbers = None if axis is None else read_numbers(axis.get("xyz"))
        if numbers is None:
            notes["planar joint without an axis, which moves in its x-y plane:"].append(str(joint.get("name")))
        elif numbers.size == 3 and numbers[:2].any():
            raise ModelError(
                f"planar joint '{joint.get('name')}' has axis '{axis.get('xyz')}', which is not supported: "  # type: ignore[union-attr]
                "rotate its origin so that its axis is '0 0 1'"
            )


def _duplicates(root: ElementTree.Element, notes: Notes) -> None:
    """Remove all but the first of elements that are valid only once."""
    once = {"link": ("inertial",), "joint": ("origin", "axis", "limit", "dynamics", "mimic")}
    for owner, tags in once.items():
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
        for element in list(joint):
            empty = element.tag == "dynamics" and not element.attrib.keys() & {"damping", "friction"}
            if empty or element.tag in ("safety_controller", "calibration"):
                joint.remove(element)
