"""Macros of a xacro file and their parameters."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from rnc_pin.errors import ModelError

_NAME = re.compile(r"\s*([^\s:=]+)\s*:?=\s*(\^\|?)?")
_DEFAULT = (  # an expression, a substitution, or quoted and plain parts up to the next space
    re.compile(r"\$\{[^}]*\}(?=\s|$)"),
    re.compile(r"\$\([^)]*\)(?=\s|$)"),
    re.compile(r"(?:'[^'\n]*+'|\"[^\"\n]*+\"|[^\s'\"]++)*+(?=\s|$)"),
)


@dataclass(frozen=True)
class Parameter:
    """Parameter of a macro.

    Attributes:
        name: name of the property, or of a block, which begins with one or two stars.
        default: text of the default value; None if there is none.
        forwarded: True if a missing value is taken from the property of the same name in the caller's scope.
    """

    name: str
    default: str | None = None
    forwarded: bool = False

    @property
    def block(self) -> bool:
        """True if the parameter is a block, i.e. an element."""
        return self.name.startswith("*")


@dataclass(frozen=True)
class Macro:
    """Macro: elements that replace a call."""

    name: str
    body: Element
    parameters: tuple[Parameter, ...]


def read_macro(element: Element, name: str) -> Macro:
    """Return the macro that an element defines.

    Raises:
        ModelError: the name cannot be called.
    """
    if name == "call" or "." in name:
        raise ModelError(f"a macro cannot have the name '{name}'")
    return Macro(name, element, tuple(_parameters(element.get("params", ""))))


def _parameters(text: str) -> Iterator[Parameter]:
    place = 0
    while place < len(text) and text[place:].strip():
        named = _NAME.match(text, place)
        default = None
        if named:
            default = next(filter(None, (each.match(text, named.end()) for each in _DEFAULT)), None)
        if named and default:
            yield Parameter(named[1], default[0] or None, named[2] is not None)
            place = default.end()
        else:
            word = re.compile(r"\s*(\S+)").match(text, place)
            assert word is not None, "there is more than space"
            yield Parameter(word[1])
            place = word.end()
