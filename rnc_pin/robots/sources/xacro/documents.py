"""XML parser for xacro: elements know their place in the files."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from rnc_pin.errors import ModelError
from rnc_pin.io.safe_read import read_bytes
from rnc_pin.io.safe_xml import parse_tree

_DEEPEST = 200


class PlacedElement(Element):
    """Element with the file and line of its start tag; line 0 if it is in no file."""

    file: Path = Path()
    line: int = 0

    def copied(self, tag: str) -> PlacedElement:
        """Return an empty element with this place."""
        copy = PlacedElement(tag)
        copy.file, copy.line = self.file, self.line
        return copy


def read_document(path: Path) -> PlacedElement:
    """Return the root element of a file.

    Raises:
        ModelError: the file cannot be read, is not XML, or has elements more than 200 deep.
    """

    def make(tag: str, attributes: dict[str, str], line: int) -> PlacedElement:
        element = PlacedElement(tag, attributes)
        element.file, element.line = path, line
        return element

    try:
        root = parse_tree(read_bytes(path), _DEEPEST, make)
    except OSError as error:
        raise ModelError(f"cannot read '{path}': {error.strerror}") from None
    except (ParseError, LookupError, ValueError) as error:  # also for an unknown encoding
        raise ModelError(f"not well-formed XML: {error}") from None
    assert isinstance(root, PlacedElement)
    return root
