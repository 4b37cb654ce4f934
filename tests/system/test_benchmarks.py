"""The benchmark measures what it says and writes down what its first page promises; times are not judged here."""

import json

import pytest

from benchmarks import __main__ as entry
from benchmarks import recording, reduction

SYSTEM = "snakeboard"


@pytest.fixture(scope="module")
def mutation():
    """The module, which imports Cosmic Ray: that takes seconds."""
    from benchmarks import mutation

    return mutation


def test_a_sample_says_what_the_whole_has_at_least(mutation):
    """Wilson's bound, one-sided: by the table of the binomial distribution 95 of 100 leave 90 %."""
    assert mutation.lower_bound(95, 100) == pytest.approx(0.90, abs=0.003)
    assert mutation.lower_bound(950, 1000) == pytest.approx(0.937, abs=0.002)


def test_json_has_what_is_documented(tmp_path, capsys):
    file = tmp_path / "costs.json"
    reduction.main(["--systems", SYSTEM, "--rounds", "1", "--json", str(file)])
    written = json.loads(file.read_text())
    assert set(written) == {"rounds", "systems", "derivatives_by_hand", "commands", "machine"}
    (system,) = written["systems"]
    for cost in ("one_state", "of_batch", "terms", "derivatives", "of_block", "tick"):
        assert set(system[cost]) == {"us", "ratio", "limit", "within"}
        assert min(system[cost]["us"], system[cost]["ratio"]) > 0
    assert system["one_state"]["ratio"] == pytest.approx(system["one_state"]["us"] / system["bare_us"])
    assert {each["system"] for each in written["derivatives_by_hand"]} == {"space-robot", "free-panda"}
    assert max(each["difference"] for each in written["derivatives_by_hand"]) < 1e-10
    assert {each["command"] for each in written["commands"]} == {"import rnc_pin", "rnc-pin --help"}
    assert SYSTEM in capsys.readouterr().out


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
