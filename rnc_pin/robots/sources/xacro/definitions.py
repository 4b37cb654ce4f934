"""Definitions of a xacro file: elements with their places, macros, scopes; and values of ``${...}`` and ``$(...)``."""

from __future__ import annotations

import math
import os
import re
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Protocol
from xml.etree.ElementTree import Element, ParseError

import yaml

from rnc_pin.errors import ModelError, nearest, warn
from rnc_pin.io.safe_read import BoundedLoader, load_yaml, parse_tree, read_bytes
from rnc_pin.robots.sources.xacro import expressions
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


ENVIRONMENT = (
    *("ROS_DISTRO", "ROS_VERSION", "*_URDF_EXTRAS", "ROBOT_*", "TURTLEBOT*", "HUSKY_*", "JACKAL_*", "RIDGEBACK_*"),
    *("DINGO_*", "WARTHOG_*", "BOXER_*", "CPR_*", "KOBUKI_*", "UR_*", "PR2_*", "TIAGO_*"),
)
"""Patterns of the environment variables that a file may read; all others are private to the user."""

_PIECES = re.compile(r"(?P<escape>\$\$+[{(])|\$\{(?P<value>[^}]*)\}|\$\((?P<command>[^)]*)\)|[^$]+|\$[^{($]+|\$$")


class Arguments(Mapping[str, Value]):
    """Arguments of a file. The mapping converts their values to numbers and bools if possible.

    Attributes:
        asked: names that the file declares or reads.
        given: texts of the arguments given by the user.
    """

    def __init__(self, given: Mapping[str, str]) -> None:
        self._texts = dict(given)
        self.given = tuple(given.values())
        self.asked: set[str] = set()

    def declare(self, name: str, default: str | None) -> None:
        """Declare an argument; the default applies if the user gives no value.

        Args:
            name: name of the argument.
            default: text of its default; None if it has none.
        """
        self.asked.add(name)
        if default is not None:
            self._texts.setdefault(name, default)

    def text(self, name: str) -> str:
        """Return the text of an argument; a missing value raises ModelError.

        Args:
            name: name of the argument.
        """
        self.asked.add(name)
        if name not in self._texts:
            given = f"xacro_arguments={{'{name}': ...}} (--arg {name}=...)"
            raise ModelError(f"argument '{name}' has no value: give it with {given}")
        return self._texts[name]

    def __getitem__(self, name: str) -> Value:
        text = self.text(name)
        for kind in (int, float) if "." not in text else (float,):
            try:
                return kind(text)
            except ValueError:
                continue
        return {"true": True, "false": False}.get(text.lower(), text)

    def __contains__(self, name: object) -> bool:
        return name in self._texts

    def __iter__(self) -> Iterator[str]:
        return iter(self._texts)

    def __len__(self) -> int:
        return len(self._texts)


class FileAccess(Protocol):
    """Files and packages that a file may name."""

    def folder(self, name: str) -> Path | None:
        """Folder of a package, or None if it is not found.

        Args:
            name: name of the package.
        """
        ...

    def admit(self, file: Path, what: str) -> Path:
        """Return the absolute path of a file; raise ModelError with the words ``what`` if it is not allowed.

        Args:
            file: path as in the description.
            what: name of the file in messages.
        """
        ...

    def add(self, path: Path) -> None:
        """Allow a file that the user named.

        Args:
            path: path of the file.
        """
        ...


class Substitution:
    """Substitution of expressions and commands in texts.

    Args:
        path: path of the file that is expanded.
        arguments: arguments of the file.
        access: files and packages that the file may name.

    Attributes:
        files: files being read, the innermost last.
        budget: remaining steps for the file.
        symbols: predefined names of all expressions in the file.
    """

    def __init__(self, path: Path, arguments: Arguments, access: FileAccess) -> None:
        self.files = [path]
        self.budget = expressions.Budget()
        self.arguments = arguments
        self._access = access
        for text in arguments.given:
            self._chosen(text)
        self.symbols = expressions.builtins() | self._xacro()
        kinds = ("list", "dict", "str", "float", "int")
        self._commands = expressions.mathematical() | {name: self.symbols[name] for name in kinds}
        self._commands |= {"true": True, "false": False}
        for name, run in (
            ("arg", arguments.__getitem__),
            ("dirname", self._folder),
            ("env", self._variable),
            ("optenv", self._optional_variable),
            ("find", self._found),
        ):
            self._commands[name] = expressions.Function(run)

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
                values.append(self._expression(piece["value"], names))
            elif piece["command"] is not None:
                values.append(self._command(str(self.value(piece["command"], names))))
            else:
                values.append(piece[0])
        if len(values) == 1:
            return values[0]
        parts = [str(each) for each in values]
        # Before they are joined: a text that doubles in each macro would fill memory.
        if sum(map(len, parts)) > expressions.LETTERS:
            raise ModelError(f"a text of more than {expressions.LETTERS:,} characters")
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
        return self._access.admit(path, f"file '{path}'")

    def _expression(self, text: str, names: Mapping[str, Value]) -> Value:
        value = expressions.evaluate(str(self.value(text, names)), names, self.budget)
        if isinstance(value, expressions.Function | Namespace):
            raise ModelError(f"'{text[:80]}' is a function or namespace, no value")
        return value

    def _command(self, text: str) -> str:
        if text.startswith("eval "):
            names = ChainMap(self._commands, self.arguments)  # type: ignore[arg-type]  # both are only read
            return str(expressions.evaluate(text[5:], names, self.budget))
        command, *words = text.split() or [""]
        commands = ("arg", "dirname", "env", "eval", "find", "optenv")
        if command not in commands:
            raise ModelError(f"unknown command in '$({text[:60]})'{nearest(command, commands)}")
        if command == "dirname":
            return self._folder()
        # Its default may have several words.
        if command == "optenv" and words:
            return self._optional_variable(words[0], " ".join(words[1:]))
        if len(words) != 1:
            raise ModelError(f"'$({text[:60]})' takes one name")
        run = {"arg": self.arguments.text, "find": self._found, "env": self._variable}[command]
        return run(words[0])

    def _folder(self) -> str:
        return str(self.files[-1].parent.resolve())

    def _found(self, name: str) -> str:
        folder = self._access.folder(name)
        if folder is None:
            remedy = "give its folder in package_dirs (--package-dir) or in ROS_PACKAGE_PATH"
            raise ModelError(f"no package '{name}': {remedy}")
        return str(folder)

    def _variable(self, name: str) -> str:
        if not _is_readable(name):
            remedy = "make it an argument, <xacro:arg>, and give that"
            raise ModelError(f"a file may not read environment variable '{name}': {remedy}")
        if name not in os.environ:
            raise ModelError(f"environment variable '{name}' is not set")
        return self._chosen(os.environ[name])

    def _optional_variable(self, name: str, default: str = "") -> str:
        return self._chosen(os.environ[name]) if _is_readable(name) and name in os.environ else default

    def _chosen(self, text: str) -> str:
        """Allow the file that the user names in an argument or variable. A folder is not allowed in this way."""
        path = Path(text)
        if path.is_absolute() and os.path.isfile(path):
            self._access.add(path)
        return text

    def _xacro(self) -> dict[str, Value]:
        functions = {
            "load_yaml": expressions.Function(self._load_yaml),
            "abs_filename": expressions.Function(lambda name: str(self.path(name))),
        }
        members = functions | {
            "arg": expressions.Function(self.arguments.text),
            "fatal": expressions.Function(_fail),
            "message": expressions.Function(_say_nothing),
            "print_location": expressions.Function(_say_nothing),
            "warning": expressions.Function(self._warn),
            "error": expressions.Function(self._warn),
        }
        return {**functions, "xacro": Namespace("xacro", members)}

    def _load_yaml(self, name: str) -> Value:
        path = self.admitted(self.path(name))
        try:
            text = read_bytes(path).decode()
            return load_yaml(text, unit_loader(self.budget))
        except OSError as error:
            raise ModelError(f"cannot read '{path}': {error.strerror}") from None
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise ModelError(f"'{path}' is not YAML: {error}") from None

    def _warn(self, *words: Value, **_options: Value) -> str:
        text = " ".join(map(str, words))
        warn(f"{self.files[0].name}: {text[:300]}")
        return ""


def _is_readable(name: str) -> bool:
    """True if a file may read an environment variable."""
    return any(fnmatchcase(name, pattern) for pattern in ENVIRONMENT)


def _fail(*words: Value) -> Value:
    raise ModelError(" ".join(map(str, words)))


def _say_nothing(*_words: Value, **_options: Value) -> str:
    return ""


def unit_loader(budget: expressions.Budget) -> type[BoundedLoader]:
    """Return a safe YAML loader with support for units.

    Args:
        budget: limit on the steps of the expressions in it.
    """
    names = expressions.builtins()

    def reading(factor: float) -> Callable[[BoundedLoader, yaml.ScalarNode], float]:
        def read(loader: BoundedLoader, node: yaml.ScalarNode) -> float:
            return float(expressions.evaluate(str(loader.construct_scalar(node)), names, budget)) * factor

        return read

    class Loader(BoundedLoader):
        """YAML loader with the unit tags and the budget of one file."""

    units = {
        "!radians": 1.0,
        "!degrees": math.pi / 180.0,
        "!meters": 1.0,
        "!millimeters": 0.001,
        "!foot": 0.3048,
        "!inches": 0.0254,
    }
    for tag, factor in units.items():
        Loader.add_constructor(tag, reading(factor))
    return Loader
