"""Tools behind the recorded figures: samples of mutants, records, and the sizes that the tree may have."""

import pytest

from benchmarks import __main__ as entry
from benchmarks import recording


def test_a_sample_says_what_the_whole_has_at_least():
    """Wilson's bound, one-sided: by the table of the binomial distribution 95 of 100 leave 90 %."""
    from benchmarks import mutation  # with Cosmic Ray, which takes seconds

    assert mutation.lower_bound(95, 100) == pytest.approx(0.90, abs=0.003)
    assert mutation.lower_bound(950, 1000) == pytest.approx(0.937, abs=0.002)


def test_every_record_has_its_benchmark():
    assert {path.stem.split("-")[0] for path in recording.FOLDER.glob("*.txt")} <= set(entry.benchmarks())


def test_a_tree_that_grew_beyond_its_table_is_refused(tmp_path):
    from benchmarks import codebase

    (tmp_path / "rnc_pin").mkdir()
    (tmp_path / "rnc_pin" / "one.py").write_text('"""Text."""\n\n# a comment\nONE = 1\nTWO = (\n    2\n)\n')
    table = "".join(f"| {name} | {4 if 'without' in name else 99} |\n" for name in codebase.sizes(tmp_path))
    (tmp_path / "CONTRIBUTING.md").write_text(table)
    assert codebase.check(tmp_path) == []
    (tmp_path / "rnc_pin" / "two.py").write_text("three = 3\n")
    assert codebase.check(tmp_path) == ["lines of Python without comments: 5, and CONTRIBUTING.md allows 4"]
