"""The notebook runs, and shows the motion and the plots inline."""

import re

import nbformat
from matplotlib import image
from nbclient import NotebookClient

from browsing import PATIENCE, opened, visit
from places import ROOT

TOUR = ROOT / "examples" / "tour.ipynb"


def outputs(folder):
    notebook = nbformat.read(TOUR, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "the notebook is kept without outputs"
    client = NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": folder}})
    client.execute()
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def test_the_notebook_reaches_its_goal_and_shows_it(tmp_path):
    """Runs once: the motion is inline and plays, as the notebook has it in a frame of its own, and so is the plot."""
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
    path = tmp_path / "outer.html"
    path.write_text(f"<!DOCTYPE html><html><body>{pages[0]}</body></html>", encoding="utf-8")
    with opened() as browser:
        page, problems = visit(browser, path.as_uri(), offline=True)
        moving = "window.ready === true && viewer.animator.time > 0.1"
        page.frames[1].wait_for_function(moving, timeout=1000 * PATIENCE)
        page.screenshot(path=tmp_path / "shot.png")
        shot = image.imread(tmp_path / "shot.png")[..., :3]
        assert (shot.mean(axis=-1) < 0.6).sum() > 500
        assert problems == []
