"""Seeded draws have the distributions of SciPy, and one stream for each run."""

from itertools import islice

import numpy as np
import pytest
from scipy import stats

import rnc_pin as rnc
from rnc_pin.applications.sweep.seeded_draws import SeededDraws

LAWS = {
    "range": ([1.0, 3.0], stats.uniform(1.0, 2.0)),
    "uniform": ({"uniform": [-1.0, 1.0]}, stats.uniform(-1.0, 2.0)),
    "normal": ({"normal": {"mean": 2.0, "std": 0.5}}, stats.norm(2.0, 0.5)),
    "bounded": (
        {"normal": {"mean": 0.0, "std": 2.0, "min": -1.0, "max": 5.0}}, stats.truncnorm(-0.5, 2.5, scale=2.0)
    ),
    "tail": ({"normal": {"mean": 1.0, "std": 1.0, "min": 6.5}}, stats.truncnorm(5.5, np.inf, loc=1.0)),
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
    words = sum(each["word"] == "a" for each in found)
    assert stats.binomtest(words, 2000).pvalue > 0.01
    assert {str(each["word"]) for each in found} == {"a", "{'b': [1]}"}


def test_each_run_has_a_stream_of_its_own():
    draws = SeededDraws.of({"x": [0, 1]}, seed=1)
    values = [next(draws.of_run(run))["x"] for run in range(100)]
    assert len(set(values)) == 100
    assert next(draws.of_run(7))["x"] == values[7]
    assert values[0] == np.random.default_rng([1, 0]).uniform()


REFUSED = {
    "reversed": ([2, 1], "x: minimum 2 is greater than maximum 1"),
    "log of zero": ({"log_uniform": [0, 1]}, "greater than 0, found 0"),
    "far tail": ({"normal": {"mean": 0, "std": 1, "min": 9}}, "farther than 6 standard deviations"),
    "misspelt": ({"nrmal": {"mean": 0}}, "did you mean 'normal'?"),
    "text": ("x", "expected a list or a mapping with one key of uniform"),
    "no deviation": ({"normal": {"mean": 0, "std": 0}}, "greater than 0"),
    "nothing to choose": ({"choice": []}, "at least 1 item"),
}


@pytest.mark.parametrize(("settings", "words"), REFUSED.values(), ids=REFUSED)
def test_wrong_distributions_are_refused(settings, words):
    with pytest.raises(rnc.ConfigurationError) as caught:
        SeededDraws.of({"x": settings})
    assert words in str(caught.value)
