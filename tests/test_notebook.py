"""The notebook runs, and shows the motion and the plots inline."""

import re
from html import unescape
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from browsing import PATIENCE, opened, picture, visit

TOUR = Path(__file__).parent.parent / "examples" / "tour.ipynb"


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    notebook = nbformat.read(TOUR, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "the notebook is kept without outputs"
    client = NotebookClient(notebook, timeout=300, resources={"metadata": {"path": tmp_path_factory.mktemp("tour")}})
    client.execute()
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def test_the_notebook_reaches_its_goal(outputs):
    printed = "".join(output.get("text", "") for output in outputs if output.output_type == "stream")
    assert "12 degrees of freedom, 6 left by 6 constraints" in printed
    errors = [float(each) for each in re.findall(r"'([\d.]+e[-+]\d+)'", printed)]
    assert len(errors) == 6
    assert max(errors) < 0.005  # [rad], of a motion of 1.2


def test_the_plot_is_inline(outputs):
    assert any("image/png" in output.get("data", {}) for output in outputs)


def test_the_motion_is_inline_and_plays(outputs, tmp_path):
    pages = [output.data["text/html"] for output in outputs if "text/html" in output.get("data", {})]
    assert len(pages) == 1
    assert pages[0].startswith('<iframe srcdoc="')
    inner = unescape(re.search(r'srcdoc="([^"]*)"', pages[0]).group(1))
    path = tmp_path / "inner.html"
    path.write_text(inner, encoding="utf-8")
    with opened() as browser:
        page, problems = visit(browser, path.as_uri(), offline=True)
        page.wait_for_function("window.ready === true && viewer.animator.time > 0.1", timeout=1000 * PATIENCE)
        assert (picture(page).mean(axis=-1) < 0.6).sum() > 500
        page.context.close()
        # As the notebook has it, in a frame of its own.
        outer = tmp_path / "outer.html"
        outer.write_text(f"<!DOCTYPE html><html><body>{pages[0]}</body></html>", encoding="utf-8")
        page, more = visit(browser, outer.as_uri(), offline=True)
        page.frames[1].wait_for_function("window.ready === true", timeout=1000 * PATIENCE)
        page.screenshot(path=tmp_path / "shot.png")
        assert problems + more == []
