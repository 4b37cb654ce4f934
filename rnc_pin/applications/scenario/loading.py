"""Validation of scenario mappings, with a one-line message for the first error; and their JSON Schema, for editors."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from typing import TypeVar

from pydantic import BaseModel, TypeAdapter

from rnc_pin.applications.scenario.controllers import TYPES
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.base import LIST, PLAIN
from rnc_pin.applications.scenario.schema.kinds import ConstraintItem, OutputItem
from rnc_pin.io import Json, validated
from rnc_pin.model import ConstraintKind, OutputKind


def validate(raw: Mapping[str, Json], source: str) -> ScenarioFile:
    """Validate the mapping of a scenario.

    Raises:
        ConfigurationError: one line for the first error: file, key, expected value and found value.
    """
    return admitted(ScenarioFile, raw, source)


_UNION_MEMBERS = {"float", "str", "list[float]", "constrained-list", "name", "unknown_masses", "unknown_wheels"}
_UNION_MEMBERS |= {PLAIN, LIST}


def _is_tag(part: str, previous: object) -> bool:
    return part in _UNION_MEMBERS or (previous == "controller" and part in TYPES)


_Model = TypeVar("_Model", bound=BaseModel)


def admitted(model: type[_Model], raw: Mapping[str, Json], source: str) -> _Model:
    """Validate the mapping of a part of a scenario, like ``validate``."""
    return validated(model, raw, source, _is_tag)


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
