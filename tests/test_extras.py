"""Extras: messages and pages name those that exist, and a missing package is one line before anything is written."""

import re
import sys
import tomllib

import pytest

from places import ROOT
from rnc_pin import extras

DECLARED = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
FOLDERS = ("rnc_pin", "docs", "examples", "benchmarks", "tests")
NAMED = re.compile(r"\.\[([\w,-]+)\]['\"]|\bextras? (?:`{1,2}|')([\w-]+)(?:`|')")


def texts():
    files = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*")]
    for path in [*ROOT.glob("*.md"), ROOT / "pyproject.toml", *files]:
        if path.suffix in (".py", ".pyi", ".md", ".ipynb", ".yaml", ".json", ".toml") and path.is_file():
            yield path.relative_to(ROOT).as_posix(), path.read_text()


def test_every_extra_that_a_file_names_exists():
    named = {}
    for name, text in texts():
        for found in NAMED.finditer(text):
            for extra in (found[1] or found[2]).split(","):
                named.setdefault(extra, name)
    assert {"mujoco", "test", "docs", "robots"} <= named.keys()
    assert {extra: name for extra, name in named.items() if extra not in DECLARED} == {}


def test_all_has_the_extras_that_commands_ask_for_and_the_table_has_every_extra():
    assert DECLARED["all"] == [f"rnc_pin[{','.join(extras._PACKAGES)}]"]
    table = (ROOT / "docs" / "commands.md").read_text().partition("\n## Extras\n")[2].partition("\n## ")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} == DECLARED.keys()


@pytest.mark.parametrize("extra", extras._PACKAGES)
def test_a_message_names_an_extra_that_brings_the_package(extra):
    package = extras._PACKAGES[extra]
    assert package.module in {re.split(r"\W", requirement)[0] for requirement in DECLARED[extra]}
    command = extras.missing_extra(extra)
    assert command == f"{package.name} is not installed: pip install '.[{extra}]' in the folder of rnc_pin's source"


@pytest.mark.parametrize(("larger", "smaller"), [*(("test", each) for each in extras._PACKAGES), ("docs", "mujoco")])
def test_an_extra_that_needs_another_has_all_of_it(larger, smaller):
    assert set(DECLARED[smaller]) <= set(DECLARED[larger])


def test_a_sweep_on_a_cluster_without_dask_writes_nothing(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "distributed", None)
    status, _, error = call("sweep", "space-robot", "--runs", 2, "--scheduler", "tcp://localhost:1", "--out", "runs")
    assert status == 2
    assert error.endswith("--scheduler tcp://localhost:1: Dask is not installed: "
                          "pip install '.[dask]' in the folder of rnc_pin's source\n")  # fmt: skip
    assert list(tmp_path.iterdir()) == []
