"""``rnc-pin init`` on a terminal and elsewhere."""

import sys

import pytest


@pytest.mark.parametrize("terminal", [True, False])
def test_what_is_tried_is_told_on_a_terminal(terminal, call, brief, tmp_path, monkeypatch):
    """A draft can take many seconds; a program that reads its output gets the results alone."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    status, out, complaint = call("init", "car.urdf")
    assert (status, out.splitlines()) == (
        0,
        ["wrote car.yaml: read it, then try: rnc-pin inspect car.yaml; rnc-pin run car.yaml"],
    )
    tried = [line for line in complaint.splitlines() if line.startswith("car.urdf: trying base planar: ")]
    assert len(tried) == terminal
    assert all(line.endswith("; adaptive, dt 0.002 s ...") for line in tried)
