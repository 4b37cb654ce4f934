"""Exports of a package, imported at their first use.

The stub ``__init__.pyi`` of the package lists them, as type checkers and editors read them. So each is stated once:
``from .constraints import *`` exports all names that the stub of ``constraints`` lists.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from importlib.util import resolve_name
from pathlib import Path
from types import FunctionType, ModuleType


class _Package(ModuleType):
    """Package with an export that has the name of its module, e.g. the function ``simulate`` of ``simulate.py``.

    Python sets each imported module as an attribute of its package. This one would hide the export.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if name not in self.__dict__["_hidden_modules"] or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


def lazy_exports(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package, from the imports in its stub.

    Args:
        package: name of the package, whose ``__init__.py`` is running.
    """
    module = sys.modules[package]
    exports = listed_exports(Path(str(module.__file__)).with_suffix(".pyi"), package)
    names = sorted(exports)
    # A function in a module of its own name: importing the module must not replace the function.
    hidden = {name for name, (origin, _) in exports.items() if origin == f"{package}.{name}"}
    if hidden:
        module.__dict__["_hidden_modules"] = hidden
        module.__class__ = _Package

    def get(name: str) -> object:
        if name not in exports:
            raise AttributeError(f"module '{package}' has no attribute '{name}'", name=name, obj=module)
        origin, attribute = exports[name]
        if origin == package:  # from . import subpackage
            return import_module(f"{package}.{attribute}")
        # Kept in the package: the next use finds it without a call.
        value = module.__dict__[name] = _explained(import_module(origin), attribute, name)
        return value

    return get, lambda: names.copy(), names.copy()


def listed_exports(stub: Path, package: str) -> dict[str, tuple[str, str]]:
    """Exports of a package by name: the module to import each from, and its name there."""
    found: dict[str, tuple[str, str]] = {}
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            origin = resolve_name("." * node.level + (node.module or ""), package)
            # Names of a lazy package come from its own stub, so that nothing else is imported.
            if node.names[0].name == "*":
                names = import_module(origin).__all__
                found |= {name: (origin, name) for name in names}
            else:
                found |= {each.asname or each.name: (origin, each.name) for each in node.names}
    return found


def _explained(module: ModuleType, name: str, title: str) -> object:
    """Class or function whose failing calls name an argument of another class than its annotation.

    Nothing is checked before a call, so that it takes no longer, and what serves in place of a class may do so.
    """
    export = getattr(module, name)
    call = vars(export).get("__init__") if isinstance(export, type) else export
    if not isinstance(call, FunctionType) or hasattr(call, "__wrapped__") or getattr(export, "_is_protocol", False):
        return export

    @wraps(call)
    def explained(*arguments: object, **named: object) -> object:
        try:
            return call(*arguments, **named)
        except (AttributeError, TypeError):
            # Calls among modules of this package fail by what the outermost one was given, which is explained.
            if not str(sys._getframe(1).f_globals.get("__name__")).startswith("rnc_pin."):
                from rnc_pin.errors import check_classes

                check_classes(title, call, arguments, named)
            raise

    if isinstance(export, type):
        export.__init__ = explained  # type: ignore[misc]
        return export
    setattr(module, name, explained)  # the same in all packages, and in a pickle
    return explained
