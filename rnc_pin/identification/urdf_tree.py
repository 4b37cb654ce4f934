"""Elements of a URDF that a copy with other numbers changes."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, tostring

from rnc_pin.errors import ConfigurationError
from rnc_pin.io.atomic_write import atomic_file
from rnc_pin.io.safe_read import read_bytes
from rnc_pin.io.safe_xml import parse_tree


def read_tree(source: Path) -> tuple[Element, dict[str, Element]]:
    """Root of a URDF, and its joints by name.

    Raises:
        ConfigurationError: the source cannot be read.
    """
    try:
        root = parse_tree(read_bytes(source))
    except OSError as error:
        raise ConfigurationError(f"{source}: {error.strerror or 'cannot be read'}") from None
    except ParseError as error:
        raise ConfigurationError(f"{source}: not a URDF: {error}") from None
    return root, {str(each.get("name")): each for each in root.iter("joint") if each.find("child") is not None}


def write_tree(root: Element, path: Path) -> None:
    """Write a URDF; a failure leaves no partial file."""
    with atomic_file(path) as partial:
        partial.write_bytes(tostring(root, encoding="utf-8", xml_declaration=True))
