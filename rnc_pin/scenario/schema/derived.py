"""Entries of a scenario file from the dataclasses that they build.

Names, types, defaults and descriptions stand in the dataclass alone: descriptions are those of its docstring. What a
file says otherwise than its fields do stands in its ``Entry``.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field
from functools import cached_property, reduce
from operator import attrgetter, or_
from types import GenericAlias, UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import AfterValidator, BaseModel, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, Tag, create_model
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from rnc_pin.errors import RncError
from rnc_pin.scenario.schema.base import BY_KIND, NAME, Strict


@dataclass(frozen=True)
class Entry:
    """What reads a dataclass from a file: ``Annotated[View, Entry(View)]`` validates to a ``View``.

    Attributes:
        kind: the dataclass.
        short: a field whose value may stand instead of the mapping.
        only: a field whose value stands instead of the mapping, which is not taken.
        keys: what a file calls a field, where that is not the field's name.
        required: fields that have to be said although the dataclass has a default.
    """

    kind: type
    short: str | None = None
    only: str | None = None
    keys: Mapping[str, str] = field(default_factory=dict)
    required: tuple[str, ...] = ()

    def build(self, said: object) -> object:
        """The dataclass from what a file says; what that leaves out is as the dataclass has it."""
        try:
            return self.kind(**self._given(said))
        except RncError as error:  # to be told with its place in the file
            raise ValueError(str(error)) from None

    def _given(self, said: object) -> dict[str, object]:
        if not isinstance(said, BaseModel):
            return {str(self.only): said}
        keys = {each: self._key(each.name) for each in self._fields if self._key(each.name) in said.model_fields_set}
        values = {each: getattr(said, key) for each, key in keys.items()}
        return {each.name: value for each, value in values.items() if value is not None or not _unlimited(each)}

    @property
    def _fields(self) -> list[dataclasses.Field[object]]:
        return [each for each in dataclasses.fields(self.kind) if each.init]

    def _key(self, name: str) -> str:
        return self.keys.get(name, name)

    @cached_property
    def model(self) -> type[Strict]:
        """The mapping that a file writes."""
        types, texts = get_type_hints(self.kind, include_extras=True), descriptions(self.kind)
        fields = {
            self._key(each.name): self._field(each, types[each.name], texts.get(each.name, "")) for each in self._fields
        }
        return _mapping(self.kind.__name__, summary(self.kind), fields)

    def _field(self, each: dataclasses.Field[object], kind: object, text: str) -> tuple[object, object]:
        """Type and default of a field of the mapping."""
        default = each.default if each.default_factory is MISSING else each.default_factory()
        if _unlimited(each):
            kind, default = _either([kind, None]), None
        if default is MISSING or each.name in self.required:
            default = ...
        return _in_files(kind), Field(list(default) if isinstance(default, tuple) else default, description=text)

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        if self.only is None:
            form = handler.generate_schema(self.model)
        else:
            form = handler.generate_schema(get_type_hints(self.kind, include_extras=True)[self.only])
        if self.short is not None:
            form = core_schema.no_info_before_validator_function(self._spelled_out, form)
        return core_schema.no_info_after_validator_function(self.build, form)

    def _spelled_out(self, raw: object) -> object:
        assert self.short is not None
        if isinstance(raw, str):
            return {self._key(self.short): raw}
        if not isinstance(raw, Mapping):
            keys = [self._key(each.name) for each in self._fields]
            raise ValueError(f"expected a {self.short}'s name or a mapping with {' and '.join(keys)}, found {raw!r}")
        return raw

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        form, texts = handler(core), descriptions(self.kind)
        if self.only is not None:
            return {**form, "description": texts.get(self.only, "")}
        if self.short is not None:
            return {"anyOf": [{"type": "string", "description": texts.get(self.short, "")}, form]}
        return form


def one_of(names: bool = False, /, **entries: type | Entry) -> object:
    """What reads one of several dataclasses, each a mapping with one key: ``{key: {field: value, ...}}``.

    Args:
        names: whether a bare name may stand there, too, and is left as it is.
        **entries: the dataclass of each key, as an ``Entry`` where a file says it in its own way.
    """
    items = [_keyed(key, each if isinstance(each, Entry) else Entry(each)) for key, each in entries.items()]
    return _ReadAs(Annotated[_either([Annotated[str, Tag(NAME)]] * names + items), BY_KIND])


@dataclass(frozen=True)
class _ReadAs:
    """In an annotation: what is read from files otherwise than its type would be."""

    form: object

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return handler.generate_schema(self.form)


def _keyed(key: str, entry: Entry) -> object:
    """The mapping with one key around an entry."""
    name = f"{entry.kind.__name__}Entry"
    around = _mapping(name, summary(entry.kind), {key: (Annotated[entry.kind, entry], ...)})
    return Annotated[around, AfterValidator(attrgetter(key)), Tag(key)]


def _mapping(name: str, text: str, fields: Mapping[str, tuple[object, object]]) -> type[Strict]:
    settings: dict[str, Any] = dict(fields)  # types that are made up here are none to a checker
    return create_model(name, __base__=Strict, __doc__=text, **settings)


def _unlimited(each: dataclasses.Field[object]) -> bool:
    """Whether a field is infinite by default: files have no word for that but null."""
    return isinstance(each.default, float) and np.isinf(each.default)


def _in_files(kind: object) -> object:
    """A type as files have it: with lists for sequences, and without arrays."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return Annotated[_in_files(parts[0]), *parts[1:]]
    if origin in (Union, UnionType):
        return _either([_in_files(part) for part in parts if part is not np.ndarray])
    return GenericAlias(list, tuple(map(_in_files, parts))) if origin is Sequence else kind


def _either(kinds: Sequence[object]) -> object:
    return reduce(or_, kinds)


def summary(kind: type) -> str:
    """What a dataclass is: the first paragraph of its docstring."""
    return " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split())


def descriptions(kind: type) -> dict[str, str]:
    """What the fields of a dataclass are in words of a file, from the ``Args`` or ``Attributes`` of its docstring."""
    found: dict[str, str] = {}
    for section in re.findall(r"^(?:Args|Attributes):\n((?:    .*\n?|\n)*)", inspect.getdoc(kind) or "", re.MULTILINE):
        for names, text in re.findall(r"^    (\w+(?:, \w+)*): (.*\n?(?:     .*\n?)*)", section, re.MULTILINE):
            sentence = re.sub(r"\bNone\b", "null", " ".join(text.split()))
            found |= dict.fromkeys(names.split(", "), sentence[0].upper() + sentence[1:])
    return found
