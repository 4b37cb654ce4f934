"""Base of all parts of a scenario file: mappings that refuse unknown keys, and entries identified by their one key."""

from __future__ import annotations

import ast
import inspect
import math
import re
import sys
from collections.abc import Callable, Mapping
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, ClassVar, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

from rnc_pin.errors import nearest
from rnc_pin.io import Json
from rnc_pin.model import Positive as Positive

_LARGEST = 1e15  # largest magnitude of a number in a scenario; products stay finite

Numbers = Annotated[list[float], Field(min_length=1)]
if TYPE_CHECKING:
    Content = Json
else:
    Content = object  # pydantic resolves no recursive alias


def _file_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise ValueError(f"'{name}' cannot name a file: use letters, digits, - and _")
    return name


FileName = Annotated[str, AfterValidator(_file_name)]


def _takes(kind: type, annotation: object) -> bool:
    """True if an annotation contains this type. Needed because pydantic reads true as the number 1."""
    return annotation in (kind, object) or any(_takes(kind, part) for part in get_args(annotation))


def _largest(value: object) -> float:
    """Largest magnitude of the numbers in a value and in its nested lists."""
    if isinstance(value, list):
        return max(map(_largest, value), default=0.0)
    if isinstance(value, int):  # integers have no size limit
        return float(min(abs(value), int(sys.float_info.max)))
    return abs(value) if isinstance(value, float) and math.isfinite(value) else 0.0


def wrong(key: str, message: str) -> PydanticCustomError:
    """Error at one key of a mapping, for validators of the whole mapping."""
    return PydanticCustomError("wrong_key", "{message}", {"key": key, "message": message})


def _hint(model: type[BaseModel], key: str) -> str:
    """Suggestion for an unknown key: the same key one level below, or the nearest key of this mapping."""
    below = [
        f"'{name}.{key}'"
        for name, field in model.model_fields.items()
        if get_origin(field.annotation) is not list  # whose entries have no name
        for each in (field.annotation, *get_args(field.annotation))
        if isinstance(each, type) and issubclass(each, BaseModel) and key in each.model_fields
    ]
    return f"; did you mean {' or '.join(below)}?" if below else nearest(key, model.model_fields)


@cache
def _classes(module: str) -> Mapping[str, ast.ClassDef]:
    """Classes at the top of a module's source, by name: ``inspect.getsource`` of a class would parse it each time."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError):
        return {}
    return {each.name: each for each in tree.body if isinstance(each, ast.ClassDef)}


@cache
def attribute_texts(kind: type) -> Mapping[str, str]:
    """Text below each annotated attribute in the source of a class; empty if the class has no source."""
    found = _classes(kind.__module__).get(kind.__qualname__)
    return {
        attribute.target.id: inspect.cleandoc(text.value.value)
        for attribute, text in pairwise(found.body if found else ())
        if isinstance(attribute, ast.AnnAssign) and isinstance(attribute.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }


class Strict(BaseModel):
    """Mapping with a fixed set of keys. It refuses an unknown key and suggests the nearest one.

    The docstring of an attribute describes its key. It is read from the source when it is asked for: pydantic's own
    ``use_attribute_docstrings`` reads all sources at every import, which takes longer than a short run.
    """

    texts_of_class: ClassVar[Callable[[], Mapping[str, str]] | None] = None
    """Function that returns the descriptions of keys that another class has."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, raw: object) -> object:
        if isinstance(raw, dict):
            for key, value in raw.items():
                if key not in cls.model_fields:
                    raise ValueError(f"'{key}' is not known{_hint(cls, str(key))}")
                values = value if isinstance(value, list) else [value]
                if any(isinstance(each, bool) for each in values) and not _takes(
                    bool, cls.model_fields[key].annotation
                ):
                    raise ValueError(f"'{key}' takes no boolean, found {value!r}")
                if _largest(value) > _LARGEST:
                    raise ValueError(f"'{key}' has {_largest(value):g}, largest magnitude is {_LARGEST:g}")
        return raw

    @classmethod
    def key_descriptions(cls) -> dict[str, str]:
        """Description of each key, from its field or from the docstring of the attribute."""
        kinds = [kind for kind in reversed(cls.__mro__) if issubclass(kind, Strict)]
        texts: dict[str, str] = {}
        for kind in kinds:
            of_class = vars(kind).get("texts_of_class")
            texts |= attribute_texts(kind) if of_class is None else of_class()
        texts |= {name: field.description for name, field in cls.model_fields.items() if field.description is not None}
        return {name: texts[name] for name in cls.model_fields if name in texts}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        form = handler(core)
        properties = handler.resolve_ref_schema(form)["properties"]
        for name, text in cls.key_descriptions().items():
            properties[name]["description"] = text
        return form


NAME, _OTHER = "name", "other"
PLAIN = "without a key"
"""Tag of a mapping of fields beside mappings with one key."""
LIST = "a list"
"""Tag of a list beside mappings with one key."""


def _kind(raw: object) -> str:
    """Tag of an entry: its one key, or ``NAME`` for a bare name."""
    if isinstance(raw, dict) and len(raw) == 1:
        return str(next(iter(raw)))
    return NAME if isinstance(raw, str) else _OTHER


BY_KIND = Discriminator(_kind)
