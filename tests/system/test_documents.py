"""The documents are true: examples and Python blocks run, links lead somewhere, generated tables are current."""

import importlib.util
import re
import runpy
import sys

import pytest
import yaml

import rnc_pin as rnc
from places import ROOT
from rnc_pin.scenario.loading import validate

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
AT_THE_TOP = ("README.md", "CONTRIBUTING.md", "SECURITY.md")
DOCUMENTS = [*(ROOT / name for name in AT_THE_TOP), *sorted((ROOT / "docs").glob("*.md"))]
BLOCKS = [
    pytest.param(block, id=f"{path.name}-{k}")
    for path in DOCUMENTS
    for k, block in enumerate(re.findall(r"```python\n(.*?)```", path.read_text(), flags=re.DOTALL))
]


@pytest.fixture
def brief(monkeypatch):
    """Simulations that end after half a second; the built-in scenarios reach the same goals in test_built_in_runs."""
    simulate = rnc.simulate

    def cut_short(reduced, controller, q0, duration, *arguments, **options):
        return simulate(reduced, controller, q0, min(duration, 0.5), *arguments, **options)

    monkeypatch.setattr(rnc, "simulate", cut_short)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.name)
def test_example_fits_on_a_screen(example):
    assert len(example.read_text().splitlines()) <= 60


@pytest.mark.parametrize(
    "example",
    [path for path in EXAMPLES if path.name != "two_phases.py"],  # tests/control/test_split.py runs it
    ids=lambda path: path.name,
)
def test_example_runs(example, brief, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(example)])
    runpy.run_path(str(example), run_name="__main__")
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("block", BLOCKS)
def test_python_block_runs(block, brief, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "block", "exec"), {"__name__": "__main__"})


def test_first_scenario_of_the_page_is_complete():
    text = (ROOT / "docs" / "scenarios.md").read_text()
    first = re.findall(r"```yaml\n(.*?)```", text, flags=re.DOTALL)[0]
    assert validate(yaml.safe_load(first), "scenarios.md").simulation is not None


def test_tables_of_scenario_keys_are_current():
    spec = importlib.util.spec_from_file_location("make_scenario_keys", ROOT / "docs" / "make_scenario_keys.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = module.PAGE.read_text()
    assert module.page(text) == text, "run python docs/make_scenario_keys.py"


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().split()) <= 800


def test_the_readme_has_the_two_commands():
    text = (ROOT / "README.md").read_text()
    assert "    pip install . && rnc-pin run space-robot\n" in text
    assert "    pip install '.[test]' && pytest\n" in text


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_to_files(document):
    for target in re.findall(r"\]\(([^)#]+)\)", document.read_text()):
        if not target.startswith(("http:", "https:")):
            assert (document.parent / target).exists(), target
