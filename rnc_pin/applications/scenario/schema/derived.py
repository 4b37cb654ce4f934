"""Readers of classes that a file describes by the parameters of their dataclass."""

from __future__ import annotations

import dataclasses
import math
import re
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field
from functools import cached_property, reduce
from operator import attrgetter, or_
from types import GenericAlias, UnionType

import numpy as np
import pydantic
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from rnc_pin.errors import RncError
from rnc_pin.io import LIST, Json, Numbers, Strict, descriptions, summary

if typing.TYPE_CHECKING:
    Content = Json
else:
    Content = object  # pydantic resolves no recursive alias


def _file_name(name: str) -> str:
    # No dot and no slash: the name of a plot of a stranger's scenario stays in the output folder.
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise ValueError(f"'{name}' cannot name a file: use letters, digits, - and _")
    return name


FileName = typing.Annotated[str, pydantic.AfterValidator(_file_name)]

T = typing.TypeVar("T")


def checked(build: Callable[[], T]) -> T:
    """Return what a function builds. A validator calls it, so that an error has its place in the file.

    Args:
        build: function without arguments.

    Raises:
        ValueError: the function raised an ``RncError``.
    """
    try:
        return build()
    except RncError as error:
        raise ValueError(str(error)) from None  # pydantic adds the place


_NAME, _OTHER = "name", "other"


def tag_of(raw: object) -> str:
    """Return the tag of an entry: its one key, ``LIST`` for a list, or that of a bare name.

    Args:
        raw: the entry as a file has it.
    """
    if isinstance(raw, dict) and len(raw) == 1:
        return str(next(iter(raw)))
    if isinstance(raw, list):
        return LIST
    return _NAME if isinstance(raw, str) else _OTHER


@dataclass(frozen=True, eq=False)  # hashable by identity: a union hashes its parts
class ClassReader:
    """Reader of a dataclass: ``Annotated[View, ClassReader(View)]`` validates a mapping of its fields to a ``View``.

    Attributes:
        kind: the dataclass.
        short: a field whose text in the file may replace the mapping.
        forms: field to its type in the file, where the two differ.
    """

    kind: type
    short: str | None = None
    forms: Mapping[str, object] = field(default_factory=dict)

    @cached_property
    def model(self) -> type[Strict]:
        """Pydantic model of the mapping in a file."""
        fields: dict[str, tuple[object, object]] = {}
        # A model beside the class: pydantic's own reading of dataclasses takes no arrays and no protocols.
        for each in (each for each in dataclasses.fields(self.kind) if each.init):
            form = _in_files(self.forms.get(each.name, self._types[each.name]))
            default = each.default if each.default_factory is MISSING else each.default_factory()
            if isinstance(default, float) and math.isinf(default):
                form, default = either([form, None]), None  # files write null for infinity
            default = list(default) if isinstance(default, tuple) else default  # as a file writes it
            fields[each.name] = form, ... if default is MISSING else default
        made = _mapping(self.kind.__name__, self.kind, fields)
        made.described_by = self.kind
        return made

    @cached_property
    def _types(self) -> dict[str, object]:
        return typing.get_type_hints(self.kind, include_extras=True)

    def _read(self, said: Strict) -> object:
        """Make the object. What a file leaves out, and null where it is no value, takes the default of the class."""
        # "Left out" is not "null": a class may have None as a value beside another default.
        given = {
            name: value
            for name, value in said
            if name in said.model_fields_set
            if value is not None or type(None) in typing.get_args(self._types[name])
        }
        return checked(lambda: self.kind(**given))

    def _spelled_out(self, raw: object) -> object:
        if isinstance(raw, str):
            return {self.short: raw}
        if not isinstance(raw, Mapping):
            keys = " and ".join(self.model.model_fields)
            raise ValueError(f"expected a {self.short}'s name or a mapping with {keys}, found {raw!r}")
        return raw

    def __get_pydantic_core_schema__(self, source: object, handler: pydantic.GetCoreSchemaHandler) -> CoreSchema:
        form = handler.generate_schema(self.model)
        if self.short is not None:
            form = core_schema.no_info_before_validator_function(self._spelled_out, form)
        return core_schema.no_info_after_validator_function(self._read, form)

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: pydantic.GetJsonSchemaHandler) -> JsonSchemaValue:
        form = handler(core)
        if self.short is not None:
            return {"anyOf": [{"type": "string", "description": descriptions(self.kind).get(self.short, "")}, form]}
        return form


def one_of(names: bool = False, /, **entries: type | ClassReader) -> object:
    """Return a reader of one of several classes, each a mapping with one key: ``{key: {field: value, ...}}``.

    Args:
        names: True to accept a bare name too; it is returned unchanged.
        **entries: the class of each key, or its reader where the file differs from the class. A mapping of a file is
            read as it is.
    """
    # The key chooses the class before anything is validated, so that a mistake has one message and not one a class.
    items = [_keyed(key, each if isinstance(each, ClassReader) else ClassReader(each)) for key, each in entries.items()]
    names_too = [typing.Annotated[str, pydantic.Tag(_NAME)]] * names
    return read_as(typing.Annotated[either(names_too + items), pydantic.Discriminator(tag_of)])


def read_as(form: object) -> object:
    """Return the annotation of a value that a file writes in another form than its type.

    Args:
        form: type of the value in the file.
    """
    return pydantic.GetPydanticSchema(lambda source, handler: handler.generate_schema(form))


def _keyed(key: str, entry: ClassReader) -> object:
    """Mapping with one key that contains an entry, or another mapping of a file."""
    content = entry.kind if issubclass(entry.kind, Strict) else typing.Annotated[object, entry]
    # Around each class a model with one field: the place of an error is then "constraints.0.momentum.joint".
    around = _mapping(f"{entry.kind.__name__}Entry", entry.kind, {key: (content, ...)})
    return typing.Annotated[around, pydantic.AfterValidator(attrgetter(key)), pydantic.Tag(key)]


def _mapping(name: str, kind: type, fields: Mapping[str, tuple[object, object]]) -> type[Strict]:
    made: Callable[..., type[Strict]] = pydantic.create_model  # its fields are types that no checker knows
    return made(name, __base__=Strict, __doc__=summary(kind), **fields)


def _in_files(kind: object) -> object:
    """Form of a type in files: lists in place of sequences and arrays."""
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return typing.Annotated[_in_files(parts[0]), *parts[1:]]
    if kind is np.ndarray:
        return Numbers
    if origin in (typing.Union, UnionType):
        # A sequence beside an array has the same numbers.
        lists = any(typing.get_origin(_bare(part)) is Sequence for part in parts)
        return either([_in_files(part) for part in parts if part is not np.ndarray or not lists])
    return GenericAlias(list, tuple(map(_in_files, parts))) if origin is Sequence else kind


def _bare(kind: object) -> object:
    return typing.get_args(kind)[0] if typing.get_origin(kind) is typing.Annotated else kind


def either(kinds: Sequence[object]) -> object:
    """Return the union of types.

    Args:
        kinds: the types.
    """
    return reduce(or_, kinds)
