"""The notebook runs, and shows the motion and the plots inline."""

import re

import nbformat
from nbclient import NotebookClient

from places import ROOT

TOUR = ROOT / "examples" / "tour.ipynb"


def outputs(folder):
    notebook = nbformat.read(TOUR, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "the notebook is kept without outputs"
    client = NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": folder}})
    client.execute()
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def test_the_notebook_reaches_its_goal_and_shows_it(tmp_path):
    """The motion is inline, in a frame of its own, and so is the plot."""
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
