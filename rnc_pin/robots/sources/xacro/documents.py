"""XML parser for xacro: names keep their prefix, and comments are skipped."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from rnc_pin.errors import ModelError
from rnc_pin.io.safe_read import read_bytes

_DEEPEST = 200


def read_document(path: Path) -> Element:
    """Return the root element of a file.

    Raises:
        ModelError: the file cannot be read, is not XML, or has elements more than 200 deep.
    """
    try:
        content = read_bytes(path)
    except OSError as error:
        raise ModelError(f"cannot read '{path}': {error.strerror}") from None
    builder, depth = TreeBuilder(), 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise ModelError(f"elements are more than {_DEEPEST} deep")
        kept = {key: value for key, value in attributes.items() if key != "xmlns" and not key.startswith("xmlns:")}
        builder.start(name, kept)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, LookupError, ValueError) as error:  # also for an unknown encoding
        raise ModelError(f"not well-formed XML: {error}") from None
    return builder.close()
