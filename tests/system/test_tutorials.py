"""Tutorials and explanations run in their order, and so do the notebook and Gymnasium's environment."""

import re
import runpy
import shlex

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

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


def outputs(folder):
    notebook = nbformat.read(ROOT / "examples" / "tour.ipynb", as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "the notebook is kept without outputs"
    NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": folder}}).execute()
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def test_the_notebook_reaches_its_goal_and_shows_it(tmp_path):
    found = outputs(tmp_path)
    printed = "".join(output.get("text", "") for output in found if output.output_type == "stream")
    assert "12 degrees of freedom, 6 left by 6 constraints" in printed
    errors = [float(each) for each in re.findall(r"'([\d.]+e[-+]\d+)'", printed)]
    assert len(errors) == 6
    assert max(errors) < 0.005  # [rad], of a motion of 1.2
    assert any("image/png" in output.get("data", {}) for output in found)
    pages = [output.data["text/html"] for output in found if "text/html" in output.get("data", {})]
    assert len(pages) == 1
    assert pages[0].startswith('<iframe srcdoc="')


@pytest.fixture
def example():
    pytest.importorskip("gymnasium", reason="needs Gymnasium")
    return runpy.run_path(str(ROOT / "examples" / "gymnasium_env.py"))


@pytest.mark.filterwarnings("ignore:.*alternative render modes.*:UserWarning")
def test_gymnasium_accepts_the_environment(example):
    from gymnasium.utils.env_checker import check_env

    check_env(example["ReachingEnv"]())


def test_seeds_repeat_episodes_and_a_policy_with_the_model_is_better_than_none(example):
    env = example["ReachingEnv"]()
    first, again, other = (env.reset(seed=seed)[0] for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert example["mean_return"](example["computed_torque"], 2) > 0.5 * example["mean_return"](example["no_input"], 2)
