"""Object summaries: a title and a few lines in a terminal, a small table in a notebook."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from html import escape
from typing import NamedTuple

import numpy as np

_MOST = 8  # items per line of text
_CELL = 'style="text-align: left; vertical-align: top"'


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
        return "\n".join([self.title, *(f"  {label}: {_listed(listed)}" for label, listed in self.lines)])

    def html(self) -> str:
        """Return HTML for a notebook: a table with all items."""
        rows = "".join(_rows(label, listed) for label, listed in self.lines)
        return f"<div><b>{escape(self.title)}</b></div><table>{rows}</table>"


class SummaryMixin(ABC):
    """Mixin that prints the summary of an object: as text, and in notebooks as a table."""

    @abstractmethod
    def _summary(self) -> ObjectSummary: ...

    def _full_summary(self) -> ObjectSummary:
        """Return the summary for notebooks, which may be longer."""
        return self._summary()

    def __repr__(self) -> str:
        return self._summary().text()

    def _repr_html_(self) -> str:
        return self._full_summary().html()


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


def _listed(listed: Sequence[Item]) -> str:
    more = f" and {len(listed) - _MOST} more" if len(listed) > _MOST else ""
    return (", ".join(map(str, listed[:_MOST])) or "none") + more


def _rows(label: str, listed: Sequence[Item]) -> str:
    if not any(each.note for each in listed):  # names alone take one line
        names = ", ".join(each.name for each in listed) or "none"
        return f'<tr><th {_CELL}>{escape(label)}</th><td colspan="2" {_CELL}>{escape(names)}</td></tr>'
    head = f'<th rowspan="{len(listed)}" {_CELL}>{escape(label)}</th>'
    cells = (f"<td {_CELL}>{escape(each.name)}</td><td {_CELL}>{escape(each.note)}</td>" for each in listed)
    return "".join(f"<tr>{head if k == 0 else ''}{each}</tr>" for k, each in enumerate(cells))


def _call(kind: type, settings: Mapping[str, object]) -> str:
    said = (f"{name}={_value(value)}" for name, value in settings.items() if value is not None)
    return f"{kind.__name__}({', '.join(said)})"


def _value(value: object) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, bool | int | np.integer | np.bool_):
        return str(value)
    if isinstance(value, float | np.floating):
        return f"{value:.4g}"
    if isinstance(value, np.ndarray):
        return np.array2string(value, precision=4, threshold=_MOST, edgeitems=3, max_line_width=1000)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, ReprMixin):
        return repr(value)
    if is_dataclass(value):
        settings = {each.name: getattr(value, each.name) for each in fields(value) if each.repr}
        return _call(type(value), settings)
    return type(value).__name__
