"""Parts of the documentation site; ``.ci/run`` builds all of it, and checks that it loads nothing from other hosts."""

import re
import tomllib

import pytest

from places import ROOT, docs_script
from rnc_pin.applications.scenario.files import built_in_names


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
