"""Macros of a xacro file and the parameters they ask for."""

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
    """What a macro asks for.

    Attributes:
        name: of the property, or of a block, which begins with one or two stars.
        default: the text of its value where a call gives none; None where there is none.
        forwarded: without a value it is the property of this name where the macro is called.
    """

    name: str
    default: str | None = None
    forwarded: bool = False

    @property
    def block(self) -> bool:
        """Whether an element is asked for."""
        return self.name.startswith("*")


@dataclass(frozen=True)
class Macro:
    """Elements to stand in the place of a call."""

    name: str
    body: Element
    parameters: tuple[Parameter, ...]


def read_macro(element: Element, name: str) -> Macro:
    """The macro that an element defines.

    Raises:
        ModelError: a name that no call can have.
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
