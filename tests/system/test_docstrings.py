"""Promises of docstrings: every parameter is documented, none is swallowed. ``test_copies.py`` runs the examples."""

import ast
import inspect
import re
import sys
import textwrap
from enum import Enum
from itertools import pairwise
from typing import get_type_hints

import pytest

import rnc_pin as rnc

EXPORTS = {name: export for name in rnc.__all__ if callable(export := getattr(rnc, name))}
METHODS = {
    f"{name}.{member}": getattr(export, member)
    for name, export in EXPORTS.items()
    if isinstance(export, type)
    for member, value in vars(export).items()
    if member != "bind"  # of a protocol, which documents it
    if not member.startswith("_") and (inspect.isfunction(value) or isinstance(value, classmethod))
}


def parameters(thing) -> list[inspect.Parameter]:
    """Those of a call, with keys of ``Unpack[...]``; none where Python gives them, or a protocol is not called."""
    if isinstance(thing, type) and issubclass(thing, Exception | Enum) and "__init__" not in vars(thing):
        return []
    if getattr(thing, "_is_protocol", False):
        return []
    found = [each for each in inspect.signature(thing).parameters.values() if each.name != "self"]
    options = [key for each in found for key in keys_of(each, thing)]
    return [*(each for each in found if not keys_of(each, thing)), *options]


def keys_of(parameter: inspect.Parameter, thing) -> list[inspect.Parameter]:
    """Parameters that ``**options: Unpack[...]`` stands for."""
    kind = re.fullmatch(r"Unpack\[(\w+)\]", str(parameter.annotation))
    if parameter.kind is not inspect.Parameter.VAR_KEYWORD or kind is None:
        return []
    keys = get_type_hints(getattr(sys.modules[thing.__module__], kind[1]))
    return [inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY) for key in keys]


def documented(thing) -> set[str]:
    """Parameters that a docstring lists, and fields with a docstring of their own."""
    names = set()
    for section in re.findall(r"^(?:Args|Attributes):\n((?:(?: .*)?\n?)*)", inspect.getdoc(thing) or "", re.MULTILINE):
        for listed in re.findall(r"^    (\w+(?:, \w+)*): ", section, re.MULTILINE):
            names |= set(listed.split(", "))
    if "options" in names:  # by name, as fields of a class that the docstring names
        names |= documented(rnc.loop.LoopSettings)
    kinds = [each for each in thing.__mro__ if each.__module__.startswith("rnc_pin")] if isinstance(thing, type) else []
    return names.union(*map(fields_with_docstrings, kinds))


def fields_with_docstrings(kind: type) -> set[str]:
    source = textwrap.dedent(inspect.getsource(sys.modules[kind.__module__]))
    classes = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef))
    body = next(each.body for each in classes if each.name == kind.__name__)
    return {
        field.target.id
        for field, text in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }


def test_every_parameter_is_documented():
    for name, export in EXPORTS.items():
        known = documented(export)
        missing = [each.name for each in parameters(export) if not each.name.startswith("_") and each.name not in known]
        assert not missing, f"{name} does not document {', '.join(missing)}"


def test_parameters_of_methods_are_documented():
    """In a list of its own, or in the words of a docstring that has none; what all take is in that of the class."""
    for name, method in METHODS.items():
        text = inspect.getdoc(method) or ""
        assert text, f"{name} has no docstring"
        whole = inspect.getdoc(EXPORTS[name.split(".")[0]]).partition("Example:")[0]
        known = documented(method) if "Args:" in text else set(re.findall(r"\w+", text + whole))
        missing = [each.name for each in parameters(method) if each.name not in known]
        assert not missing, f"{name} does not document {', '.join(missing)}"


def test_an_unknown_keyword_is_refused():
    for name, call in {**EXPORTS, **METHODS}.items():
        assert all(each.kind is not inspect.Parameter.VAR_KEYWORD for each in parameters(call)), name
        with pytest.raises(TypeError):
            call(no_such_keyword=1)
