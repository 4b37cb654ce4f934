"""Tutorials and explanations can be followed: files are saved, commands and Python blocks run in their order."""

import shlex

import pytest

from places import ROOT, docs_script

tutorials = docs_script("make_tutorial_pictures")
TUTORIALS = [page for page in sorted(tutorials.PAGES.glob("*.md")) if page.name != "index.md"]
EXPLANATIONS = sorted((ROOT / "docs" / "explanation").glob("*.md"))


@pytest.mark.parametrize("page", [*TUTORIALS, *EXPLANATIONS], ids=lambda page: page.name)
def test_page_can_be_followed(page, call, no_pictures, brief, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def command(line):
        status, _, complaint = call(*shlex.split(line)[1:])
        assert status == tutorials.expected_status(line), complaint

    tutorials.follow(page, tmp_path, command)
    written = {path.name for path in tmp_path.rglob("*.png")}
    missing = set(tutorials.pictures(page)) - written
    assert not missing or any("rnc-pin" in step.text for step in tutorials.steps(page))  # whose pictures are left out


def test_a_block_prints_what_its_page_says(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```python\nprint(1)\n```\n\n    2\n")
    with pytest.raises(ValueError, match="printed\n1\ninstead of\n2"):
        tutorials.follow(page, tmp_path, print)
