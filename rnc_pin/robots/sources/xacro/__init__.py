"""Expansion of xacro files without ROS, where expressions can only compute values.

``xacro`` 2.1 defines the format, and the tests compare with it. That library passes expressions to Python's
``eval``, so a file could run any program. This package evaluates their syntax tree (``expressions``) instead. Only
listed functions, methods and environment variables are allowed, and time and size are bounded.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element

from rnc_pin.errors import ModelError, nearest
from rnc_pin.io.safe_read import read_bytes

if TYPE_CHECKING:
    from rnc_pin.robots.sources.xacro.definitions import FileAccess


def is_xacro(path: Path) -> bool:
    """True if the file name ends in ``.xacro``.

    Args:
        path: path of the file.
    """
    return path.name.endswith(".xacro")


def has_macros(root: Element, path: Path) -> bool:
    """True if a file has a xacro element, or declares the prefix and has an expression of xacro, whatever its name.

    Args:
        root: root element of the file, parsed as plain XML.
        path: path of the file.
    """
    if any(element.tag.startswith("xacro:") for element in root.iter()):
        return True
    expression = re.compile(r"\$\{|\$\((arg|find|env|optenv|eval|dirname|anon)\b")
    used = any(expression.search(text) for element in root.iter() for text in element.attrib.values())
    return used and b"xmlns:xacro" in read_bytes(path)


def expand(
    path: Path,
    arguments: Mapping[str, object] | None,
    access: FileAccess,
    known: Mapping[str, Collection[str]] = MappingProxyType({}),
) -> Element:
    """Return the root element of an expanded xacro file.

    Args:
        path: path of the file.
        arguments: values for its ``<xacro:arg>``.
        access: files and packages that it may name.
        known: element to the elements that the format knows inside. Others, with the name of a macro, are refused: they
            are calls without the prefix.

    Raises:
        ModelError: not XML, an unknown macro, argument, property or package, or a refused expression.
    """
    # Most files have no macros: whoever reads one does not wait for the expander.
    from rnc_pin.robots.sources.xacro.definitions import Arguments
    from rnc_pin.robots.sources.xacro.expander import Expander

    given = Arguments({str(name): _text(value) for name, value in (arguments or {}).items()})
    expander = Expander(path, given, access, known)
    try:
        root = expander.expand()
    except RecursionError:
        raise ModelError(f"{path}: xacro: macros or includes are recursive or nested too deeply") from None
    except ModelError as error:
        raise ModelError(f"{path}: xacro: {error}{expander.fault}") from None
    # Afterwards: only the expansion shows which arguments the files ask for.
    for name in given:
        if name not in given.asked:
            raise ModelError(f"{path}: no xacro argument '{name}'{nearest(name, given.asked)}")
    return root


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
