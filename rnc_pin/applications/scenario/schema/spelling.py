"""Objects in the form of a scenario file: the inverse of the readers in ``derived``."""

from __future__ import annotations

from dataclasses import MISSING
from types import UnionType
from typing import Union, cast, get_args, get_origin

import numpy as np

from rnc_pin.applications.scenario.schema.derived import Entry, ReadAs
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import Json


def spelled(item: object, value: object) -> Json:
    """Return the form of a value in a file.

    Args:
        item: annotation of the reader, such as ``ConstraintItem``; None for numbers, text and lists.
        value: the value.

    Raises:
        ConfigurationError: the value has no form in a file.
    """
    kinds = get_args(item) if get_origin(item) in (Union, UnionType) else (item,)
    for reader in (part for kind in kinds for part in (*get_args(kind), kind)):
        entries: dict[str | None, Entry[object]] = {None: reader} if isinstance(reader, Entry) else {}
        if isinstance(reader, ReadAs):
            entries.update(reader.entries)
        for key, entry in entries.items():
            if type(value) is entry.kind:
                return _spelled_by(entry, value) if key is None else {key: _spelled_by(entry, value)}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return cast(Json, value.tolist())
    if isinstance(value, list | tuple):
        return [spelled(None, each) for each in value]
    raise ConfigurationError(f"a {type(value).__name__} has no form in a file")


def _spelled_by(entry: Entry[object], value: object) -> Json:
    """Mapping of an object, without the parameters that have their defaults."""
    if entry.only is not None:
        return spelled(None, getattr(value, entry.only))
    found: dict[str, Json] = {}
    for each in entry.parameters:
        part = getattr(value, each.name)
        if each.name in entry.required or not _same(part, each.default):
            found[entry.key(each.name)] = spelled(entry.forms.get(each.name), part)
    return found


def _same(value: object, default: object) -> bool:
    if value is default:
        return True
    plain = (bool, int, float, str, list, tuple, np.ndarray)
    if default is MISSING or not (isinstance(value, plain) and isinstance(default, plain)):
        return False
    return bool(np.array_equal(cast(np.ndarray, value), cast(np.ndarray, default)))
