"""Numbers of a robot description: reading them, and checks that all formats share."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rnc_pin.errors import ModelError


def read_numbers(text: str | None, count: int | None = None) -> np.ndarray | None:
    """Return the numbers in an attribute, or None if a word is not a finite number.

    Only whitespace, digits and words that parsers in C accept are valid; Python accepts more.

    Args:
        text: the attribute; None if it is missing.
        count: required number of numbers; None for any.
    """
    if text is None or not text.isascii() or "_" in text:
        return None
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        return None
    return numbers if np.isfinite(numbers).all() and count in (None, numbers.size) else None


def read_number(text: str | None) -> float | None:
    """Return the single number in an attribute, or None if it does not hold exactly one number."""
    numbers = read_numbers(text, 1)
    return None if numbers is None else float(numbers[0])


def check_numbers(text: str | None, counts: tuple[int, ...], what: str) -> np.ndarray:
    """Return the numbers in an attribute.

    Args:
        text: the attribute; None if it is missing.
        counts: valid numbers of numbers, in ascending order.
        what: element and attribute, for the message.

    Raises:
        ModelError: a word is not a finite number, or there are too many or too few.
    """
    numbers = read_numbers(text)
    if numbers is None or numbers.size not in counts:
        few = " or ".join(map(str, counts)) if len(counts) < 3 else f"{counts[0]} to {counts[-1]}"
        words = "a finite number" if counts == (1,) else f"{few} finite numbers"
        raise ModelError(f"{what} takes {words}, found '{text}'")
    return numbers


def check_not_negative(values: Mapping[str, float | None], owner: str, prefix: str = "") -> None:
    """Raise an error if a quantity that has no sign is negative.

    Args:
        values: quantity to value; None if the file does not give it.
        owner: joint or link, for the message.
        prefix: start of the message.

    Raises:
        ModelError: a value is negative.
    """
    for quantity, value in values.items():
        if value is not None and value < 0:
            raise ModelError(f"{prefix}{quantity} of {owner} is negative: {value:g}")


def check_acceleration(gravity: object) -> np.ndarray:
    """Return the acceleration of gravity (3,) [m/s^2].

    Raises:
        ModelError: not three finite numbers.
    """
    try:
        acceleration = np.asarray(gravity, dtype=float)
    except (TypeError, ValueError):
        acceleration = np.empty(0)
    if acceleration.shape != (3,) or not np.isfinite(acceleration).all():
        raise ModelError(f"gravity has to be three finite numbers [m/s^2], found {gravity!r}")
    return acceleration
