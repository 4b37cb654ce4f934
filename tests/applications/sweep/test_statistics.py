"""Quantiles in constant memory: of the numbers in all chunks, without those that are missing."""

import numpy as np

from rnc_pin.applications.sweep.reports import quantiles


def test_quantiles_are_of_all_chunks_without_missing_numbers(tmp_path):
    values = np.random.default_rng(0).normal(size=2000)
    some = np.insert(values, [0, 5, 5], np.nan)
    fractions = (0.0, 0.01, 0.5, 0.95, 1.0)
    assert quantiles(np.array_split(some, 7), fractions, tmp_path) == np.quantile(values, fractions).tolist()
    assert quantiles([np.full(3, np.nan)], fractions, tmp_path) is None
    assert not any(tmp_path.iterdir())
