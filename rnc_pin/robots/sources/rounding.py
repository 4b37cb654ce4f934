"""Replacement of rounded angles and axes of a file by exact ones.

Files contain ``1.57`` for a right angle and ``0.7071`` for the square root of 0.5. Constraints detect parallel axles
with a tolerance of 1e-8. A wheel with a toe angle of 1e-6 rad is parallel to no other, so rounding costs the robot
degrees of freedom.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from rnc_pin.errors import argument

PRECISION = 2e-6
"""Relative error of any number in a file, from single precision or unit conversions."""
TOLERANCE = 1e-4
"""Tolerance [rad] within which a value is taken as a multiple of pi/2, or as a coordinate axis."""
REPORTED = 1e-9
"""Changes up to this value are not reported: they are the last digits of a printed double."""

_FRACTIONS = (math.pi / 4, math.pi / 6)  # these include all multiples of pi/2 and pi/3
_RIGHT_ANGLE = math.pi / 2
_MIN_DECIMALS = 2  # a number with fewer decimals is intentional
_COSINES = (0.0, 0.5, math.sqrt(1 / 3), math.sqrt(1 / 2), math.sqrt(2 / 3), math.sqrt(3) / 2, 1.0)
_UNIT_TOLERANCE = 1e-9
_NUMBER = re.compile(r"[+-]?(?:\d*)\.?(\d*)(?:[eE]([+-]?\d+))?")


def decimals(text: str) -> int:
    """Number of decimals of a number as written, without trailing zeros."""
    match = _NUMBER.fullmatch(text.strip())
    if match is None or ("." not in text and match[2] is None):
        return 0
    behind = match[1] if "." in text else ""
    exponent = int(match[2] or 0)
    return max(0, len(behind.rstrip("0")) - exponent)


def is_rounding(text: str, value: float) -> bool:
    """True if a number as written is ``value``, rounded or truncated at its own number of decimals (at least two).

    Fewer decimals are also valid if the number is within ``PRECISION`` of the result: ``1.5700012`` is ``1.57``.
    """
    number, own = float(text), decimals(text)
    return any(
        _off(number, value, places) < (1e-3 * 10.0**-places if places == own else PRECISION * abs(number))
        for places in range(_MIN_DECIMALS, own + 1)
    )


def _off(number: float, value: float, places: int) -> float:
    """Distance of a number from ``value`` rounded or truncated at ``places`` decimals."""
    unit = 10.0**-places
    cut = math.copysign(math.floor(abs(value) / unit) * unit, value)
    return min(abs(number - round(value, places)), abs(number - cut))


def snapped_angle(text: str) -> float:
    """Return the multiple of pi of which an angle [rad] as written is a rounding.

    This is a multiple of pi/2, pi/3, pi/4 or pi/6 rounded or truncated at the number's own decimals, or a multiple of
    pi/2 within ``TOLERANCE``. Any other number is returned without change.
    """
    angle = float(text)
    right = round(angle / _RIGHT_ANGLE) * _RIGHT_ANGLE
    if abs(angle - right) <= TOLERANCE:
        return right
    for fraction in _FRACTIONS:
        multiple = round(angle / fraction) * fraction
        if is_rounding(text, multiple):
            return multiple
    return angle


def snapped_direction(texts: Sequence[str]) -> list[float]:
    """Return the exact components of which a direction, or a unit quaternion, as written is a rounding.

    Each component has to be a rounding, at its own decimals, of 0, 1 or the cosine of a common angle, and the exact
    vector has length 1. Alternatively, all but one are within ``TOLERANCE`` of zero and the length is near 1. Any other
    direction is returned without change.
    """
    numbers = [float(text) for text in texts]
    length = math.hypot(*numbers)
    largest = max(numbers, key=abs)
    if abs(length - 1) <= TOLERANCE and sum(abs(number) > TOLERANCE for number in numbers) == 1:
        return [math.copysign(1.0, number) if number == largest else 0.0 for number in numbers]
    exact = [_cosine(text, number) for text, number in zip(texts, numbers, strict=True)]
    return exact if abs(math.hypot(*exact) - 1) < _UNIT_TOLERANCE else numbers


def _cosine(text: str, number: float) -> float:
    for cosine in _COSINES:
        value = math.copysign(cosine, number) if cosine else 0.0
        if abs(number - value) <= PRECISION or (cosine == 0 and abs(number) <= TOLERANCE) or is_rounding(text, value):
            return value
    return number


@dataclass
class Roundings:
    """Record of the rounded values that were replaced in a file.

    Attributes:
        angles: number of angles changed by more than ``REPORTED``.
        axes: number of axes changed by more than ``REPORTED``.
        largest: largest change [rad, or of a component].
        where: joint or body with the largest change, in words.
    """

    angles: int = 0
    axes: int = 0
    largest: float = 0.0
    where: str = ""

    def angle(self, text: str, where: str) -> str:
        """Return the exact angle [rad] as text."""
        return self._written([text], [snapped_angle(text)], where, is_axis=False)[0]

    def angles_of(self, text: str, where: str) -> str:
        """Return several exact angles [rad] as text, separated by blanks."""
        return " ".join(self.angle(each, where) for each in text.split())

    def direction(self, text: str, where: str) -> str:
        """Return an exact direction or unit quaternion as text, separated by blanks."""
        words = text.split()
        return " ".join(self._written(words, snapped_direction(words), where, is_axis=True))

    def _written(self, texts: Sequence[str], exact: Sequence[float], where: str, *, is_axis: bool) -> list[str]:
        given = [float(text) for text in texts]
        lengths = [math.hypot(*numbers) for numbers in (given, exact)] if is_axis else [1.0, 1.0]
        if not all(lengths):
            return list(texts)
        change = max(abs(old / lengths[0] - new / lengths[1]) for old, new in zip(given, exact, strict=True))
        if change > REPORTED:
            self.axes += is_axis
            self.angles += not is_axis
        if change > self.largest:
            self.largest, self.where = change, where
        return [text if old == new else repr(new) for text, old, new in zip(texts, given, exact, strict=True)]

    def words(self) -> str:
        """Summary of the changes in one line; empty if there is nothing to report."""
        counts = [
            f"{count} {one if count == 1 else many}"
            for count, one, many in ((self.angles, "angle", "angles"), (self.axes, "axis", "axes"))
            if count
        ]
        if not counts:
            return ""
        verb, article = ("was", "a multiple") if self.angles + self.axes == 1 else ("were", "multiples")
        taken = f"{'is' if verb == 'was' else 'are'} taken as {article} of pi" if self.angles else "made exact"
        return (
            f"{' and '.join(counts)} {verb} rounded in the file and {taken} "
            f"(largest change {self.largest:.0e} rad, {self.where}); {argument('snap', False)} keeps them"
        )


def snap_mjcf(root: ElementTree.Element) -> list[str]:
    """Replace rounded axes of joints and quaternions of bodies by exact ones, and angles of bodies given in radians.

    Returns:
        Texts on the changes; each can follow the file name.
    """
    roundings = Roundings()
    units = [each.attrib["angle"] for each in root.findall("compiler") if "angle" in each.attrib]
    exact = {"joint": {"axis": roundings.direction}, "body": {"quat": roundings.direction}}
    if units[-1:] == ["radian"]:
        exact["body"]["euler"] = roundings.angles_of
    for element in root.iter():
        for key, make in exact.get(element.tag, {}).items():
            if key in element.attrib:
                element.set(key, make(element.attrib[key], f"{element.tag} '{element.get('name', '')}'"))
    words = roundings.words()
    return [words] if words else []
