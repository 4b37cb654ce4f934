"""Every built-in scenario, whole: it ends within 0.02 of every goal, and keeps its invariants."""

import pytest

from rnc_pin.scenario.files import built_in_names
from rnc_pin.scenario.run import execute, plan

PAPER = (
    "space-robot",
    "space-robot-fixed-platform",
    "space-robot-uncertain",
    "mobile-manipulator",
    "mobile-manipulator-two-phase",
    "fire-truck",
)


def summary_of(name, **options):
    result = execute(plan(name, {**options, "comparisons": {}, "plots": {}}))
    assert result.error is None
    assert result.summary["outcome"] == "completed"
    assert result.summary["constraint_residual_max"] < 1e-8
    return result.summary


@pytest.mark.parametrize("name", built_in_names())
def test_scaled_gains_end_within_two_hundredths_of_every_goal(name):
    summary = summary_of(name)
    assert summary["final_error"]
    assert max(summary["final_error"].values()) < 0.02, summary["final_error"]


@pytest.mark.parametrize("name", PAPER)
def test_the_papers_gains_run_every_scenario_of_the_paper(name):
    """Bounded, as the lemmas promise; how well they track is in docs/paper.md."""
    summary = summary_of(name, **{"controller.preset": "paper", "simulation.dt": 0.01})  # its loops are slow
    assert max(summary["max_error"].values()) < 3.0
