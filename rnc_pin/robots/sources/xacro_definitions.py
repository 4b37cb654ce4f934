"""Definitions of a xacro file: elements with their places, macros, scopes; and values of ``${...}`` and ``$(...)``."""

from __future__ import annotations

import math
import os
import re
from collections import ChainMap, UserDict
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import TypeAlias
from xml.etree.ElementTree import Element, ParseError

import yaml

from rnc_pin.errors import ModelError, nearest, warn
from rnc_pin.io.safe_read import BoundedLoader, load_yaml, parse_tree, read_bytes
from rnc_pin.robots.robot_files import Packages
from rnc_pin.robots.sources import xacro_expressions as expressions
from rnc_pin.robots.sources.xacro_expressions import Function, Namespace, Value


class PlacedElement(Element):
    """Element with the file and line of its start tag; line 0 if it is in no file."""

    file: Path = Path()
    line: int = 0


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


_PARAMETER = re.compile(
    r"\s*+(?:"
    r"(?P<name>[^\s:=]++)\s*+:?+=\s*+(?P<forwarded>\^\|?+)?+"
    # The default is an expression, a substitution, or quoted and plain parts up to the next space.
    r"(?P<default>\$\{[^}]*\}|\$\([^)]*\)|(?:'[^'\n]*+'|\"[^\"\n]*+\"|[^\s'\"]++)*+)(?=\s|$)"
    # A word without a default that can be read is a name as a whole.
    r"|(?P<word>\S+))"
)


@dataclass(frozen=True)
class Parameter:
    """Parameter of a macro.

    Attributes:
        name: name of the property, or of a block (an element), which begins with one or two stars.
        default: text of the default value; None if there is none.
        forwarded: True if a missing value is taken from the property of the same name in the caller's scope.
    """

    name: str
    default: str | None = None
    forwarded: bool = False


def parameters_of(text: str) -> Iterator[Parameter]:
    """Yield the parameters of a macro.

    Args:
        text: attribute ``params`` of its element.
    """
    for found in _PARAMETER.finditer(text):
        yield Parameter(found["word"] or found["name"], found["default"] or None, found["forwarded"] is not None)


# ---------------------------------------------------------------------- scopes


@dataclass(frozen=True, eq=False)
class _Unresolved:
    """Text of a property, evaluated in its scope on first access: it may use properties defined later."""

    name: str
    text: str
    scope: Scope


Resolve: TypeAlias = "Callable[[str, Scope], Value]"


class Scope(ChainMap[str, Value]):
    """Properties of one macro, namespace or file, before those of its parents and the predefined symbols.

    Args:
        maps: properties of the scopes around it, and last the symbols that are predefined for every file.
        resolve: function that evaluates the text of a property on first access.
        parent: scope around it; None for the scope of the whole file.
        namespace: True for the scope of a file that was included with a name.

    Attributes:
        blocks: elements by the name of a block, ``*name`` or ``**name``.
        macros: elements of macros by name, before those of its parents; a file that was included with a name has
            its own only.
    """

    def __init__(
        self, *maps: MutableMapping[str, Value], resolve: Resolve, parent: Scope | None = None, namespace: bool = False
    ) -> None:
        super().__init__({}, *maps)
        self.blocks: ChainMap[str, Element] = ChainMap() if parent is None else parent.blocks.new_child()
        self.macros: ChainMap[str, Element] = ChainMap() if parent is None or namespace else parent.macros.new_child()
        self._resolve, self._parent, self._namespace = resolve, parent, namespace
        self._pending: list[_Unresolved] = [] if parent is None else parent._pending

    def inner(self, *, namespace: bool = False) -> Scope:
        """Return a new child scope.

        Args:
            namespace: True for the scope of a file that was included with a name.
        """
        return Scope(*self.maps, resolve=self._resolve, parent=self, namespace=namespace)

    def __getitem__(self, name: str) -> Value:
        value = super().__getitem__(name)
        if not isinstance(value, _Unresolved):
            return value
        if value in self._pending:
            raise ModelError(f"circular definition: {' -> '.join(each.name for each in (*self._pending, value))}")
        # Properties on the way: one that needs itself would otherwise recurse without end.
        self._pending.append(value)
        found = value.scope.maps[0][name] = literal(self._resolve(value.text, value.scope))
        self._pending.pop()
        return found

    def define(self, name: str, value: Value, *, lazy: bool = False) -> None:
        """Define a property. A lazy text is evaluated on first access and may use properties defined later.

        Args:
            name: name of the property.
            value: its value, or its text.
            lazy: True to evaluate a text on first access.
        """
        value = literal(value)
        self.maps[0][name] = _Unresolved(name, value, self) if lazy and isinstance(value, str) else value

    def remove(self, name: str) -> None:
        """Remove a property here and in all parents.

        Args:
            name: name of the property.
        """
        for properties in self.maps[:-1]:  # the last map has the symbols
            properties.pop(name, None)

    def outermost(self) -> Scope:
        """Return the scope of the whole file."""
        return self if self._parent is None else self._parent.outermost()

    def caller(self) -> Scope | None:
        """Return the scope that called the macro of this scope, or None."""
        scope = self._parent
        # Scopes of included files are no callers, except of each other.
        while scope is not None and scope._namespace and not self._namespace:
            scope = scope._parent
        return scope


def literal(value: Value) -> Value:
    """Convert a property's text to a number or bool if possible, and remove single quotes around it.

    Args:
        value: value, or text of it.
    """
    if not isinstance(value, str):
        return value
    if len(value) >= 2 and value[0] == value[-1] == "'":
        return value[1:-1]
    if "_" not in value:  # Python would drop it from a number
        for kind in (int, float):
            with suppress(ValueError):
                return kind(value)
    return {"true": True, "True": True, "false": False, "False": False}.get(value, value)


def truth(value: Value, text: str) -> bool:
    """Truth value of a condition.

    Args:
        value: value of the condition.
        text: its text in the file, for the message.

    Raises:
        ModelError: the value is neither true nor false.
    """
    found = literal(value) if isinstance(value, str) else bool(value)
    if not isinstance(found, int):
        raise ModelError(f"'{text}' evaluates to '{value}', which is not a boolean")
    return bool(found)


ENVIRONMENT = (
    *("ROS_DISTRO", "ROS_VERSION", "*_URDF_EXTRAS", "ROBOT_*", "TURTLEBOT*", "HUSKY_*", "JACKAL_*", "RIDGEBACK_*"),
    *("DINGO_*", "WARTHOG_*", "BOXER_*", "CPR_*", "KOBUKI_*", "UR_*", "PR2_*", "TIAGO_*"),
)
"""Patterns of the environment variables that a file may read; all others are private to the user."""

_PIECES = re.compile(r"(?P<escape>\$\$+[{(])|\$\{(?P<value>[^}]*)\}|\$\((?P<command>[^)]*)\)|[^$]+|\$[^{($]+|\$$")


class Arguments(UserDict[str, Value]):
    """Arguments of a file as texts. The mapping converts them to numbers and bools if possible.

    Attributes:
        asked: names that the file declares or reads.
    """

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.asked: set[str] = set()

    def text(self, name: str) -> str:
        """Return the text of an argument; a missing value raises ModelError.

        Args:
            name: name of the argument.
        """
        self.asked.add(name)
        if name not in self:
            given = f"xacro_arguments={{'{name}': ...}} (--arg {name}=...)"
            raise ModelError(f"argument '{name}' has no value: give it with {given}")
        return str(self.data[name])

    def __getitem__(self, name: str) -> Value:
        # As roslaunch converts arguments, which differs from properties: in any case of letters, and with quotes.
        text = self.text(name)
        return text if text.startswith("'") else literal(text.lower() if text.lower() in ("true", "false") else text)


class Substitution:
    """Substitution of expressions and commands in texts.

    Args:
        path: path of the file that is expanded.
        arguments: arguments of the file.
        packages: packages and files that the file may name.

    Attributes:
        files: files being read, the innermost last.
        budget: remaining steps for the file.
        symbols: predefined names of all expressions in the file.
    """

    def __init__(self, path: Path, arguments: Arguments, packages: Packages) -> None:
        self.files = [path]
        self.budget = expressions.Budget()
        self.arguments, self._packages = arguments, packages
        for text in arguments.data.values():
            self._chosen(text)
        xacro = self._xacro()
        own = {name: xacro[name] for name in ("load_yaml", "abs_filename")}
        self.symbols = {**expressions.BUILTINS, **own, "xacro": Namespace("xacro", xacro)}
        self._commands: dict[str, Callable[..., str]] = {
            "arg": arguments.text,
            "dirname": lambda: str(self.files[-1].parent.resolve()),
            "env": self._variable,
            "find": self._found,
            "optenv": lambda name, default="": self._variable(name, default),
        }
        # Names of $(eval ...): its arg() gives numbers, and not their text.
        calls = {name: Function(run) for name, run in self._commands.items()} | {"arg": Function(arguments.__getitem__)}
        kinds = {name: self.symbols[name] for name in ("list", "dict", "str", "float", "int")}
        self._eval_names = {**expressions.MATHEMATICAL, **kinds, "true": True, "false": False, **calls}

    def value(self, text: str, names: Mapping[str, Value]) -> Value:
        """Return a text with all substitutions; a text of a single expression keeps its type.

        Args:
            text: the text.
            names: names that its expressions may use.
        """
        values: list[Value] = []
        place = 0
        # Long texts cost too, else loops over them would be free.
        self.budget.spend(1 + len(text) // 16)
        while place < len(text):
            piece = _PIECES.match(text, place)
            if piece is None:
                raise ModelError(f"expression has no closing bracket: '{text[place : place + 60]}'")
            place = piece.end()
            if piece["escape"] is not None:
                values.append(piece[0][1:])
            elif piece["value"] is not None:
                values.append(self._expression(str(self.value(piece["value"], names)), names))
            elif piece["command"] is not None:
                values.append(self._command(str(self.value(piece["command"], names))))
            else:
                values.append(piece[0])
        if len(values) == 1:
            return values[0]
        parts = [str(each) for each in values]
        # Before they are joined: a text that doubles in each macro would fill memory.
        expressions.check_length(sum(map(len, parts)))
        return "".join(parts)

    def path(self, name: str) -> Path:
        """Return a path relative to the file being read.

        Args:
            name: name of a file in the description.
        """
        return self.files[-1].parent / name

    def admitted(self, path: Path) -> Path:
        """Return the absolute path of a file; raise ModelError if the description may not name it.

        Args:
            path: path of a file.
        """
        return self._packages.admit(path, f"file '{path}'")

    def _expression(self, text: str, names: Mapping[str, Value]) -> Value:
        value = expressions.evaluate(text, names, self.budget)
        if isinstance(value, Function | Namespace):
            raise ModelError(f"'{text[:80]}' is a function or namespace, no value")
        return value

    def _command(self, text: str) -> str:
        if text.startswith("eval "):
            return str(self._expression(text[5:], ChainMap(self._eval_names, self.arguments)))
        command, *words = text.split(maxsplit=2) or [""]  # the default of optenv may have several words
        if command not in self._commands:
            raise ModelError(f"unknown command in '$({text[:60]})'{nearest(command, ['eval', *self._commands])}")
        if len(words) not in {"dirname": (0,), "optenv": (1, 2)}.get(command, (1,)):
            raise ModelError(f"'$({text[:60]})' takes {'no' if command == 'dirname' else 'one'} name")
        return self._commands[command](*words)

    def _found(self, name: str) -> str:
        folder = self._packages.folder(name)
        if folder is None:
            remedy = "give its folder in package_dirs (--package-dir) or in ROS_PACKAGE_PATH"
            raise ModelError(f"no package '{name}': {remedy}")
        return str(folder)

    def _variable(self, name: str, default: str | None = None) -> str:
        is_readable = any(fnmatchcase(name, pattern) for pattern in ENVIRONMENT)
        if is_readable and name in os.environ:
            return self._chosen(os.environ[name])
        if default is not None:
            return default
        if is_readable:
            raise ModelError(f"environment variable '{name}' is not set")
        remedy = "make it an argument, <xacro:arg>, and give that"
        raise ModelError(f"a file may not read environment variable '{name}': {remedy}")

    def _chosen(self, text: str) -> str:
        """Allow the file that the user names in an argument or variable. A folder is not allowed in this way."""
        path = Path(text)
        if path.is_absolute() and os.path.isfile(path):
            self._packages.allow(path)
        return text

    def _xacro(self) -> dict[str, Value]:
        """Members of the namespace ``xacro``."""
        functions: dict[str, Callable[..., Value]] = {
            "load_yaml": self._load_yaml,
            "abs_filename": lambda name: str(self.path(name)),
            "arg": self.arguments.text,
            "fatal": _fail,
            **dict.fromkeys(("message", "print_location"), lambda *_words, **_options: ""),
            **dict.fromkeys(("warning", "error"), self._warn),
        }
        return {name: Function(run) for name, run in functions.items()}

    def _load_yaml(self, name: str) -> Value:
        path = self.admitted(self.path(name))
        try:
            return load_yaml(read_bytes(path).decode(), _unit_loader(self.budget))
        except OSError as error:
            raise ModelError(f"cannot read '{path}': {error.strerror}") from None
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise ModelError(f"'{path}' is not YAML: {error}") from None

    def _warn(self, *words: Value, **_options: Value) -> str:
        warn(f"{self.files[0].name}: {' '.join(map(str, words))[:300]}")
        return ""


def _fail(*words: Value) -> Value:
    raise ModelError(" ".join(map(str, words)))


def _unit_loader(budget: expressions.Budget) -> type[BoundedLoader]:
    """Safe YAML loader with support for units, whose expressions spend the budget of one file."""

    class Loader(BoundedLoader):
        """YAML loader with constructors of its own: yaml keeps them in the class."""

    def read(factor: float, loader: BoundedLoader, node: yaml.ScalarNode) -> float:
        return float(expressions.evaluate(str(loader.construct_scalar(node)), expressions.BUILTINS, budget)) * factor

    units = {"radians": 1.0, "degrees": math.pi / 180.0, "meters": 1.0, "millimeters": 0.001, "foot": 0.3048}
    for unit, factor in {**units, "inches": 0.0254}.items():
        Loader.add_constructor(f"!{unit}", partial(read, factor))
    return Loader
