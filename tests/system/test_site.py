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


def test_the_maintainers_page_has_the_layers_and_paths_of_the_code():
    text = (ROOT / "docs" / "maintainers.md").read_text()
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = [line.replace("rnc_pin.", "").split(" | ") for line in contracts[0]["layers"]]
    table = text.partition("## Layers")[2].partition("## Path")[0]
    assert [re.findall(r"`(\w+)`", row.split("|")[1]) for row in re.findall(r"^\| `.*", table, re.MULTILINE)] == layers
    paths = re.findall(r"`((?:rnc_pin|tests|docs)/[\w./]+)`", text)
    assert len(paths) > 20
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_the_gallery_has_every_scenario():
    assert list(docs_script("gallery_page").facts()) == built_in_names(), "docs/make_pictures.py gallery NAME"
