"""Mappings of YAML files that refuse unknown keys, with a one-line message for the first error."""

from __future__ import annotations

import ast
import inspect
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, ClassVar, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, ValidationError, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError

from rnc_pin.errors import ConfigurationError, nearest, short_text

Numbers = Annotated[list[float], Field(min_length=1)]


LIST = "a list"
"""Tag of a list beside mappings with one key."""


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
    """Error at one key of a mapping, for validators of the whole mapping.

    Args:
        key: the key.
        message: its error, without the key.
    """
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


def summary(kind: type) -> str:
    """First paragraph of the docstring of a class."""
    return " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split())


@cache
def descriptions(kind: type) -> Mapping[str, str]:
    """Descriptions of the attributes of a class and of its bases.

    They are in ``Args`` or ``Attributes`` of a docstring, or below the attributes.
    """
    found: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        if not (is_dataclass(each) or issubclass(each, Strict)):
            continue  # of a library
        said = inspect.cleandoc(vars(each).get("__doc__") or "")
        for part in re.findall(r"^(?:Args|Attributes):\n((?:    .*\n?|\n)*)", said, re.MULTILINE):
            for names, text in re.findall(r"^    (\w+(?:, \w+)*): (.*\n?(?:     .*\n?)*)", part, re.MULTILINE):
                found |= dict.fromkeys(names.split(", "), text)
        source = _classes(each.__module__).get(each.__qualname__)
        found |= {
            attribute.target.id: text.value.value
            for attribute, text in pairwise(source.body if source else ())
            if isinstance(attribute, ast.AnnAssign) and isinstance(attribute.target, ast.Name)
            if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
        }
    return {name: _sentence(text) for name, text in found.items()}


def _sentence(text: str) -> str:
    text = re.sub(r"\bNone\b", "null", " ".join(text.split()))
    return text[0].upper() + text[1:]


class Strict(BaseModel):
    """Mapping with a fixed set of keys. It refuses an unknown key and suggests the nearest one.

    The docstring of the class, or of an attribute, describes its keys. It is read when it is asked for: pydantic's own
    ``use_attribute_docstrings`` reads all sources at every import, which takes longer than a short run.
    """

    described_by: ClassVar[type | None] = None
    """Another class whose docstring describes the keys that this one does not describe."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, raw: object) -> object:
        largest = 1e15  # products of a few numbers of a file stay finite
        if isinstance(raw, dict):
            for key, value in raw.items():
                if key not in cls.model_fields:
                    raise ValueError(f"'{key}' is not known{_hint(cls, str(key))}")
                has_boolean = any(isinstance(each, bool) for each in (value if isinstance(value, list) else [value]))
                if has_boolean and not _takes(bool, cls.model_fields[key].annotation):
                    raise ValueError(f"'{key}' takes no boolean, found {value!r}")
                if _largest(value) > largest:
                    raise ValueError(f"'{key}' has {_largest(value):g}, largest magnitude is {largest:g}")
        return raw

    def values_of(self, *names: str) -> dict[str, Any]:
        """Values of these keys by name, for a call that takes parameters of these names."""
        return {name: getattr(self, name) for name in names}

    @classmethod
    def key_descriptions(cls) -> dict[str, str]:
        """Description of each key, from its field or from the docstring of the attribute."""
        texts = {**descriptions(cls.described_by or cls), **descriptions(cls)}
        texts |= {name: field.description for name, field in cls.model_fields.items() if field.description is not None}
        return {name: texts[name] for name in cls.model_fields if name in texts}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        form = handler(core)
        whole = handler.resolve_ref_schema(form)
        if "description" in whole:
            whole["description"] = summary(cls)
        for name, text in cls.key_descriptions().items():
            whole["properties"][name]["description"] = text
        return form


_Model = TypeVar("_Model", bound=BaseModel)


def _no_tag(part: str, previous: object) -> bool:
    return part in ("float", "str", "int")


def validated(model: type[_Model], raw: object, source: str, is_tag: Callable[[str, object], bool] = _no_tag) -> _Model:
    """Validate the mapping of a file, or of a part of it.

    Args:
        model: class of the mapping.
        raw: the mapping.
        source: file or part, for messages.
        is_tag: function that returns True for a part of a location that is no key, such as a member of a union; its
            arguments are the part and the one before it.

    Raises:
        ConfigurationError: one line for the first error: file, key, expected value and found value.
    """
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        # One error at a time: later errors of pydantic are often consequences of the first, e.g. other members of a
        # union.
        first = error.errors(include_url=False)[0]
        raise ConfigurationError(f"{source}: {_explain(first, is_tag).removeprefix(f'{_WHOLE}: ')}") from None


def _explain(error: ErrorDetails, is_tag: Callable[[str, object], bool]) -> str:
    where = _path(error["loc"], is_tag)
    kind, context = error["type"], error.get("ctx", {})
    if kind == "wrong_key":
        return f"{where}.{context['key']}: {context['message']}"
    if kind == "union_tag_not_found":
        return f"{where}.type: is missing"
    if kind == "union_tag_invalid" and context["discriminator"] == "'type'":
        types = " or ".join(str(context["expected_tags"]).rsplit(", ", 1))
        return f"{where}.type: expected {types}, found {short_text(error['input']['type'])}"
    if kind == "union_tag_invalid":
        expected = [each.strip(" '") for each in str(context["expected_tags"]).split(",")]
        words = ", ".join("a joint's name" if each == "name" else each for each in expected if each != LIST)
        of_list = f"{LIST} or " if LIST in expected else ""
        found = error["input"]
        if isinstance(found, dict) and len(found) == 1:
            return f"{where}: '{context['tag']}' is not known{nearest(context['tag'], expected)}"
        as_joint = f"; a joint is written {{joint: {found}}}" if isinstance(found, str) and "joint" in expected else ""
        return f"{where}: expected {of_list}a mapping with one key of {words}; found {short_text(found)}{as_joint}"
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        most = "at least" if kind == "too_short" else "at most"
        return f"{where}: expected {most} {bound} item{'s' * (bound != 1)}, found {short_text(error['input'])}"
    if kind == "missing":
        return f"{where}: is missing"
    if kind == "value_error":
        return f"{where}: {context['error']}"
    message = "expected a mapping" if kind in ("model_type", "model_attributes_type") else error["msg"]
    message = message.replace("Input should be", "expected").replace("a valid dictionary", "a mapping")
    return f"{where}: {message}, found {short_text(error['input'])}"


_WHOLE = "(top level)"  # place of an error of the whole file; it is not shown


def _path(location: Sequence[str | int], is_tag: Callable[[str, object], bool]) -> str:
    """Return a path such as ``outputs.reducing[0].joint`` from a location of pydantic, without tags of unions."""
    text = ""
    previous: str | int | None = None
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        # pydantic repeats the key of a mapping with one key as the tag of its union.
        elif part != previous and not is_tag(part, previous):
            text += f".{part}" if text else part
        previous = part
    return text or _WHOLE
