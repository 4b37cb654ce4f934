"""Entries of a scenario file, derived from the dataclasses that they build.

The dataclass alone defines names, types, defaults and descriptions; its docstring gives the descriptions. An ``Entry``
lists the differences between the file and the dataclass.
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
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    create_model,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from rnc_pin.errors import RncError, nearest
from rnc_pin.scenario.schema.base import BY_KIND, NAME, PLAIN, Strict


@dataclass(frozen=True, eq=False)  # hashable by identity: a union hashes its parts
class Entry:
    """Reader of a dataclass from a file: ``Annotated[View, Entry(View)]`` validates to a ``View``.

    Attributes:
        kind: the dataclass.
        short: a field whose value may replace the mapping.
        only: a field whose value always replaces the mapping.
        keys: field name to key in the file, where the two differ.
        required: fields that a file must give although the dataclass has a default.
        forms: field name to its type in the file, where the two differ.
    """

    kind: type
    short: str | None = None
    only: str | None = None
    keys: Mapping[str, str] = field(default_factory=dict)
    required: tuple[str, ...] = ()
    forms: Mapping[str, object] = field(default_factory=dict)

    def build(self, said: object) -> object:
        """Build the dataclass from the values of a file. Missing values take the defaults of the dataclass."""
        try:
            return self.kind(**self._given(said))
        except RncError as error:  # pydantic adds the place in the file
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
        """Pydantic model of the mapping in a file."""
        types, texts = {**get_type_hints(self.kind, include_extras=True), **self.forms}, descriptions(self.kind)
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
    """Return a reader of one of several dataclasses, each a mapping with one key: ``{key: {field: value, ...}}``.

    Args:
        names: True to accept a bare name too; it is returned unchanged.
        **entries: the dataclass of each key, or an ``Entry`` where the file differs from the dataclass.
    """
    items = [_keyed(key, _entry(each)) for key, each in entries.items()]
    return _ReadAs(Annotated[_either([Annotated[str, Tag(NAME)]] * names + items), BY_KIND])


def plain_or(plain: type, /, **entries: type | Entry) -> object:
    """Return a reader of a dataclass ``{field: value, ...}``, or of another one as a mapping with its key."""

    def tag(raw: object) -> str:
        key = next(iter(raw)) if isinstance(raw, Mapping) and len(raw) == 1 else None
        return key if key in entries else PLAIN

    def known(raw: object) -> object:
        names = [*Entry(plain).model.model_fields, *entries]  # the reader of one kind does not know the other kinds
        mapping = raw if isinstance(raw, Mapping) else {}
        for key in mapping:
            if key in entries and len(mapping) > 1:
                raise ValueError(f"'{key}' has no other key beside it, found {', '.join(map(str, mapping))}")
            if key not in names:
                raise ValueError(f"'{key}' is not known{nearest(str(key), names)}")
        return raw

    items = [Annotated[plain, Entry(plain), Tag(PLAIN)], *(_keyed(key, _entry(each)) for key, each in entries.items())]
    return _ReadAs(Annotated[_either(items), Discriminator(tag), BeforeValidator(known)])


@dataclass(frozen=True)
class _ReadAs:
    """Annotation of a value that a file writes in another form than its type."""

    form: object

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return handler.generate_schema(self.form)


def _entry(kind: type | Entry) -> Entry:
    return kind if isinstance(kind, Entry) else Entry(kind)


def _keyed(key: str, entry: Entry) -> object:
    """Mapping with one key that contains an entry."""
    name = f"{entry.kind.__name__}Entry"
    around = _mapping(name, summary(entry.kind), {key: (Annotated[entry.kind, entry], ...)})
    return Annotated[around, AfterValidator(attrgetter(key)), Tag(key)]


def _mapping(name: str, text: str, fields: Mapping[str, tuple[object, object]]) -> type[Strict]:
    settings: dict[str, Any] = dict(fields)  # a type checker does not accept types made at run time
    return create_model(name, __base__=Strict, __doc__=text, **settings)


def _unlimited(each: dataclasses.Field[object]) -> bool:
    """True if the default of a field is infinite. Files write null for it."""
    return isinstance(each.default, float) and np.isinf(each.default)


def _in_files(kind: object) -> object:
    """Form of a type in files: lists in place of sequences, and no arrays."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return Annotated[_in_files(parts[0]), *parts[1:]]
    if origin in (Union, UnionType):
        return _either([_in_files(part) for part in parts if part is not np.ndarray])
    return GenericAlias(list, tuple(map(_in_files, parts))) if origin is Sequence else kind


def _either(kinds: Sequence[object]) -> object:
    return reduce(or_, kinds)


def summary(kind: type) -> str:
    """First paragraph of the docstring of a dataclass."""
    return " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split())


def descriptions(kind: type) -> dict[str, str]:
    """Descriptions of the fields of a dataclass, from ``Args`` or ``Attributes`` of its docstring and its bases'."""
    found: dict[str, str] = {}
    own = [inspect.getdoc(each) or "" for each in reversed(kind.__mro__) if dataclasses.is_dataclass(each)]
    for section in re.findall(r"^(?:Args|Attributes):\n((?:    .*\n?|\n)*)", "\n\n".join(own), re.MULTILINE):
        for names, text in re.findall(r"^    (\w+(?:, \w+)*): (.*\n?(?:     .*\n?)*)", section, re.MULTILINE):
            sentence = re.sub(r"\bNone\b", "null", " ".join(text.split()))
            found |= dict.fromkeys(names.split(", "), sentence[0].upper() + sentence[1:])
    return found
