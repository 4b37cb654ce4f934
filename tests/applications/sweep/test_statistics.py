"""Quantiles in constant memory are those of NumPy."""

import numpy as np

from rnc_pin.applications.sweep.reports import quantiles

FRACTIONS = (0.0, 0.01, 0.5, 0.95, 1.0)


def test_quantiles_are_those_of_numpy():
    generator = np.random.default_rng(0)
    values = np.concatenate(
        [generator.normal(size=2000) * 10.0 ** generator.integers(-300, 300, 2000), [0.0, -0.0, 5e-324], [3.0] * 99]
    )
    generator.shuffle(values)
    found = quantiles(lambda: iter(np.array_split(values, 7)), FRACTIONS)
    assert found == np.quantile(values, FRACTIONS).tolist()


def test_missing_numbers_are_left_out():
    values = np.array([np.nan, 2.0, 1.0, np.nan])
    assert quantiles(lambda: iter([values, np.full(3, np.nan)]), (0.0, 0.5, 1.0)) == [1.0, 1.5, 2.0]
    assert np.isnan(quantiles(lambda: iter([np.full(3, np.nan)]), (0.5,))).all()
