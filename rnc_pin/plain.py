"""Plain data: values that JSON and YAML can represent."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import TypeAlias

from rnc_pin.errors import InputError

Json: TypeAlias = "bool | int | float | str | Sequence[Json] | Mapping[str, Json] | None"


def plain(content: object, what: str) -> Json:
    """Return a deep copy with mappings as dicts and sequences as lists.

    Args:
        content: value to copy.
        what: its name in errors.

    Raises:
        InputError: a value has no JSON representation.
    """
    if content is None or isinstance(content, bool | int | float | str):
        return content
    if isinstance(content, Mapping):
        return {str(key): plain(value, f"{what}.{key}") for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [plain(value, f"{what}[{place}]") for place, value in enumerate(content)]
    raise InputError(f"{what}: is of type {type(content).__name__}, expected numbers, text, lists and mappings")


def plain_mapping(content: Mapping[str, object], what: str) -> dict[str, Json]:
    """Return ``plain`` of each value of a mapping."""
    return {str(key): plain(value, f"{what}.{key}") for key, value in content.items()}


def significant(value: float, digits: int = 2) -> float:
    """Round a number to significant digits."""
    return float(f"{value:.{digits}g}")


def json_text(content: object) -> str:
    """Return plain data as JSON text; infinities and NaN become null."""
    return json.dumps(_finite(content), indent=2, allow_nan=False)


def _finite(content: object) -> object:
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, Mapping):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return content
