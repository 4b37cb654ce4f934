"""Entries of scenario files that are identified by their one key, and types of values."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, Discriminator

from rnc_pin.io import LIST as LIST
from rnc_pin.io import Json
from rnc_pin.io import Numbers as Numbers
from rnc_pin.io import Strict as Strict
from rnc_pin.io import attribute_texts as attribute_texts
from rnc_pin.io import wrong as wrong
from rnc_pin.model import Positive as Positive

if TYPE_CHECKING:
    Content = Json
else:
    Content = object  # pydantic resolves no recursive alias


def _file_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise ValueError(f"'{name}' cannot name a file: use letters, digits, - and _")
    return name


FileName = Annotated[str, AfterValidator(_file_name)]


NAME, _OTHER = "name", "other"
PLAIN = "without a key"
"""Tag of a mapping of fields beside mappings with one key."""


def _kind(raw: object) -> str:
    """Tag of an entry: its one key, or ``NAME`` for a bare name."""
    if isinstance(raw, dict) and len(raw) == 1:
        return str(next(iter(raw)))
    return NAME if isinstance(raw, str) else _OTHER


BY_KIND = Discriminator(_kind)
