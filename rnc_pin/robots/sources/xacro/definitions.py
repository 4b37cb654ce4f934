"""Definitions of a xacro file: elements with their places, macros, and scopes of properties and blocks."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from rnc_pin.errors import ModelError
from rnc_pin.io.safe_read import parse_tree, read_bytes
from rnc_pin.robots.sources.xacro.expressions import Namespace, Value


class PlacedElement(Element):
    """Element with the file and line of its start tag; line 0 if it is in no file."""

    file: Path = Path()
    line: int = 0

    def copied(self) -> PlacedElement:
        """Return an empty element with this tag and place."""
        copy = PlacedElement(self.tag)
        copy.file, copy.line = self.file, self.line
        return copy


def read_document(path: Path) -> PlacedElement:
    """Return the root element of a file.

    Args:
        path: path of the file.

    Raises:
        ModelError: the file cannot be read, is not XML, or has elements more than 200 deep.
    """

    def make(tag: str, attributes: dict[str, str], line: int) -> PlacedElement:
        element = PlacedElement(tag, attributes)
        element.file, element.line = path, line
        return element

    deepest = 200  # the expander recurses through elements and macros
    try:
        root = parse_tree(read_bytes(path), deepest, make)
    except OSError as error:
        raise ModelError(f"cannot read '{path}': {error.strerror}") from None
    except (ParseError, LookupError, ValueError) as error:  # also for an unknown encoding
        raise ModelError(f"not well-formed XML: {error}") from None
    assert isinstance(root, PlacedElement)
    return root


# ---------------------------------------------------------------------- macros


_PARAMETER_NAME = re.compile(r"\s*([^\s:=]+)\s*:?=\s*(\^\|?)?")
_DEFAULT_VALUE = (  # an expression, a substitution, or quoted and plain parts up to the next space
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

    Args:
        element: the ``<xacro:macro>``.
        name: its name without prefix.

    Raises:
        ModelError: the name cannot be called.
    """
    if name == "call" or "." in name:
        raise ModelError(f"a macro cannot have the name '{name}'")
    return Macro(name, element, tuple(_parameters(element.get("params", ""))))


def _parameters(text: str) -> Iterator[Parameter]:
    place = 0
    while place < len(text) and text[place:].strip():
        named = _PARAMETER_NAME.match(text, place)
        default = None
        if named:
            default = next(filter(None, (each.match(text, named.end()) for each in _DEFAULT_VALUE)), None)
        if named and default:
            yield Parameter(named[1], default[0] or None, named[2] is not None)
            place = default.end()
        else:
            # A word without a default that can be read is a name as a whole.
            word = re.compile(r"\s*(\S+)").match(text, place)
            assert word is not None, "there is more than space"
            yield Parameter(word[1])
            place = word.end()


# ---------------------------------------------------------------------- scopes


class Scope(Mapping[str, Value]):
    """Properties of one macro, namespace or file. Other names are looked up in the parent.

    Args:
        outer: parent scope, or the symbols that are predefined for every file.
        resolve: function that evaluates the text of a property on first access.
        namespace: True for the scope of a file that was included with a name.
    """

    def __init__(
        self, outer: Scope | Mapping[str, Value], resolve: Callable[[str, Scope], Value], *, namespace: bool = False
    ) -> None:
        self.outer, self.namespace = outer, namespace
        self.blocks: dict[str, Element] = {}
        self._resolve = resolve
        self._values: dict[str, Value] = {}
        self._pending: list[str] = []
        self._unresolved: set[str] = set()

    def inner(self, *, namespace: bool = False) -> Scope:
        """Return a new child scope.

        Args:
            namespace: True for the scope of a file that was included with a name.
        """
        return Scope(self, self._resolve, namespace=namespace)

    def __getitem__(self, name: str) -> Value:
        if name not in self._values:
            return self.outer[name]
        if name in self._unresolved:
            if name in self._pending:
                raise ModelError(f"circular definition: {' -> '.join((*self._pending, name))}")
            # Properties on the way: one that needs itself would otherwise recurse without end.
            self._pending.append(name)
            value = literal(self._resolve(self._values[name], self))
            self._pending.remove(name)
            self._unresolved.discard(name)
            self._values[name] = value
        return self._values[name]

    def __contains__(self, name: object) -> bool:
        return name in self._values or name in self.outer

    def __iter__(self) -> Iterator[str]:
        yield from self._values
        yield from self.outer

    def __len__(self) -> int:
        return len(self._values) + len(self.outer)

    def define(self, name: str, value: Value, *, lazy: bool = False) -> None:
        """Define a property. A lazy text is evaluated on first access and may use properties defined later.

        Args:
            name: name of the property.
            value: its value, or its text.
            lazy: True to evaluate a text on first access.
        """
        self._values[name] = literal(value)
        if lazy and isinstance(self._values[name], str):
            self._unresolved.add(name)
        else:
            self._unresolved.discard(name)

    def remove(self, name: str) -> None:
        """Remove a property here and in all parents.

        Args:
            name: name of the property.
        """
        for scope in self._chain():
            scope._values.pop(name, None)
            scope._unresolved.discard(name)

    def block(self, name: str) -> Element | None:
        """Return the block of a name, ``*name`` or ``**name``, or None.

        Args:
            name: name with its stars.
        """
        return next((scope.blocks[name] for scope in self._chain() if name in scope.blocks), None)

    def outermost(self) -> Scope:
        """Return the scope of the whole file."""
        return list(self._chain())[-1]

    def caller(self) -> Scope | None:
        """Return the scope that called the macro of this scope, or None."""
        outside = list(self._chain())[1:]
        return next((scope for scope in outside if self.namespace or not scope.namespace), None)

    def _chain(self) -> Iterator[Scope]:
        """Yield this scope and its parents, the innermost first."""
        scope: Scope | Mapping[str, Value] = self
        while isinstance(scope, Scope):
            yield scope
            scope = scope.outer


class ScopeNamespace(Namespace):
    """Namespace of the definitions of an included file.

    Args:
        name: name of the namespace.
        scope: scope of the included file.
    """

    def __init__(self, name: str, scope: Scope) -> None:
        super().__init__(name, scope)
        self.scope = scope


def literal(value: Value) -> Value:
    """Convert a property's text to a number or bool if possible, and remove single quotes around it.

    Args:
        value: value, or text of it.
    """
    if not isinstance(value, str):
        return value
    if len(value) >= 2 and value[0] == value[-1] == "'":
        return value[1:-1]
    if "_" in value:  # Python would drop it from a number
        return value
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return {"true": True, "True": True, "false": False, "False": False}.get(value, value)


def truth(value: Value, text: str) -> bool:
    """Truth value of a condition.

    Args:
        value: value of the condition.
        text: its text in the file, for the message.

    Raises:
        ModelError: the value is neither true nor false.
    """
    if not isinstance(value, str):
        return bool(value)
    if value in ("true", "True", "false", "False"):
        return value in ("true", "True")
    try:
        return bool(int(value))
    except ValueError:
        raise ModelError(f"'{text}' evaluates to '{value}', which is not a boolean") from None
