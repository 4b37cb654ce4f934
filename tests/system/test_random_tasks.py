"""Random tasks of the case studies that pass preflight: none diverges. docs/random_tasks.md has many of each."""

import pytest

from rnc_pin.applications.sweep.runs import ScenarioRuns, draws_of

# A path next to the edge of the region counts as well as one through its middle: the largest error is what matters.
LARGEST = {"space-robot": 0.02, "space-robot-uncertain": 0.02, "mobile-manipulator": 0.02, "fire-truck": 0.02}
# 200 of each stand in docs/random_tasks.md; here a few.
SAMPLE = {
    "space-robot": (17,),
    "space-robot-uncertain": (4,),  # first estimates are drawn as well
    "mobile-manipulator": (50,),
    "fire-truck": (11,),
}
COARSE, LESS_COARSE = {"simulation.dt": 0.01}, {"simulation.dt": 0.005}
QUICK = {
    "space-robot": LESS_COARSE,
    "mobile-manipulator": COARSE,
    "fire-truck": COARSE,
    "space-robot-uncertain": {**COARSE, "simulation.duration": 10.0},
}


def rows_of(scenario, options, runs):
    draws = draws_of(scenario, options)
    source = ScenarioRuns(scenario, options, draws)
    return [source.row(run) for run in runs]


@pytest.mark.parametrize(("scenario", "run"), [(name, run) for name, runs in SAMPLE.items() for run in runs])
def test_a_random_task_that_passes_preflight_is_done(scenario, run):
    (row,) = rows_of(scenario, QUICK.get(scenario, {}), [run])
    assert row["outcome"] == "completed", row["message"]
    errors = {key: value for key, value in row.items() if key.startswith("final_error.")}
    assert errors
    assert max(errors.values()) < LARGEST[scenario], errors


def test_a_task_that_does_not_pass_is_drawn_again():
    quick = {"reference.primary.minimum_jerk.duration": 1.5, "reference.vertical.minimum_jerk.duration": 1.5}
    ranges = {
        **quick,
        "sweep": {"reference.primary.minimum_jerk.to.0": [1.0, 5.0]},
        "simulation.duration": 2.0,
        **COARSE,
    }
    rows = rows_of("space-robot", ranges, range(4))
    assert {row["outcome"] for row in rows} == {"completed"}
    assert sum(row["redrawn"] for row in rows) > 0
    kept = [row["reference.primary.minimum_jerk.to.0"] for row in rows]
    assert max(kept) < 3.0  # what could not be reached was drawn again
