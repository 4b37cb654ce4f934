"""The JSON Schema that editors read: told in words, and of one mind with the models."""

import json
import sys

import pytest

from rnc_pin.applications.command_line.cli import main
from rnc_pin.applications.scenario.files import built_in_names, find_scenario, read_yaml
from rnc_pin.applications.scenario.schema.scenario import schema

WRITTEN = schema()
jsonschema = pytest.importorskip("jsonschema", reason="reads schemas; comes with the test extra")


def test_rnc_pin_prints_it(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["rnc-pin", "schema"])
    with pytest.raises(SystemExit) as end:
        main()
    assert (end.value.code, json.loads(capsys.readouterr().out)) == (0, WRITTEN)


def test_it_is_a_schema_and_accepts_every_built_in_scenario():
    checker = jsonschema.Draft202012Validator
    checker.check_schema(WRITTEN)
    whole = checker(WRITTEN)
    for name in built_in_names():
        whole.validate(read_yaml(find_scenario(name)))


def test_every_part_is_described():
    content = WRITTEN
    for name, part in content["$defs"].items():
        assert part.get("description") or name.startswith("_") or name.endswith("Arguments"), name
    undescribed = [
        f"{name}.{key}"
        for name, part in {**content["$defs"], "Scenario": content}.items()
        if not name.endswith("Arguments") and len(part.get("properties", {})) > 1
        for key, value in part["properties"].items()
        if "description" not in value and "$ref" not in json.dumps(value)  # what is referred to says it
    ]
    assert undescribed == []
