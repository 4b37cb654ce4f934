"""Messages of all errors, for the families that ``docs/errors.md`` describes.

A mark of the page names the modules of a family. Each message is read from the place that makes the error, with ``…``
for values. A module belongs to the longest path that begins its own. ``model:InputError`` stands for the messages of
one class only.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

PAGE = Path(__file__).parent / "errors.md"
PACKAGE = Path(__file__).parent.parent / "rnc_pin"
_LONGEST = 130  # letters of a message that the page shows
_MARK = re.compile(r"<!-- generated: messages (?P<paths>[\w/.: ]+) -->\n")
_GAP = "…"
_FORWARDED = {"ValueError", "wrong"}  # which scenario files turn into ConfigurationError


class Message(NamedTuple):
    """Message of an error: the module and line that make it, its class, and its text with gaps for values."""

    path: str
    line: int
    kind: str
    text: str


@cache
def error_classes() -> frozenset[str]:
    """Names of the errors of the package: classes that derive from an error, and have a message for a user."""
    bases = {
        node.name: {base.id for base in node.bases if isinstance(base, ast.Name)}
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(_tree(path))
        if isinstance(node, ast.ClassDef)
    }
    found = {"Exception", "ValueError"}
    while more := {name for name, above in bases.items() if above & found} - found:
        found |= more
    return frozenset(name for name in found - {"Exception", "ValueError"} if name.endswith("Error"))


def messages() -> list[Message]:
    """All messages of the package, in the order of their modules and lines."""
    return [each for path in sorted(PACKAGE.rglob("*.py")) for each in _messages_of(path)]


def _messages_of(path: Path) -> Iterator[Message]:
    tree, name = _tree(path), path.relative_to(PACKAGE).as_posix()
    forwarded = _FORWARDED if name.startswith("applications/scenario/") else set()
    for scope, node in _calls(tree, None):
        kind = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        if kind == "place_of":  # of a name that is not known
            text = _words(node.args[2], _Names(tree, scope)) + f" '{_GAP}'{_GAP}"
            kind = ast.unparse(node.args[3]) if len(node.args) > 3 else "ConfigurationError"
        elif kind not in error_classes() | forwarded or not node.args:
            continue
        else:
            text = _words(node.args[-1 if kind == "wrong" else 0], _Names(tree, scope))
        text = " ".join(re.sub(rf"{_GAP}+", _GAP, text).split())
        if len(re.findall("[a-zA-Z]", text)) >= 4:  # else it forwards the message of another error
            shown = text if len(text) <= _LONGEST else text[:_LONGEST].rsplit(" ", 1)[0] + f" {_GAP}"
            yield Message(name, node.lineno, "ConfigurationError" if kind in _FORWARDED else kind, shown)


def _calls(node: ast.AST, scope: ast.AST | None) -> Iterator[tuple[ast.AST | None, ast.Call]]:
    """Calls below a node, each with the function around it."""
    for below in ast.iter_child_nodes(node):
        if isinstance(below, ast.Call):
            yield scope, below
        yield from _calls(below, below if isinstance(below, ast.FunctionDef) else scope)


class _Names(NamedTuple):
    """Module of a text and the function around it, which assign the names in it."""

    tree: ast.Module
    scope: ast.AST | None


def _words(node: ast.AST, names: _Names, depth: int = 0) -> str:
    """Text of an expression, with gaps for values."""
    if depth > 5:
        return _GAP
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else _GAP
    if isinstance(node, ast.JoinedStr):
        return "".join(_words(each, names, depth) for each in node.values)
    if isinstance(node, ast.FormattedValue):
        return _words(node.value, names, depth + 1) if isinstance(node.value, ast.Call) else _GAP
    if isinstance(node, ast.BinOp):
        return _words(node.left, names, depth + 1) + _words(node.right, names, depth + 1)
    if isinstance(node, ast.IfExp):
        return max((_words(each, names, depth + 1) for each in (node.body, node.orelse)), key=len)
    if isinstance(node, ast.List | ast.Tuple) and node.elts:
        return _words(node.elts[0], names, depth + 1) + _GAP
    if isinstance(node, ast.Name):
        return _assigned(node.id, names, depth + 1)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "join" and node.args:
        return _words(node.args[0], names, depth + 1)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):  # of this module
        return _returned(node.func.id, names, depth + 1)
    return _GAP


def _assigned(name: str, names: _Names, depth: int) -> str:
    """Longest text that a function or its module assigns to a name."""
    found = [
        _words(node.value, names, depth)
        for where in (names.scope, names.tree)
        if where is not None
        for node in ast.walk(where)
        if isinstance(node, ast.Assign) and any(isinstance(each, ast.Name) and each.id == name for each in node.targets)
    ]
    return max(found, key=len, default=_GAP)


def _returned(name: str, names: _Names, depth: int) -> str:
    """Longest text that a function of the module returns."""
    found = [
        _words(below.value, _Names(names.tree, node), depth)
        for node in ast.walk(names.tree)
        if isinstance(node, ast.FunctionDef) and node.name == name
        for below in ast.walk(node)
        if isinstance(below, ast.Return) and below.value is not None
    ]
    return max(found, key=len, default=_GAP)


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


# ---------------------------------------------------------------------- page


def family_of(message: Message, prefixes: list[str]) -> str | None:
    """The longest of the paths of families that begins that of a message; None if none does."""
    fitting = []
    for each in prefixes:
        path, _, kind = each.partition(":")
        if kind in ("", message.kind) and (message.path == path or message.path.startswith(f"{path}/")):
            fitting.append((len(path), kind, each))
    return max(fitting)[2] if fitting else None


@cache
def prefixes() -> list[str]:
    """Paths of all families of the page."""
    return [path for mark in _MARK.finditer(PAGE.read_text(encoding="utf-8")) for path in mark["paths"].split()]


@cache
def _by_family() -> dict[str | None, list[Message]]:
    found: dict[str | None, list[Message]] = {}
    for each in messages():
        found.setdefault(family_of(each, prefixes()), []).append(each)
    return found


def family(*paths: str) -> str:
    """List of the messages of a family, in alphabetical order."""
    lines = {f"* {_quoted(each.text)} ({each.kind})\n" for path in paths for each in _by_family().get(path, [])}
    return "".join(sorted(lines, key=lambda line: (line.strip("*`… '").lower(), line)))


def _quoted(text: str) -> str:
    """Text as code of Markdown."""
    fence = "``" if "`" in text else "`"
    return f"{fence}{' ' * (len(fence) > 1)}{text}{' ' * (len(fence) > 1)}{fence}"
