"""Random tasks of the case studies that pass preflight: none diverges. docs/random_tasks.md has many of each."""

import pytest

from rnc_pin.applications.sweep.runs import ScenarioRuns, draws_of

# A path next to the edge of the region counts as well as one through its middle: the largest error is what matters.
LARGEST = {"space-robot": 0.02, "space-robot-uncertain": 0.02, "mobile-manipulator": 0.02, "fire-truck": 0.02}
# 200 of each stand in docs/random_tasks.md; here one, of the uncertain robot with drawn first estimates.
SAMPLE = {"space-robot": 17, "space-robot-uncertain": 4, "mobile-manipulator": 50, "fire-truck": 11}
COARSE = {"simulation.dt": 0.01}
QUICK = {"space-robot": {"simulation.dt": 0.005}, "space-robot-uncertain": {**COARSE, "simulation.duration": 10.0}}


def rows_of(scenario, options, runs):
    source = ScenarioRuns(scenario, options, draws_of(scenario, options))
    return [source.row(run) for run in runs]


@pytest.mark.parametrize(("scenario", "run"), SAMPLE.items())
def test_a_random_task_that_passes_preflight_is_done(scenario, run):
    (row,) = rows_of(scenario, QUICK.get(scenario, COARSE), [run])
    assert row["outcome"] == "completed", row["message"]
    errors = {key: value for key, value in row.items() if key.startswith("final_error.")}
    assert errors
    assert max(errors.values()) < LARGEST[scenario], errors


def test_a_task_that_does_not_pass_is_drawn_again():
    quick = {"reference.primary.minimum_jerk.duration": 1.5, "reference.vertical.minimum_jerk.duration": 1.5}
    sweep = {"sweep": {"reference.primary.minimum_jerk.to.0": [1.0, 5.0]}}
    rows = rows_of("space-robot", {**quick, **COARSE, **sweep, "simulation.duration": 2.0}, range(4))
    assert {row["outcome"] for row in rows} == {"completed"}
    assert sum(row["redrawn"] for row in rows) > 0
    kept = [row["reference.primary.minimum_jerk.to.0"] for row in rows]
    assert max(kept) < 3.0  # what could not be reached was drawn again
