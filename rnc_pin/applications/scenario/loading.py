"""Validation of scenario mappings, with a one-line message for the first error; and their JSON Schema, for editors."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from rnc_pin.applications.scenario.controllers import TYPES
from rnc_pin.applications.scenario.files import short_text
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.base import LIST, PLAIN
from rnc_pin.applications.scenario.schema.constraints import ConstraintItem
from rnc_pin.applications.scenario.schema.outputs import OutputItem
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.io import Json
from rnc_pin.model import ConstraintKind, OutputKind


def validate(raw: Mapping[str, Json], source: str) -> ScenarioFile:
    """Validate the mapping of a scenario.

    Raises:
        ConfigurationError: one line for the first error: file, key, expected value and found value.
    """
    return admitted(ScenarioFile, raw, source)


_Model = TypeVar("_Model", bound=BaseModel)


def admitted(model: type[_Model], raw: Mapping[str, Json], source: str) -> _Model:
    """Validate the mapping of a part of a scenario, like ``validate``."""
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ConfigurationError(f"{source}: {_explain(first).removeprefix(f'{_WHOLE}: ')}") from None


def constraint_of(entry: Mapping[str, Json] | str) -> ConstraintKind:
    """Constraint of one valid entry of ``constraints``."""
    return _constraint_validator().validate_python(entry)


def output_of(entry: Mapping[str, Json]) -> OutputKind:
    """Output of one valid entry of ``outputs``."""
    return _output_validator().validate_python(entry)


@cache  # building a validator takes 30 ms
def _constraint_validator() -> TypeAdapter[ConstraintKind]:
    return TypeAdapter(ConstraintItem)


@cache
def _output_validator() -> TypeAdapter[OutputKind]:
    return TypeAdapter(OutputItem)


def _explain(error: ErrorDetails) -> str:
    where = _path(error["loc"])
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
        as_joint = _as_joint(found, expected)
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


def _as_joint(found: object, expected: Sequence[str]) -> str:
    """Hint at the mapping of a joint, for a name where actuators have plain names and outputs do not."""
    return f"; a joint is written {{joint: {found}}}" if isinstance(found, str) and "joint" in expected else ""


_WHOLE = "(top level)"  # place of an error of the whole file; it is not shown
_UNION_MEMBERS = {"float", "str", "list[float]", "constrained-list", "name", "unknown_masses", "unknown_wheels"}
_UNION_MEMBERS |= {PLAIN, LIST}


def _path(location: Sequence[str | int]) -> str:
    """Return a path such as ``outputs.reducing[0].joint`` from a location of pydantic, without tags of unions."""
    text, previous = "", None
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        elif part != previous and part not in _UNION_MEMBERS and not (previous == "controller" and part in TYPES):
            text += f".{part}" if text else part
        previous = part
    return text or _WHOLE


def schema() -> dict[str, Json]:
    """Return the schema of the models that read scenario files."""
    content = ScenarioFile.model_json_schema()
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "rnc_pin scenario",
        **{key: value for key, value in content.items() if key != "title"},
    }


def schema_text() -> str:
    """Return the schema as text of the schema file."""
    return json.dumps(schema(), indent=2, ensure_ascii=False) + "\n"
