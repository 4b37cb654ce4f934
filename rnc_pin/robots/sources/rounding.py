"""Angles and axes that a file holds rounded, made exact: a wheel that is toed by 1e-6 has an axle parallel to no other.

Files say ``1.57`` for a right angle and ``0.7071`` for the root of a half. Constraints tell parallel axles from others
to 1e-8, so that rounding costs a robot freedoms that it has.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

PRECISION = 2e-6
"""Relative error of any number in a file: programs that write single precision leave it, as does a unit conversion."""
CLOSE = 1e-4
"""Within this of a multiple of pi/2 [rad], or of a coordinate axis, a value is meant to be it."""
SAID = 1e-9
"""Changes up to this are not spoken of: they are the last digits of a double written out."""

_FRACTIONS = (math.pi / 4, math.pi / 6)  # every multiple of pi/2 and pi/3 is one of these too
_RIGHT = math.pi / 2
_DECIMALS = 2  # fewer are a number that somebody chose
_COSINES = (0.0, 0.5, math.sqrt(1 / 3), math.sqrt(1 / 2), math.sqrt(2 / 3), math.sqrt(3) / 2, 1.0)
_UNIT = 1e-9
_NUMBER = re.compile(r"[+-]?(?:\d*)\.?(\d*)(?:[eE]([+-]?\d+))?")


def decimals(text: str) -> int:
    """How many places behind the point a number is written to, zeros at its end not counted."""
    match = _NUMBER.fullmatch(text.strip())
    if match is None or ("." not in text and match[2] is None):
        return 0
    behind = match[1] if "." in text else ""
    exponent = int(match[2] or 0)
    return max(0, len(behind.rstrip("0")) - exponent)


def is_rounding(text: str, value: float) -> bool:
    """Whether a number as it is written is ``value``, rounded or cut at its own number of decimals (two at least).

    Fewer decimals count too where the number is within ``PRECISION`` of what they give: ``1.5700012`` is ``1.57``.
    """
    number, own = float(text), decimals(text)
    return any(
        _off(number, value, places) < (1e-3 * 10.0**-places if places == own else PRECISION * abs(number))
        for places in range(_DECIMALS, own + 1)
    )


def _off(number: float, value: float, places: int) -> float:
    """How far a number is from another one that is rounded or cut at so many decimals."""
    unit = 10.0**-places
    cut = math.copysign(math.floor(abs(value) / unit) * unit, value)
    return min(abs(number - round(value, places)), abs(number - cut))


def snapped_angle(text: str) -> float:
    """An angle [rad] as it is written, made the multiple of pi that it is a rounding of.

    That is a multiple of pi/2, pi/3, pi/4 or pi/6 rounded or cut at the number's own decimals, or a multiple of pi/2
    within ``CLOSE``. Any other number is returned as it is.
    """
    angle = float(text)
    right = round(angle / _RIGHT) * _RIGHT
    if abs(angle - right) <= CLOSE:
        return right
    for fraction in _FRACTIONS:
        multiple = round(angle / fraction) * fraction
        if is_rounding(text, multiple):
            return multiple
    return angle


def snapped_direction(texts: Sequence[str]) -> list[float]:
    """The components of a direction, or of a unit quaternion, as written, made the exact ones they are roundings of.

    Each has to be a rounding, at its own number of decimals, of 0, 1 or the cosine of a common angle, and together
    they have to have length 1; or all but one are within ``CLOSE`` of zero for a length near 1. Any other direction is
    returned as it is.
    """
    numbers = [float(text) for text in texts]
    length = math.hypot(*numbers)
    largest = max(numbers, key=abs)
    if abs(length - 1) <= CLOSE and sum(abs(number) > CLOSE for number in numbers) == 1:
        return [math.copysign(1.0, number) if number == largest else 0.0 for number in numbers]
    exact = [_cosine(text, number) for text, number in zip(texts, numbers, strict=True)]
    return exact if abs(math.hypot(*exact) - 1) < _UNIT else numbers


def _cosine(text: str, number: float) -> float:
    for cosine in _COSINES:
        value = math.copysign(cosine, number) if cosine else 0.0
        if abs(number - value) <= PRECISION or (cosine == 0 and abs(number) <= CLOSE) or is_rounding(text, value):
            return value
    return number


@dataclass
class Roundings:
    """What was rounded in a file, collected while it is read.

    Attributes:
        angles: how many angles were changed by more than ``SAID``.
        axes: how many axes were.
        largest: the largest change [rad, or of a component].
        where: the joint or body with that change, in words.
    """

    angles: int = 0
    axes: int = 0
    largest: float = 0.0
    where: str = ""

    def angle(self, text: str, where: str) -> str:
        """An angle [rad] as written, made exact and written out again."""
        return self._written([text], [snapped_angle(text)], where, is_axis=False)[0]

    def angles_of(self, text: str, where: str) -> str:
        """Several angles [rad], with blanks between them."""
        return " ".join(self.angle(each, where) for each in text.split())

    def direction(self, text: str, where: str) -> str:
        """A direction or unit quaternion, with blanks between its components."""
        words = text.split()
        return " ".join(self._written(words, snapped_direction(words), where, is_axis=True))

    def _written(self, texts: Sequence[str], exact: Sequence[float], where: str, *, is_axis: bool) -> list[str]:
        given = [float(text) for text in texts]
        lengths = [math.hypot(*numbers) for numbers in (given, exact)] if is_axis else [1.0, 1.0]
        if not all(lengths):
            return list(texts)
        change = max(abs(old / lengths[0] - new / lengths[1]) for old, new in zip(given, exact, strict=True))
        if change > SAID:
            self.axes += is_axis
            self.angles += not is_axis
        if change > self.largest:
            self.largest, self.where = change, where
        return [text if old == new else repr(new) for text, old, new in zip(texts, given, exact, strict=True)]

    def words(self) -> str:
        """One line on what was changed; nothing where it is not worth a word."""
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
            f"(largest change {self.largest:.0e} rad, {self.where}); snap=False keeps them"
        )
