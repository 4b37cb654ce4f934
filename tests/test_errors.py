"""Errors are one line with a place, and keep their data."""

import pickle
import re
import sys
import tomllib

import numpy as np
import pytest

import rnc_pin as rnc
from places import ROOT
from rnc_pin import errors

SINGULAR = rnc.SingularityError("no inverse", q=np.array([0.5]), condition=1e12, rows=["x"], time=0.25)


@pytest.mark.parametrize(("error", "words"), [
    (rnc.ModelError("no joint 'a'"), "controller: run 3: no joint 'a'"),
    (rnc.InputError("q has shape (3,)"), "controller: run 3: q has shape (3,)"),
    (rnc.DivergenceError("|v| > 5", time=0.25), "diverged at t = 0.250 s: controller: run 3: |v| > 5"),
    (SINGULAR, "controller: run 3: no inverse at t = 0.250 s: rows x are dependent (condition 1e+12) at q = [0.5]"),
], ids=lambda value: type(value).__name__)  # fmt: skip
def test_a_place_is_prepended_and_the_data_stay(error, words):
    error.trajectory = "the run so far"
    assert error.within("run 3").within("controller") is error
    assert str(error) == str(pickle.loads(pickle.dumps(error))) == words
    assert error.trajectory == "the run so far"
    if error is SINGULAR:
        assert (error.rows, error.time) == (("x",), 0.25)


def test_arguments_are_said_as_python_and_as_scenario_files_take_them():
    assert rnc.errors.argument("base", "free") == "base='free' (robot: {base: free})"
    assert rnc.errors.argument("snap", False) == "snap=False (robot: {snap: false})"
    assert rnc.errors.argument("masses", {"a": 0.1}) == "masses={'a': 0.1} (robot: {masses: {a: 0.1}})"
    robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
    with pytest.raises(rnc.ModelError, match=r"load it with base='fixed' \(robot: \{base: fixed\}\) to mount it"):
        robot.attach(robot, "axle")


# ---------------------------------------------------------------------- extras


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
    assert DECLARED["all"] == [f"rnc_pin[{','.join(errors._PACKAGES)}]"]
    table = (ROOT / "docs" / "commands.md").read_text().partition("\n## Extras\n")[2].partition("\n## ")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} == DECLARED.keys()


@pytest.mark.parametrize("extra", errors._PACKAGES)
def test_a_message_names_an_extra_that_brings_the_package(extra):
    name, module = errors._PACKAGES[extra]
    assert module in {re.split(r"\W", requirement)[0] for requirement in DECLARED[extra]}
    command = errors.missing_extra(extra)
    assert command == f"{name} is not installed: pip install '.[{extra}]' in the folder of rnc_pin's source"


@pytest.mark.parametrize(("larger", "smaller"), [*(("test", each) for each in errors._PACKAGES), ("docs", "mujoco")])
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
