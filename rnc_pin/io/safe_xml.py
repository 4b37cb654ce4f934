"""XML parser for untrusted texts: limited depth and size, and no other files."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn
from xml.etree.ElementTree import Element, ParseError, TreeBuilder
from xml.parsers import expat

from rnc_pin.errors import ModelError

_MAX_DEPTH = 400  # bodies of MJCF are nested
_MAX_ELEMENTS = 1_000_000  # elements: each takes more memory than its text


def parse_tree(
    content: str | bytes,
    deepest: int = _MAX_DEPTH,
    make: Callable[[str, dict[str, str], int], Element] | None = None,
) -> Element:
    """Return the root element of a text, without external entities.

    Names keep their prefixes, and declarations of namespaces are dropped: urdfdom, MuJoCo and xacro read no namespaces.

    Args:
        content: the text.
        deepest: largest depth of an element.
        make: function from tag, attributes and line to an element; ``Element`` by default.

    Raises:
        ModelError: elements are too deep, or too many.
        xml.etree.ElementTree.ParseError: the text is not well formed.
    """
    parser = expat.ParserCreate()
    builder = TreeBuilder(
        None if make is None else lambda tag, attributes: make(tag, attributes, parser.CurrentLineNumber)
    )
    depth = count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth += 1
        count += 1
        if depth > deepest or count > _MAX_ELEMENTS:
            raise ModelError(f"elements are more than {deepest} deep, or more than {_MAX_ELEMENTS:,}")
        kept = {key: value for key, value in attributes.items() if key != "xmlns" and not key.startswith("xmlns:")}
        builder.start(tag, kept)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(name: str, *_place: object) -> NoReturn:
        raise ParseError(f"undefined entity &{name};: line {parser.CurrentLineNumber}")

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.SkippedEntityHandler = parser.ExternalEntityRefHandler = refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise ParseError(str(error)) from None
    return builder.close()
