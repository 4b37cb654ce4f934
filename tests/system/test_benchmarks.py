"""The benchmark measures what it says and writes down what its first page promises; times are not judged here."""

import json
from pathlib import Path

import pytest

from benchmarks import __main__ as entry
from benchmarks import recording, reduction

SYSTEM = "snakeboard"


@pytest.fixture(scope="module")
def mutation():
    """The module, which imports Cosmic Ray: that takes seconds."""
    from benchmarks import mutation

    return mutation


def test_a_mutant_meets_the_tests_of_its_line_those_of_its_module_first(mutation, tmp_path):
    """A statement is recorded at its first line; a line that only an import executes has all tests of its module."""
    (tmp_path / "tests.xml").write_text(
        '<testsuite><testcase classname="tests.control.test_a" name="test_long[1]" time="3.0"/>'
        '<testcase classname="tests.control.test_b" name="test_b" time="2.0"/>'
        '<testcase classname="tests.model.test_m" name="test_m" time="0.5"/></testsuite>'
    )
    seconds = mutation.durations(tmp_path / "tests.xml")
    own, package, other = seconds
    assert seconds[own] == 3.0
    contexts = {1: [""], 4: [f"{other}|run", f"{package}|run", f"{own}|run"], 6: [f"{own}|run", f"{own}|setup"], 9: []}
    module = Path("rnc_pin/control/a.py")

    def chosen(line, patience=60.0, of=contexts):
        return mutation.tests_of(module, line, of, seconds, patience)

    assert [chosen(line) for line in (2, 4, 5, 6, 9)] == [[own, package, other]] * 3 + [[own]] * 2
    assert (chosen(4, patience=5.0), chosen(4, patience=1.0)) == ([own, package], [own])
    assert (sorted(chosen(4, of={2: [""], 4: [""]})), chosen(4, of={})) == (sorted(seconds), [])


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


def test_one_command_lists_and_runs_all_benchmarks(monkeypatch, capsys):
    listed = entry.benchmarks()
    assert {"reduction", "validation", "peers", "verdicts"} <= set(listed)
    assert not {"states", "timing"} & set(listed)  # parts of others
    assert all(listed.values())
    monkeypatch.setattr("sys.argv", ["benchmarks", "verdict"])
    with pytest.raises(SystemExit, match="no benchmark 'verdict'; did you mean 'verdicts'"):
        entry.main()
    monkeypatch.setattr("sys.argv", ["benchmarks"])
    entry.main()
    assert "reduction" in capsys.readouterr().out


def test_every_record_has_its_benchmark():
    assert {path.stem.split("-")[0] for path in recording.FOLDER.glob("*.txt")} <= set(entry.benchmarks())


def test_a_record_states_command_date_machine_and_load(tmp_path, monkeypatch, capsys):
    """A benchmark that fails leaves the earlier record as it is."""
    monkeypatch.setattr(recording, "FOLDER", tmp_path)
    recording.record("codebase", [])
    kept = (tmp_path / "codebase.txt").read_text()
    head, _, output = kept.partition("\n\n")
    facts = dict(line.split(": ", 1) for line in head.splitlines())
    assert facts["command"] == "python -m benchmarks codebase"
    assert set(facts) == {"command", "date", "machine", "commit", "load", "duration"}
    assert output.strip()
    shown = recording.sections()
    assert "## codebase\n" in shown
    assert facts["machine"] in shown
    assert output in shown
    with pytest.raises(SystemExit, match="nothing is recorded"):
        recording.record("codebase", ["--nothing"])
    assert (tmp_path / "codebase.txt").read_text() == kept


def test_a_tree_that_grew_beyond_its_table_is_refused(tmp_path):
    from benchmarks import codebase

    (tmp_path / "rnc_pin").mkdir()
    (tmp_path / "rnc_pin" / "one.py").write_text('"""Text."""\n\n# a comment\nONE = 1\nTWO = (\n    2\n)\n')
    table = "".join(f"| {name} | {4 if 'without' in name else 99} |\n" for name in codebase.sizes(tmp_path))
    (tmp_path / "CONTRIBUTING.md").write_text(table)
    assert codebase.check(tmp_path) == []
    (tmp_path / "rnc_pin" / "two.py").write_text("three = 3\n")
    assert codebase.check(tmp_path) == ["lines of Python without comments: 5, and CONTRIBUTING.md allows 4"]
