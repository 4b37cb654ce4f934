"""Short version of the example that learns."""

import runpy
import sys

import pytest

from places import ROOT

pytest.importorskip("gymnasium", reason="needs the extra gym")


def test_a_policy_learns_within_a_few_generations(monkeypatch, capsys):
    """It is better on unseen episodes than no input and than the better of two random policies."""
    example = str(ROOT / "examples" / "learn_reaching.py")
    monkeypatch.setattr(sys, "argv", [example, "3", "12"])
    found = runpy.run_path(example, run_name="__main__")
    assert found["trained"] > max(found["at_rest"], found["random"])
    assert "unseen" in capsys.readouterr().out
