"""Seeded draws have the distributions of SciPy; a run of a scenario has the same bits on every path."""

from itertools import islice

import numpy as np
import pytest
from scipy import stats

import rnc_pin as rnc
from refusals import refused
from rnc_pin.applications.sweep.runs import ScenarioRuns, SeededDraws

QUICK = {"simulation.duration": 0.06, "simulation.dt": 0.01}
CASES = {
    "space-robot": {"initial.q.joint_2": [1.6, 2.0], "faults.masses": [0.0, 0.1], "faults.position_noise": [0, 1e-4]},
    "mobile-manipulator": {"initial.q.joint_1": [0.3, 0.7], "controller.preset": {"choice": ["scaled", "paper"]}},
    "unicycle": {"initial.v2": {"choice": [{}]}, "faults.delay": {"integers": [0, 2]}},
}


def runs(scenario):
    return ScenarioRuns(scenario, {"preflight": "warn", **QUICK, "seed": 2}, SeededDraws.of(CASES[scenario], seed=2))


@pytest.mark.parametrize("scenario", CASES)
def test_a_shared_model_does_not_change_a_run(scenario):
    together = runs(scenario)
    for run in range(3):
        here, there = together.row(run), runs(scenario).row(run)
        assert {**here, "wall_time": 0} == {**there, "wall_time": 0}
        assert here["outcome"] == "completed", here["message"]


def test_a_drawn_part_of_the_system_has_a_model_of_its_own():
    """Gains follow the inertia, so errors differ; the same runs in the other order agree."""
    draws = [{"robot.masses": {"link_2": mass}} for mass in (5.0, 20.0)]
    source = ScenarioRuns("space-robot", {**QUICK, "preflight": "warn"})
    forward = [source.row(run, draw)["rms_error.tip_x"] for run, draw in enumerate(draws)]
    other = ScenarioRuns("space-robot", {**QUICK, "preflight": "warn"})
    assert forward == [other.row(run, draws[run])["rms_error.tip_x"] for run in (1, 0)][::-1]
    assert forward[0] != forward[1]


def test_seeds_of_runs_with_faults_differ_and_others_have_that_of_the_scenario():
    with_faults, without = runs("space-robot"), ScenarioRuns("space-robot", {"seed": 5})
    seeds = [with_faults.options_of(run, {"faults.masses": 0.1})["seed"] for run in range(50)]
    assert (len(set(seeds)), with_faults.options_of(3, {"faults.masses": 0.1})["seed"]) == (50, seeds[3])
    assert without.options_of(3, {"initial.q.joint_2": 1.7})["seed"] == 5
    assert with_faults.options_of(3, {"faults.masses": 0.1, "seed": 9})["seed"] == 9


LAWS = {
    "range": ([1.0, 3.0], stats.uniform(1.0, 2.0)),
    "normal": ({"normal": {"mean": 2.0, "std": 0.5}}, stats.norm(2.0, 0.5)),
    "log": ({"log_uniform": [1e-4, 1e2]}, stats.loguniform(1e-4, 1e2)),
}  # fmt: skip


@pytest.mark.parametrize(("settings", "law"), LAWS.values(), ids=LAWS)
def test_numbers_follow_their_distribution(settings, law):
    draws = SeededDraws.of({"x": settings}, seed=3)
    values = [each["x"] for each in islice(draws.of_run(0), 2000)]
    assert stats.kstest(values, law.cdf).pvalue > 0.01  # of a fixed seed


def test_integers_and_choices_are_equally_probable():
    draws = SeededDraws.of({"n": {"integers": [-1, 2]}, "word": {"choice": ["a", {"b": [1]}]}})
    found = list(islice(draws.of_run(0), 2000))
    counts = [sum(each["n"] == n for each in found) for n in range(-1, 3)]
    assert sum(counts) == 2000
    assert stats.chisquare(counts).pvalue > 0.01
    assert stats.binomtest(sum(each["word"] == "a" for each in found), 2000).pvalue > 0.01
    assert {str(each["word"]) for each in found} == {"a", "{'b': [1]}"}


def test_each_run_has_a_stream_of_its_own():
    draws = SeededDraws.of({"x": [0, 1]}, seed=1)
    values = [next(draws.of_run(run))["x"] for run in range(100)]
    assert (len(set(values)), next(draws.of_run(7))["x"]) == (100, values[7])
    assert values[0] == np.random.default_rng([1, 0]).uniform()


test_wrong_distributions_are_refused = refused([
    ([2, 1], "x: minimum 2 is greater than maximum 1"), ({"log_uniform": [0, 1]}, "greater than 0, found 0"),
    ({"nrmal": {"mean": 0}}, "did you mean 'normal'?"), ("x", "expected a list or a mapping with one key of normal"),
    ({"normal": {"mean": 0, "std": 0}}, "greater than 0"), ({"choice": []}, "at least 1 item"),
], lambda settings: SeededDraws.of({"x": settings}), rnc.ConfigurationError)  # fmt: skip
