"""Printed objects: one line as ``repr``, a title and a few lines as ``str``, which notebooks show too."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from numbers import Number
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

WIDTH = 120
"""Longest printed line."""
_MOST = 8  # items per line of text
_MOST_LINES = 29  # of text, with the title

_RATE, _FORCE = "rad/s or m/s", "N or N m"
_UNITS = {
    **dict.fromkeys(("time", "duration", "begin", "dt"), "s"),
    **dict.fromkeys(("v", "v1", "v2", "v2_desired", "w"), _RATE),
    **dict.fromkeys(("q", "x1", "x2", "x1_desired", "x2_desired"), "rad or m"),
    **dict.fromkeys(("T", "F", "requested"), _FORCE),
    "v2_dot": "rad/s^2 or m/s^2",
    "energy": "J",
}
"""Units of numbers by their symbols; ``printed`` has other ones."""


class Item(NamedTuple):
    """Name with a note."""

    name: str
    note: str = ""

    def __str__(self) -> str:
        return f"{self.name} [{self.note}]" if self.note else self.name


Line = tuple[str, Sequence[Item]]
"""Label with its items."""


class ObjectSummary(NamedTuple):
    """Summary of an object: a title, and labels with items."""

    title: str
    lines: Sequence[Line] = ()

    def text(self) -> str:
        """Return text for a terminal; long lists are shortened and end in the number of omitted items."""
        shown = [self.title, *(f"  {label}: {_listed(listed, WIDTH - len(label) - 4)}" for label, listed in self.lines)]
        if len(shown) > _MOST_LINES:
            shown = [*shown[:_MOST_LINES], f"  and {counted(len(shown) - _MOST_LINES, 'more line')}"]
        return "\n".join(map(shortened, shown))


class _Pretty(Protocol):
    """Printer of IPython."""

    def text(self, text: str) -> None: ...


class SummaryMixin(ABC):
    """Mixin that prints an object: its title as ``repr``, its summary as ``str`` and in notebooks."""

    @abstractmethod
    def _summary(self) -> ObjectSummary: ...

    def summary_lines(self) -> Sequence[Line]:
        """Return all labels with their items, which ``str`` shortens."""
        return self._summary().lines

    def __repr__(self) -> str:
        return shortened(self._summary().title)

    def __str__(self) -> str:
        return self._summary().text()

    def _repr_pretty_(self, printer: _Pretty, cycle: bool) -> None:
        printer.text(str(self))


Record = TypeVar("Record")


def printed(**units: str) -> Callable[[type[Record]], type[Record]]:
    """Class decorator of records, which are dataclasses and named tuples: they print their fields, with units.

    The title is the name of the class. A ``__str__`` that the class itself defines remains.

    Args:
        units: units of fields by name, beside those of the usual symbols (q, v2, T, time, ...).
    """

    def decorated(kind: type[Record]) -> type[Record]:
        def summary(self: object) -> ObjectSummary:
            return record_summary(self, units)

        methods = {
            "_summary": summary,
            "__repr__": lambda self: shortened(_call(kind, {name: _outline(value) for name, value in _fields(self)})),
            "__str__": SummaryMixin.__str__,
            "_repr_pretty_": SummaryMixin._repr_pretty_,
        }
        # Set here and not inherited: a named tuple has one base only.
        for name, method in methods.items():
            if name != "__str__" or name not in vars(kind):
                setattr(kind, name, method)
        return kind

    return decorated


def record_summary(record: object, units: Mapping[str, str]) -> ObjectSummary:
    """Return the summary of a record: one line for each public field that is not None.

    Args:
        record: a dataclass or a named tuple.
        units: units of fields by name, beside those of the usual symbols.
    """
    lines: list[Line] = []
    for name, value in _fields(record):
        usual = _UNITS.get(name) if isinstance(value, Number | np.ndarray) else None
        unit = units.get(name, usual)
        # An absent field is no news: a summary has what there is.
        if value is not None:
            lines.append((f"{name} [{unit}]" if unit else name, described(value)))
    return ObjectSummary(type(record).__name__, lines)


def described(value: object) -> Sequence[Item]:
    """Return the items that describe a value: numbers, names, ranges of large arrays, titles of objects."""
    if isinstance(value, np.ndarray):
        return [Item(each) for each in _numbers(value)]
    if isinstance(value, Mapping):
        return [Item(str(name), _value(each)) for name, each in value.items()]
    if isinstance(value, Collection) and not (isinstance(value, str) or _is_record(value) or _prints(value)):
        return [Item(_value(each, alone=True)) for each in value]
    return [Item(_value(value, alone=True))]


def shortened(line: str, width: int = WIDTH) -> str:
    """Return a text as one line of at most ``width`` characters."""
    # An item is one line: text of a user may have several.
    line = " ".join(line.split()) if "\n" in line else line
    return line if len(line) <= width else line[: width - 4] + " ..."


class ReprMixin:
    """Mixin that prints the class and its settings in one line; by default the public attributes."""

    def _settings(self) -> Mapping[str, object]:
        return {name: value for name, value in vars(self).items() if not name.startswith("_")}

    def __repr__(self) -> str:
        return _call(type(self), self._settings())


def items(names: Sequence[str], notes: Sequence[str] | None = None) -> tuple[Item, ...]:
    """Return names with their notes."""
    return tuple(map(Item, names)) if notes is None else tuple(map(Item, names, notes))


def counted(count: int, what: str) -> str:
    """Return a count with its noun: ``1 actuator``, ``2 actuators``."""
    return f"{count} {what}{'s'[: count != 1]}"


def significant(value: float, digits: int = 2) -> float:
    """Round a number to significant digits."""
    return float(f"{value:.{digits}g}")


def _listed(listed: Sequence[Item], width: int) -> str:
    shown = list(map(str, listed[:_MOST]))
    while True:
        more = f" and {len(listed) - len(shown)} more" if len(listed) > len(shown) else ""
        text = (", ".join(shown) or "none") + more
        if len(text) <= width or len(shown) < 2:
            return shortened(text, width)
        # One item fewer until the line fits: an item cut in the middle would be misread.
        shown.pop()


def _call(kind: type, settings: Mapping[str, object]) -> str:
    said = (f"{name}={_value(value)}" for name, value in settings.items() if value is not None)
    return f"{kind.__name__}({', '.join(said)})"


def _value(value: object, alone: bool = False) -> str:
    """Value in one line, as a part of another one or alone."""
    # Objects with settings show them, as a call that makes them again.
    if isinstance(value, ReprMixin):
        return repr(value)
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, str):
        return shortened(value)
    if isinstance(value, bool | int | np.integer | np.bool_):
        return str(value)
    if isinstance(value, complex | np.complexfloating):
        return f"{value.real:.4g}{value.imag:+.4g}j" if value.imag else f"{value.real:.4g}"
    if isinstance(value, Number | np.generic):
        return f"{value:.4g}"
    if isinstance(value, np.ndarray):
        if value.ndim == 1:
            return np.array2string(value, precision=4, threshold=_MOST, edgeitems=3, max_line_width=1000)
        return f"[{' x '.join(map(str, value.shape))}]"
    if alone and _prints(value):
        text = str(value)
        return shortened(repr(value) if "\n" in text else text)
    if isinstance(value, list | tuple) and not (_is_record(value) or _prints(value)):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, Mapping) and not _prints(value):
        return ", ".join(f"{name} {_value(each)}" for name, each in value.items()) or "none"
    if _is_record(value) and not isinstance(value, SummaryMixin):
        return _call(type(value), dict(_fields(value)))
    return type(value).__name__


def _outline(value: object) -> object:
    """Value, but only the name of a record; a part of a record would hide the rest of a line."""
    if _is_record(value):
        return f"{type(value).__name__}(...)"
    return list(map(_outline, value)) if isinstance(value, list | tuple) else value


def _prints(value: object) -> bool:
    """True if a value has a text of its own, beside that of dataclasses, tuples and collections."""
    return isinstance(value, ReprMixin | Exception) or type(value).__str__ is not object.__str__


def _is_record(value: object) -> bool:
    return is_dataclass(value) or hasattr(value, "_fields")


def _fields(record: object) -> Sequence[tuple[str, object]]:
    """Names and values of the public fields of a dataclass or a named tuple."""
    if is_dataclass(record):
        names = [each.name for each in fields(record) if each.repr]
    else:
        names = list(getattr(record, "_fields", ()))
    return [(name, getattr(record, name)) for name in names if not name.startswith("_")]


def _numbers(array: np.ndarray) -> Sequence[str]:
    """Numbers of a short list; of another array its shape and range."""
    # A few numbers are read one by one; of more, a range tells whether they are sensible.
    if array.ndim <= 1 and array.size <= _MOST and array.dtype != object:
        return [_value(each) for each in np.atleast_1d(array)]
    shape = f"{len(array)} values" if array.ndim == 1 else " x ".join(map(str, array.shape))
    # A single NaN would make the range NaN, although it tells the rest.
    finite = array[np.isfinite(array)] if array.dtype.kind in "fiu" else np.empty(0)
    if not finite.size:
        return [shape]
    return [f"{shape}, from {finite.min() + 0.0:.4g} to {finite.max() + 0.0:.4g}"]
