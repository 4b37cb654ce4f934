"""The benchmark measures what it says and writes down what its first page promises; times are not judged here."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import reduction
from benchmarks.covered_lines import ROOT, TESTS, Lines, TimedTest, in_turn, lowest, modules, statement
from benchmarks.states import regular_states
from rnc_pin.scenario.run import plan

SYSTEM = "snakeboard"
COST = {"us", "ratio", "limit", "within"}


@pytest.fixture(scope="module")
def experiment():
    return plan(SYSTEM).experiment


def test_states_are_regular_and_repeat_themselves(experiment):
    reduced = experiment.reduced
    states, again = (regular_states(reduced, experiment.q0, 5) for _ in range(2))
    assert np.array_equal(states.q, again.q)
    assert len(np.unique(states.q, axis=0)) == 5
    assert np.isfinite(reduced.forward_dynamics(states.q, states.v2, states.T)).all()
    assert np.abs(reduced.constraint_residual(states.q, states.v)).max() < 1e-12


def test_mutants_meet_tests_that_are_there():
    assert [name for name in TESTS if not (ROOT / "tests" / f"test_{name}.py").exists()] == []
    assert len(list(modules(["rnc_pin/outputs"]))) > 5


def test_a_mutant_meets_the_tests_of_its_statement_the_shortest_first(tmp_path):
    """A line goes with its whole statement, the head of a loop without its body, what only imports with its module."""
    (tmp_path / "module.py").write_text("a = [\n    1,\n]\nfor b in a:\n    c = b\n    d = c\n")
    assert [statement(tmp_path / "module.py", line) for line in (2, 4, 6)] == [range(1, 4), range(4, 5), range(6, 7)]
    (tmp_path / "tests.xml").write_text(
        '<testsuite><testcase classname="tests.test_x" name="test_long" time="3.0"/>'
        '<testcase classname="tests.test_x" name="test_short[1]" time="0.5"/></testsuite>'
    )
    long, short = "tests/test_x.py::test_long", "tests/test_x.py::test_short[1]"
    contexts = {1: [""], 4: [f"{long}|run"], 5: [f"{long}|run", f"{short}|setup"], 6: []}
    lines = Lines(tmp_path, lambda file: contexts)
    found = [[test.name for test in lines.through(Path("module.py"), line)] for line in (2, 4, 5, 6)]
    assert found == [[short, long], [long], [short, long], []]
    lines = Lines(tmp_path, lambda file: {2: [""], 4: [""]})  # definitions alone, which any test may read
    assert [test.name for test in lines.through(Path("module.py"), 2)] == [short, long]


def test_a_mutant_is_loaded_from_its_text_and_a_module_beside_it_from_its_file(tmp_path):
    """In a process of its own, for this one has the project loaded; a mutant without end runs out of time."""
    (tmp_path / "one.py").write_text("import two\n\ndef f(n):\n    return n + two.g()\n")
    (tmp_path / "two.py").write_text("def g():\n    return 1\n")
    (tmp_path / "test_one.py").write_text("import one\n\ndef test_sum():\n    assert one.f(2) == 3\n")
    trials = [("one", "import two\n\ndef f(n):\n    return n * two.g()\n"), ("one", "def f(n):\n    return 3\n"),
              ("two", "def g():\n    return 2\n"), ("two", "def g():\n    while True: pass\n")]  # fmt: skip
    (tmp_path / "run.py").write_text(
        f"""
import sys
from pathlib import Path
sys.path[:0] = [{str(ROOT)!r}, {str(tmp_path)!r}]
from benchmarks import forked_tests
forked_tests.LIBRARIES = ()
trials = [forked_tests.Trial(Path(name + ".py"), text, ["test_one.py"], 2.0) for name, text in {trials!r}]
print(sorted((trials.index(trial), alive) for trial, alive in forked_tests.survivors(trials, jobs=2)))
"""
    )
    told = subprocess.run([sys.executable, "run.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert told.stdout.strip() == "[(0, False), (1, True), (2, False), (3, False)]", told.stderr


def test_tests_of_what_others_pass_over_come_first(tmp_path):
    """One that goes through lines of its own sees more of its module than one that runs it in passing."""
    (tmp_path / "module.py").write_text("a = 1\nb = 2\n")
    names = ["tests/test_x.py::test_a", "tests/test_x.py::test_b", "tests/test_y.py::test_own"]
    (tmp_path / "tests.xml").write_text(
        '<testsuite><testcase classname="tests.test_x" name="test_a" time="0.1"/>'
        '<testcase classname="tests.test_x" name="test_b" time="0.2"/>'
        '<testcase classname="tests.test_y" name="test_own" time="0.3"/></testsuite>'
    )
    contexts = {1: [f"{name}|run" for name in names], 2: [f"{names[2]}|run"]}
    lines = Lines(tmp_path, lambda file: contexts)
    assert [test.name for test in lines.through(Path("module.py"), 1)] == [names[2], names[0], names[1]]


def test_files_take_turns():
    """Beside the shortest tests of one file the others would never be met in time."""
    tests = [
        TimedTest(0.1, "a::x[1]"),
        TimedTest(0.2, "a::x[2]"),
        TimedTest(0.3, "a::y"),
        TimedTest(0.5, "b::z"),
        TimedTest(0.6, "b::w"),
    ]
    assert [test.name for test in in_turn(tests)] == ["a::x[1]", "b::z", "a::x[2]", "b::w", "a::y"]


def test_a_sample_says_what_the_whole_has_at_least():
    """Wilson's bound, one-sided: by the table of the binomial distribution 95 of 100 leave 90 %."""
    assert lowest(95, 100) == pytest.approx(0.90, abs=0.003)
    assert lowest(950, 1000) == pytest.approx(0.937, abs=0.002)


def test_figures_are_finite_and_positive():
    costs = reduction.system_costs(SYSTEM, rounds=2)
    figures = [costs.bare_us, costs.threads]
    for cost in (costs.one_state, costs.of_batch, costs.tick):
        figures += [cost.us, cost.ratio]
    assert np.isfinite(figures).all()
    assert min(figures) > 0
    assert costs.one_state.ratio == pytest.approx(costs.one_state.us / costs.bare_us)


def test_a_limit_that_is_not_kept_is_marked():
    cost = reduction.Cost(us=30.0, ratio=11.0, limit=10.0)
    assert not cost.within
    assert reduction.cells(cost) == ("30.0", "[bold red]11.0[/]")


def test_json_has_what_is_documented(tmp_path, capsys):
    file = tmp_path / "costs.json"
    reduction.main(["--systems", SYSTEM, "--rounds", "1", "--json", str(file)])
    written = json.loads(file.read_text())
    assert set(written) == {"rounds", "systems", "commands", "machine"}
    (system,) = written["systems"]
    assert set(system) == {"system", "nv", "r", "bare_us", "one_state", "of_batch", "tick", "threads", "within"}
    assert all(set(system[name]) == COST for name in ("one_state", "of_batch", "tick"))
    assert {each["command"] for each in written["commands"]} == {"import rnc_pin", "rnc-pin --help"}
    assert all(set(each) == {"command", "seconds", "limit", "within"} for each in written["commands"])
    assert all(each["seconds"] > 0 for each in written["commands"])
    assert set(written["machine"]) == {"cpus", "python", "numpy", "pin", "python_loop_ms"}
    shown = capsys.readouterr().out
    assert SYSTEM in shown
    assert "rnc-pin --help" in shown
