"""Xacro, expanded without ROS by the reference implementation, its expressions checked before they are evaluated.

Expressions ``${...}`` and ``$(eval ...)`` are Python, and the library hands them to ``eval``. It withholds the
builtins and refuses names that begin with two underscores, but looks for those only in the outermost code object:
with xacro 2.1.1 ``${(lambda: ().__class__.__base__.__subclasses__())()}`` reaches every class of the process and from
there the shell, and so does ``python.vars(python.type(...))``. A robot's file must not be able to run a program. So
every expression is parsed first, in a copy of the library that is loaded for this package alone, and refused where it
has anything besides arithmetic, comparisons, literals, comprehensions of lists, calls, and attributes without an
underscore in front; ``python.type`` and ``python.vars`` are taken away, and so are the methods of text that look up
attributes. What is left computes numbers and text. It can still read YAML files (``xacro.load_yaml``), read
environment variables (``$(env ...)``), include any XML file, and take long.
"""

from __future__ import annotations

import ast
import contextlib
import importlib.util
import io
import re
import sys
import threading
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

from rnc_pin.errors import ModelError, nearest
from rnc_pin.robots.sources.packages import Packages

_COPY = f"{__package__}.guarded_xacro"
_ENDINGS = (".xacro",)
_NAMESPACE = re.compile(r"\{https?://(www\.)?(ros\.org/wiki/xacro|wiki\.ros\.org/xacro)[^}]*\}")
_EXPRESSION = re.compile(r"\$\{|\$\((arg|find|env|optenv|eval|dirname|anon)\b")
_ALLOWED = (
    *(
        ast.Expression,
        ast.Constant,
        ast.Name,
        ast.Load,
        ast.Store,
        ast.Attribute,
        ast.Subscript,
        ast.Slice,
        ast.Starred,
    ),
    *(ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Call, ast.keyword, ast.operator, ast.unaryop),
    *(ast.boolop, ast.cmpop, ast.List, ast.Tuple, ast.Dict, ast.Set, ast.ListComp, ast.comprehension),
)
_ATTRIBUTES = ("format", "format_map", "mro")
_WITHHELD = ("type", "vars")
_POWER = 64  # largest exponent: 9**9**9 would not end

_lock = threading.Lock()  # the library keeps what it works on in its module, and the copy where it looks for packages


def is_xacro(path: Path) -> bool:
    """Whether a file is to be expanded, by its name."""
    return path.name.endswith(_ENDINGS)


def has_macros(root: ElementTree.Element, path: Path) -> bool:
    """Whether a file of another name uses xacro: it declares its namespace and has an element or expression of it.

    Args:
        root: of the file, parsed as plain XML.
        path: of the file.
    """
    if any(_NAMESPACE.match(element.tag) for element in root.iter()):
        return True
    used = any(_EXPRESSION.search(text) for element in root.iter() for text in element.attrib.values())
    return used and b"xmlns:xacro" in path.read_bytes()


def expand(path: Path, arguments: Mapping[str, object] | None, packages: Packages) -> str:
    """The XML that a xacro file stands for.

    Args:
        path: of the file.
        arguments: values for its ``<xacro:arg>``.
        packages: where ``$(find ...)`` looks.

    Raises:
        ModelError: not XML, an unknown macro, argument, property or package, or an expression that is refused.
    """
    given = _Arguments({str(name): _text(value) for name, value in (arguments or {}).items()})
    names = list(given)
    with _lock, contextlib.redirect_stderr(io.StringIO()):
        guarded = _guarded()
        xacro, guarded.packages = guarded.library, packages
        try:
            text = str(xacro.process_file(str(path), mappings=given).documentElement.toxml())
        except RecursionError:
            raise ModelError(f"{path}: xacro: macros or includes without end") from None
        except Exception as error:  # the library raises what Python raised inside an expression
            raise ModelError(f"{path}: xacro: {_words(error)}{_place(xacro, path)}") from None
        finally:
            xacro.substitution_args_context["arg"] = {}
    for name in names:
        if name not in given.asked:
            raise ModelError(f"{path}: no xacro argument '{name}'{nearest(name, given.asked)}")
    return text


class _Arguments(dict[str, str]):
    """Arguments that remember which were asked for: xacro takes one that no file declares without a word."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.asked: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.asked.add(name)
        return super().__getitem__(name)


def check_expression(text: str) -> None:
    """Refuse an expression that could do more than compute.

    Raises:
        ModelError: it could, or it is no expression.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, MemoryError):
        raise ModelError(f"'{text}' is not an expression") from None
    for node in ast.walk(tree):
        name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
        allowed = isinstance(node, _ALLOWED)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            power = node.right.operand if isinstance(node.right, ast.UnaryOp) else node.right
            value = power.value if isinstance(power, ast.Constant) else None
            allowed = isinstance(value, int | float) and abs(value) <= _POWER
        if isinstance(node, ast.LShift) or not allowed or name.startswith("__"):
            raise ModelError(f"refuses to evaluate '{text}': it could do more than compute a value")
        if isinstance(node, ast.Attribute) and (name.startswith("_") or name in _ATTRIBUTES):
            raise ModelError(f"refuses to evaluate '{text}': attribute '{name}' could do more than compute a value")


class _Guarded:
    """A copy of the library that is ours alone, with its evaluations checked and with our way of finding packages.

    The library has no place to hang these on, and whoever else uses it in this process is to find it as it is.

    Attributes:
        library: the module.
        packages: where ``$(find ...)`` looks at present.
    """

    def __init__(self) -> None:
        found = importlib.util.find_spec("xacro")
        assert found is not None, "a dependency of this package"
        spec = importlib.util.spec_from_file_location(
            _COPY, found.origin, submodule_search_locations=found.submodule_search_locations
        )
        assert spec is not None
        assert spec.loader is not None
        library: Any = importlib.util.module_from_spec(spec)
        sys.modules[_COPY] = library  # where its modules look for each other
        spec.loader.exec_module(library)
        substitution: Any = importlib.import_module(f"{_COPY}.substitution_args")
        library.safe_eval = _guarding(library.safe_eval)
        substitution._eval = _guarding(substitution._eval)
        substitution._eval_find = substitution._eval_dict["find"] = self._find
        symbols = library._global_symbols["python"]
        for name in _WITHHELD:
            symbols.pop(name, None)
        self.library = library
        self.packages: Packages | None = None

    def _find(self, name: str) -> str:
        folder = None if self.packages is None else self.packages.folder(name)
        if folder is None:
            raise ModelError(
                f"no package '{name}': give its folder in package_dirs (--package-dir) or in ROS_PACKAGE_PATH"
            )
        return str(folder)


@cache
def _guarded() -> _Guarded:
    """The copy, made when the first file needs it."""
    return _Guarded()


def _guarding(evaluate: Callable[..., object]) -> Callable[..., object]:
    def call(expression: str, *rest: object) -> object:
        check_expression(expression)
        return evaluate(expression, *rest)

    return call


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _words(error: Exception) -> str:
    """One line of what the library says; it wraps errors into one another."""
    cause: BaseException = error
    while isinstance(getattr(cause, "exc", None), BaseException):
        cause = cause.exc  # type: ignore[attr-defined]
    if isinstance(cause, ModelError):
        return str(cause)
    if isinstance(cause, RecursionError):
        return "macros or includes without end"
    if isinstance(cause, OSError):
        return f"cannot read '{cause.filename}': {cause.strerror}"
    kind = type(cause).__name__
    if kind == "ArgException":
        return f"argument '{cause}' has no value: give it with xacro_arguments={{'{cause}': ...}} (--arg {cause}=...)"
    words = str(cause) if kind == "SubstitutionException" else str(error)
    return " ".join(words.split()) or kind


def _place(xacro: ModuleType, path: Path) -> str:
    """The included file that was being read."""
    files = [each for each in xacro.filestack or [] if each]
    return f" (in {files[-1]})" if files and Path(files[-1]) != path else ""
