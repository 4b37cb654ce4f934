"""The documents are true: examples and Python blocks run, links lead somewhere, and the site fills the pages."""

import re
import runpy
import sys
import tomllib

import pytest
import yaml

import rnc_pin as rnc
from places import ROOT, docs_script, pages
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.schema.scenario import validate

ELSEWHERE = ("two_phases.py", "gymnasium_env.py")  # test_composite_controllers and test_tutorials run them
EXAMPLES = sorted(path for path in (ROOT / "examples").glob("*.py") if path.name not in ELSEWHERE)
DOCUMENTS = pages()
BLOCK = re.compile(r"^```python\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
FOLDERS = "benchmarks|docs|examples|rnc_pin|tests|tools"
FOLLOWED = ("tutorials", "explanation")  # folders whose pages test_tutorials follows, with their files and commands
WITH_BLOCKS = [path for path in DOCUMENTS if BLOCK.search(path.read_text()) and path.parent.name not in FOLLOWED]


def page_name(path):
    return path.relative_to(ROOT).as_posix()


@pytest.fixture
def half_a_second(monkeypatch):
    """Simulations that end after half a second; the built-in scenarios reach the same goals in test_built_in_runs."""
    simulate = rnc.simulate

    def cut_short(reduced, controller, q0, duration, *arguments, **options):
        return simulate(reduced, controller, q0, min(duration, 0.5), *arguments, **options)

    monkeypatch.setattr(rnc, "simulate", cut_short)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.name)
def test_example_runs(example, half_a_second, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(example)])
    runpy.run_path(str(example), run_name="__main__")
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("page", WITH_BLOCKS, ids=page_name)
def test_python_blocks_run(page, half_a_second, tmp_path, monkeypatch):
    """In one namespace, from top to bottom, as a reader runs them; a traceback has the line of the page."""
    monkeypatch.chdir(tmp_path)
    text, names = page.read_text(), {"__name__": "__main__"}
    for block in BLOCK.finditer(text):
        exec(compile("\n" * text.count("\n", 0, block.start(1)) + block[1], str(page), "exec"), names)


def test_every_python_block_is_found():
    fence = re.compile(r"(?:`{3,}|~{3,}|:{3,})\s*\{?(?:code.*)?python")
    for page in DOCUMENTS:
        assert len(BLOCK.findall(page.read_text())) == len(fence.findall(page.read_text())), page


def test_first_scenario_of_the_page_is_complete():
    first = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "scenarios.md").read_text(), flags=re.DOTALL)[0]
    assert validate(yaml.safe_load(first), "scenarios.md").simulation is not None


@pytest.mark.parametrize(("page", "part"), [
    ("errors", "* `no joint '…'"),
    ("gallery", "    rnc-pin run space-robot\n"),
    ("random_tasks", "| `space-robot-uncertain` | 200 |"),
    ("results", "## reduction\n"),
    ("scenarios", "### PlantSettings\n"),
    ("validation", "| Meijaard et al. 2007 |"),
    ("zoo", "| tiago_no_hand | rolling wheels |"),
])  # fmt: skip
def test_the_site_fills_the_page(page, part):
    written = (ROOT / "docs" / f"{page}.md").read_text()
    assert part not in written
    assert part in docs_script("generated").filled(written)


@pytest.mark.parametrize("document", DOCUMENTS, ids=page_name)
def test_links_lead_to_files(document):
    for target in re.findall(r"\]\(([^)#]+)\)", document.read_text()):
        if not target.startswith(("http:", "https:")):
            assert (document.parent / target).exists(), target
    for name in re.findall(rf"(?<![\w./-])(?:{FOLDERS})/[\w./-]*\w", document.read_text()):
        assert (ROOT / name).exists() or name == "docs/_scenes", name  # made from the recordings


@pytest.mark.parametrize(("page", "fault"), [
    ('<script src="https://cdn.example/x.js"></script>', "loads https://cdn.example/x.js"),
    ('<link rel="stylesheet" href="//cdn.example/x.css"/>', "loads //cdn.example/x.css"),
    ("<style>@font-face { src: url('https://cdn.example/f.woff') }</style>", "loads https://cdn.example/f.woff"),
    ('<p style="background: url(http://cdn.example/p.png)">', "loads http://cdn.example/p.png"),
    ('<iframe src="scenes/missing.html"></iframe>', "has no file scenes/missing.html"),
])  # fmt: skip
def test_loads_from_other_hosts_and_missing_files_are_found(page, fault, tmp_path):
    assert list(docs_script("check_site").faults_of_page(page, tmp_path)) == [fault]


def test_pages_for_maintainers_have_the_layers_and_paths_of_the_code():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    lines = [line.split(" | ") for contract in contracts for line in contract.get("layers", ())]
    layers = [sorted(room.rpartition(".")[2] for room in line) for line in lines]
    layers = [layer for layer in layers if not {"applications", "lab", "motion"} & {*layer}]
    table = (ROOT / "CONTRIBUTING.md").read_text().partition("## Four wings")[2].partition("## Commands")[0]
    rows = [re.findall(r"`(\w+)`", row.split("|")[2]) for row in re.findall(r"^\| .*`.*", table, re.MULTILINE)]
    assert sorted(sorted(row) for row in rows) == sorted(layers)
    paths = re.findall(r"`((?:rnc_pin|tests|docs)/[\w./]+)`", (ROOT / "docs" / "maintainers.md").read_text())
    assert len(paths) > 20
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_the_gallery_has_every_scenario():
    assert list(docs_script("gallery_page").facts()) == built_in_names(), "docs/make_pictures.py gallery NAME"
