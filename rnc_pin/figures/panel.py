"""Panels over time: lines that share an axis and a unit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise

import numpy as np

from rnc_pin.errors import InputError, nearest

MAX_LINES = 6  # largest number of lines in a panel
_MAX_NAME = 60  # characters
AXIS_NAMES = {
    "m": "position",
    "rad": "angle",
    "m/s": "speed",
    "rad/s": "angular velocity",
    "m/s^2": "acceleration",
    "rad/s^2": "angular acceleration",
    "N": "force",
    "N m": "torque",
}
"""Names of axes by unit."""
INTEGRAL_NAMES = {"m": "distance", "rad": "turned angle"}
"""Names of axes of integrals of rates by unit."""


def readable_name(name: str) -> str:
    """Readable name; the middle of a long name is replaced by dots."""
    if len(name) > _MAX_NAME:
        name = f"{name[: _MAX_NAME // 2]}...{name[-_MAX_NAME // 2 :]}"
    return name.replace("_", " ").strip()


@dataclass(frozen=True)
class Series:
    """Line of a panel, with its reference and the same line of compared runs.

    Attributes:
        name: name of the quantity.
        values: values (N,) over the time of the figure.
        desired: reference (N,), if any.
        compared: values of the compared runs by label, over their own time.
        is_integral: True for the integral of the named quantity.
        active: samples (N,) with a wide pale line, if any.
        bounds: values with a dashed line in the colour of the series.
        time: times (N,) [s] if they are not those of the figure.
        is_held: True if each value holds until the next time.
    """

    name: str
    values: np.ndarray
    desired: np.ndarray | None = None
    compared: Mapping[str, np.ndarray] = field(default_factory=dict)
    is_integral: bool = False
    active: np.ndarray | None = None
    bounds: tuple[float, ...] = ()
    time: np.ndarray | None = None
    is_held: bool = False


@dataclass(frozen=True)
class Panel:
    """Lines that share an axis.

    Attributes:
        quantity: what the axis shows.
        unit: its unit, "-" for a number.
        series: lines, at most ``MAX_LINES`` if there are no compared runs.
        note: title of the legend, for example about lines that the panel omits.
        log: True if the axis is logarithmic; it begins at ``bottom``.
        bottom: fixed lower limit of the axis, if any.
        zero: True to draw a line at zero.
    """

    quantity: str
    unit: str
    series: tuple[Series, ...]
    note: str = ""
    log: bool = False
    bottom: float | None = None
    zero: bool = False

    @property
    def words(self) -> Iterator[str]:
        """Names that a label can replace."""
        yield self.quantity
        for each in self.series:
            yield each.name
            yield from each.compared


@dataclass(frozen=True)
class Labels:
    """Texts of a figure by the names that they replace. Formulas are between dollar signs, as in LaTeX.

    Attributes:
        given: text by name of a quantity, a line or an axis.
    """

    given: Mapping[str, str] = field(default_factory=dict)

    def check(self, valid: Iterable[str]) -> None:
        """Raise an error if a label replaces no name of the figure.

        Raises:
            InputError: unknown name.
        """
        known = list(dict.fromkeys(valid))
        for name in self.given:
            if name not in known:
                raise InputError(f"labels: nothing is named '{name}'{nearest(name, known)}")

    def text(self, name: str) -> str:
        """Text of a name: the given one, or the readable name."""
        from rnc_pin.figures.style import escape  # Matplotlib takes a second to import

        return self.given[name] if name in self.given else escape(readable_name(name))

    def of(self, series: Series) -> str:
        """Text of a line."""
        return f"integral of {self.text(series.name)}" if series.is_integral else self.text(series.name)


def split_names(names: Sequence[str], most: int = MAX_LINES) -> list[list[str]]:
    """Split names into groups of at most ``most``. Names with the same first word stay together."""
    if len(names) <= most:
        return [list(names)] if names else []
    groups = [list(group) for _, group in groupby(names, key=_first_word)]
    if len(groups) == 1 or len(groups) == len(names):
        count = -(-len(names) // most)
        bounds = [round(k * len(names) / count) for k in range(count + 1)]
        return [list(names[start:end]) for start, end in pairwise(bounds)]
    parts: list[list[str]] = []
    for group in groups:
        for part in split_names(group, most):
            if parts and len(parts[-1]) + len(part) <= most:
                parts[-1] += part
            else:
                parts.append(part)
    return parts


def _first_word(name: str) -> str:
    return name.lstrip("_").split("_")[0].rstrip("0123456789")
