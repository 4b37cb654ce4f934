"""Values that JSON and YAML can represent."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import TypeAlias

from rnc_pin.errors import InputError

Json: TypeAlias = "bool | int | float | str | Sequence[Json] | Mapping[str, Json] | None"


def to_json(content: object, what: str) -> Json:
    """Return a deep copy of JSON values, with mappings and dataclasses as dicts and sequences as lists.

    Args:
        content: value to copy.
        what: its name in errors.

    Raises:
        InputError: a value has no JSON representation.
    """
    if content is None or isinstance(content, bool | int | float | str):
        return content
    if isinstance(content, Mapping):
        return {str(key): to_json(value, f"{what}.{key}") for key, value in content.items()}
    if is_dataclass(content) and not isinstance(content, type):
        return {each.name: to_json(getattr(content, each.name), f"{what}.{each.name}") for each in fields(content)}
    if isinstance(content, list | tuple):
        return [to_json(value, f"{what}[{place}]") for place, value in enumerate(content)]
    raise InputError(f"{what}: is of type {type(content).__name__}, expected numbers, text, lists and mappings")


def to_json_mapping(content: Mapping[str, object], what: str) -> dict[str, Json]:
    """Return a deep copy of a mapping of JSON values, like ``to_json``."""
    return {str(key): to_json(value, f"{what}.{key}") for key, value in content.items()}


def dump_json(content: object) -> str:
    """Return values as JSON text; infinities and NaN become null."""
    return json.dumps(_finite(content), indent=2, allow_nan=False)


def _finite(content: object) -> object:
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, Mapping):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return content
