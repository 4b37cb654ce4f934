"""Comparison of runs to the bit."""

import dataclasses

import numpy as np


def check_same(run, other):
    """Fail unless two runs have the same arrays, to the bit, and the same metadata."""
    for field in dataclasses.fields(run):
        ours, theirs = getattr(run, field.name), getattr(other, field.name)
        if field.name == "info":
            assert ours.to_json() == theirs.to_json()
        else:
            assert np.array_equal(ours, theirs, equal_nan=True), field.name
