"""A run, its comparisons and its pictures, one after the other."""

import signal

import pytest

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.pictures import draw_pictures, picture_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.simulation import Outcome

QUICK = {"simulation.duration": 0.1}


def test_comparisons_follow_the_run_and_their_progress_adds_up():
    shown = []
    prepared = Scenario.load("space-robot", QUICK).build()
    result = execute(prepared, progress=lambda done, name: shown.append((done, name)))
    (label,) = result.comparisons
    assert (result.summary["comparisons"].keys(), shown) == ({label}, sorted(shown, key=lambda each: each[0]))
    assert [name for _, name in (shown[0], shown[-1])] == ["space-robot", f"space-robot: {label}"]
    assert shown[-1][0] == pytest.approx(prepared.total_duration)


def test_no_comparison_follows_one_that_is_interrupted():
    comparisons = {name: {"controller.type": "reducing_outputs"} for name in ("first", "second")}
    prepared = Scenario.load("space-robot", {**QUICK, "comparisons": comparisons}).build()

    def interrupt(done, name):
        if name.endswith("first") and done > 0.15:
            signal.raise_signal(signal.SIGINT)

    result = execute(prepared, progress=interrupt)
    assert result.interrupted
    assert list(result.comparisons) == ["first"]
    assert result.comparisons["first"].outcome is Outcome.INTERRUPTED


def test_pictures_are_those_that_are_promised(tmp_path):
    prepared = Scenario.load("space-robot", {**QUICK, "plots": {}, "comparisons": {}}).build()
    drawn = draw_pictures(prepared, execute(prepared), tmp_path)
    assert drawn.written == [name for name in picture_names(prepared) if name in drawn.written]
    assert {path.name for path in tmp_path.iterdir()} == set(drawn.written) >= {"overview.png", "animation.html"}
    assert not drawn.failures
