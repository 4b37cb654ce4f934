"""Entries of scenario files, derived from the classes that they build."""

from __future__ import annotations

import dataclasses
import inspect
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
from pydantic.fields import FieldInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from rnc_pin.errors import RncError
from rnc_pin.io import Json, Numbers, Strict, attribute_texts

if typing.TYPE_CHECKING:
    Content = Json
else:
    Content = object  # pydantic resolves no recursive alias


def _file_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise ValueError(f"'{name}' cannot name a file: use letters, digits, - and _")
    return name


FileName = typing.Annotated[str, pydantic.AfterValidator(_file_name)]


NAME, _OTHER = "name", "other"


def _kind(raw: object) -> str:
    """Tag of an entry: its one key, or ``NAME`` for a bare name."""
    if isinstance(raw, dict) and len(raw) == 1:
        return str(next(iter(raw)))
    return NAME if isinstance(raw, str) else _OTHER


BY_KIND = pydantic.Discriminator(_kind)


T = typing.TypeVar("T", covariant=True)


class EntryParameter(typing.NamedTuple):
    """Parameter of a class or function."""

    name: str
    kind: object
    default: object
    """Default value; ``MISSING`` for none."""

    @property
    def may_be_none(self) -> bool:
        """True if None is a value. Otherwise null in a file leaves the parameter out."""
        return self.kind is typing.Any or type(None) in typing.get_args(self.kind)

    @property
    def unlimited(self) -> bool:
        """True if the default is infinite. Files write null for it."""
        return isinstance(self.default, float) and math.isinf(self.default)


@dataclass(frozen=True)
class PartialCall(typing.Generic[T]):
    """Call of a class with the arguments that a file gives. A builder gives the others.

    Attributes:
        kind: the class.
        given: arguments of the file by name.
    """

    kind: Callable[..., T]
    given: Mapping[str, typing.Any]

    def build(self, **others: object) -> T:
        """Make the call. The arguments here go before those of the file."""
        return self.kind(**{**self.given, **others})


@dataclass(frozen=True, eq=False)  # hashable by identity: a union hashes its parts
class Entry(typing.Generic[T]):
    """Reader of a class from a file: ``Annotated[View, Entry(View)]`` validates to a ``View``.

    With ``late`` parameters or ``incomplete`` it validates to a ``PartialCall``. A mapping with further keys inherits
    from ``model`` and calls ``build``.

    Attributes:
        kind: dataclass, other class, or function.
        short: a parameter whose name in the file may replace the mapping.
        keys: parameter to key in the file, where the two differ.
        forms: parameter to its type in the file, where the two differ. ``Field(description=...)`` in the annotation
            replaces the text of the class.
        late: parameters that a builder gives, and no file.
        optional: parameters that may be null in a file, which is their default there. The builder then chooses.
        defaults: parameter to its default in the file, in the form of the file, where the class has another or none.
        incomplete: True if only a builder can make some arguments from their values in the file.
    """

    kind: Callable[..., T]
    short: str | None = None
    keys: Mapping[str, str] = field(default_factory=dict)
    forms: Mapping[str, object] = field(default_factory=dict)
    late: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    defaults: Mapping[str, object] = field(default_factory=dict)
    incomplete: bool = False

    def build(self, said: object, **others: object) -> T:
        """Call the class with the values of a file, which are attributes of ``said``, and with further arguments.

        Missing values take the defaults of the class.
        """
        return PartialCall(self.kind, self.given(said)).build(**others)

    def given(self, said: object) -> dict[str, object]:
        """Arguments that a file gives, by name."""
        assert isinstance(said, pydantic.BaseModel)
        found = {}
        for each in self.parameters:
            key = self.key(each.name)
            if key in said.model_fields_set or each.name in self.defaults:
                value = getattr(said, key)
                if value is not None or each.may_be_none:
                    found[each.name] = value
        return found

    def read(self, said: object) -> object:
        """Value of the entry: the built object, or a partial call of it.

        Raises:
            ValueError: the class refuses the values.
        """
        if self.late or self.incomplete:
            return PartialCall(self.kind, self.given(said))
        try:
            return self.build(said)
        except RncError as error:  # pydantic adds the place in the file
            raise ValueError(str(error)) from None

    @property
    def title(self) -> str:
        """Name of the class."""
        return self.kind.__name__

    @cached_property
    def parameters(self) -> list[EntryParameter]:
        """Parameters that a file gives."""
        return [each for each in _parameters(self.kind) if each.name not in self.late]

    def key(self, name: str) -> str:
        """Key in the file of a parameter."""
        return self.keys.get(name, name)

    @cached_property
    def model(self) -> type[Strict]:
        """Pydantic model of the mapping in a file."""
        fields = {self.key(each.name): self._field(each) for each in self.parameters}
        made = _mapping(self.title, summary(self.kind), fields)
        made.texts_of_class = self._texts
        return made

    def _texts(self) -> dict[str, str]:
        texts = descriptions(self.kind)
        return {self.key(each.name): texts[each.name] for each in self.parameters if each.name in texts}

    def _field(self, each: EntryParameter) -> tuple[object, object]:
        """Type and default of a field of the mapping."""
        kind = self.forms.get(each.name, each.kind)
        parts = typing.get_args(kind) if typing.get_origin(kind) is typing.Annotated else ()
        text = next((part.description for part in parts if isinstance(part, FieldInfo) and part.description), None)
        default = self.defaults.get(each.name, each.default)
        default = list(default) if isinstance(default, tuple) else default
        if each.unlimited or each.name in self.optional:
            kind, default = _either([kind, None]), None
        if default is MISSING:
            default = ...
        if each.name in self.defaults:
            return _in_files(kind), pydantic.Field(default, description=text, validate_default=True)
        return _in_files(kind), pydantic.Field(default, description=text)

    def __get_pydantic_core_schema__(self, source: object, handler: pydantic.GetCoreSchemaHandler) -> CoreSchema:
        form = handler.generate_schema(self.model)
        if self.short is not None:
            form = core_schema.no_info_before_validator_function(self._spelled_out, form)
        return core_schema.no_info_after_validator_function(self.read, form)

    def _spelled_out(self, raw: object) -> object:
        assert self.short is not None
        if isinstance(raw, str):
            return {self.key(self.short): raw}
        if not isinstance(raw, Mapping):
            keys = [self.key(each.name) for each in self.parameters]
            raise ValueError(f"expected a {self.short}'s name or a mapping with {' and '.join(keys)}, found {raw!r}")
        return raw

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: pydantic.GetJsonSchemaHandler) -> JsonSchemaValue:
        form, texts = handler(core), descriptions(self.kind)
        if self.short is not None:
            return {"anyOf": [{"type": "string", "description": texts.get(self.short, "")}, form]}
        return form


def part(kind: Callable[..., T], *names: str, **options: typing.Any) -> Entry[T]:
    """Return an entry of some parameters of a class. A builder gives the others.

    Args:
        kind: the class.
        *names: the parameters.
        **options: further attributes of the entry.
    """
    return Entry(kind, late=tuple(each.name for each in _parameters(kind) if each.name not in names), **options)


def _parameters(kind: Callable[..., object]) -> list[EntryParameter]:
    """Parameters of a class or function."""
    if dataclasses.is_dataclass(kind):
        types = typing.get_type_hints(kind, include_extras=True)
        found = [
            (each.name, each.default if each.default_factory is MISSING else each.default_factory())
            for each in dataclasses.fields(kind)
            if each.init
        ]
    else:
        call: object = vars(kind).get("__init__", kind) if isinstance(kind, type) else kind  # a named tuple has none
        types = typing.get_type_hints(call, include_extras=True)
        signature = inspect.signature(kind).parameters.values()
        found = [(each.name, MISSING if each.default is each.empty else each.default) for each in signature]
    return [EntryParameter(name, types[name], default) for name, default in found]


def one_of(names: bool = False, /, **entries: type | Entry[object]) -> object:
    """Return a reader of one of several classes, each a mapping with one key: ``{key: {field: value, ...}}``.

    Args:
        names: True to accept a bare name too; it is returned unchanged.
        **entries: the class of each key, or an ``Entry`` where the file differs from the class. A mapping of a file is
            read as it is.
    """
    items = [_keyed(key, each) for key, each in entries.items()]
    return ReadAs(typing.Annotated[_either([typing.Annotated[str, pydantic.Tag(NAME)]] * names + items), BY_KIND])


@dataclass(frozen=True, eq=False)
class ReadAs:
    """Annotation of a value that a file writes in another form than its type."""

    form: object

    def __get_pydantic_core_schema__(self, source: object, handler: pydantic.GetCoreSchemaHandler) -> CoreSchema:
        return handler.generate_schema(self.form)


def _keyed(key: str, kind: type | Entry[object]) -> object:
    """Mapping with one key that contains an entry, or another mapping of a file."""
    if isinstance(kind, type) and issubclass(kind, Strict):
        title, text, content = kind.__name__, summary(kind), typing.cast(object, kind)
    else:
        entry = kind if isinstance(kind, Entry) else Entry(kind)
        title, text, content = entry.title, summary(entry.kind), typing.Annotated[object, entry]
    around = _mapping(f"{title}Entry", text, {key: (content, ...)})
    return typing.Annotated[around, pydantic.AfterValidator(attrgetter(key)), pydantic.Tag(key)]


def _mapping(name: str, text: str, fields: Mapping[str, tuple[object, object]]) -> type[Strict]:
    settings: dict[str, typing.Any] = dict(fields)  # a type checker does not accept types made at run time
    return pydantic.create_model(name, __base__=Strict, __doc__=text, **settings)


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
        return _either([_in_files(part) for part in parts if part is not np.ndarray or not lists])
    return GenericAlias(list, tuple(map(_in_files, parts))) if origin is Sequence else kind


def _bare(kind: object) -> object:
    return typing.get_args(kind)[0] if typing.get_origin(kind) is typing.Annotated else kind


def _either(kinds: Sequence[object]) -> object:
    return reduce(or_, kinds)


def summary(kind: Callable[..., object]) -> str:
    """First paragraph of the docstring of a class."""
    return " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split())


def descriptions(kind: Callable[..., object]) -> dict[str, str]:
    """Descriptions of the parameters of a class or function.

    They are in ``Args`` or ``Attributes`` of its docstring, or below the fields of a dataclass, also of its bases.
    """
    family = [kind]
    if dataclasses.is_dataclass(kind):
        family = [each for each in reversed(inspect.getmro(typing.cast(type, kind))) if dataclasses.is_dataclass(each)]
    found: dict[str, str] = {}
    for each in family:
        for part in re.findall(r"^(?:Args|Attributes):\n((?:    .*\n?|\n)*)", inspect.getdoc(each) or "", re.MULTILINE):
            for names, text in re.findall(r"^    (\w+(?:, \w+)*): (.*\n?(?:     .*\n?)*)", part, re.MULTILINE):
                found |= dict.fromkeys(names.split(", "), text)
        if isinstance(each, type):
            found |= attribute_texts(each)
    return {name: _sentence(text) for name, text in found.items()}


def _sentence(text: str) -> str:
    text = re.sub(r"\bNone\b", "null", " ".join(text.split()))
    return text[0].upper() + text[1:]
