"""Every row of docs/validation.md, computed anew, stays within its tolerance, and the page has it."""

import numpy as np
import pytest

from benchmarks.validation import PROBLEMS
from benchmarks.validation.__main__ import cells
from benchmarks.validation.row import Row
from places import ROOT
from tools import tables


@pytest.mark.parametrize("problem", PROBLEMS)
def test_every_row_is_within_its_tolerance_and_on_the_page(problem):
    rows = PROBLEMS[problem]()
    assert len(rows) >= 3
    assert f"<!-- generated: table validation {problem} -->" in (ROOT / "docs" / "validation.md").read_text()
    table = [(row["source"], row["quantity"].partition(" (")[0]) for row in tables.read("validation")[problem]]
    for row in rows:
        assert row.tolerance <= 1e-8
        assert row.difference <= row.tolerance, f"{row.quantity}: {row.difference:.1e} > {row.tolerance:.0e}"
    told = [(row.source, row.quantity.partition(" (")[0]) for row in rows]
    assert told == table, "run python -m benchmarks.validation"


def test_a_row_that_is_wrong_does_not_hold():
    good = Row("", "", [1.0, 2.0], np.array([1.0, 2.0 + 1e-9]), 1e-8)
    assert good.holds
    assert not Row("", "", [1.0, 2.0], np.array([1.0, 2.0 + 1e-7]), 1e-8).holds
    assert not Row("", "", 0.0, np.nan, 1e-9, 1.0).holds
    assert cells(good)[1:4] == (" (1)", "2", "2.000000001")
