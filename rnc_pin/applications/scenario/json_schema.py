"""JSON Schema of scenario files, for editors."""

from __future__ import annotations

import json

from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.io import Json


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
