"""The benchmark measures what it says and writes down what its first page promises; times are not judged here."""

import json
from pathlib import Path

import numpy as np
import pytest

import rnc_pin as rnc
from benchmarks import __main__ as entry
from benchmarks import plan_peers, recording, reduction, whole_body_peers

SYSTEM = "snakeboard"
COST = {"us", "ratio", "limit", "within"}


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
    assert chosen(4, patience=5.0) == [own, package]
    assert chosen(4, patience=1.0) == [own]
    assert sorted(chosen(4, of={2: [""], 4: [""]})) == sorted(seconds)
    assert chosen(4, of={}) == []


@pytest.mark.long
def test_survivors_meet_both_paths(mutation, tmp_path, monkeypatch):
    """One mutant dies on the compiled path only, one on neither."""
    tree = tmp_path / "tree"
    tree.mkdir()
    (tree / "one.py").write_text("def g():\n    return 5\n\ndef h():\n    return 7\n")
    (tree / "test_one.py").write_text(
        "import os\nimport one\n\n"
        "def test_paths():\n    assert os.environ['RNC_PIN_KERNEL'] == 'numpy' or one.g() == 5\n"
    )
    monkeypatch.chdir(tree)
    made = mutation.mutants([Path("one.py")])
    first = [next(each for each in made if each.start_pos[0] == line) for line in (2, 5)]
    left = mutation.survivors([(each, ["test_one.py"]) for each in first], tree, 60.0, 1)
    assert [mutant.start_pos[0] for mutant, _ in left] == [5]
    assert "return 7" in left[0][1].diff


def test_a_sample_says_what_the_whole_has_at_least(mutation):
    """Wilson's bound, one-sided: by the table of the binomial distribution 95 of 100 leave 90 %."""
    assert mutation.lower_bound(95, 100) == pytest.approx(0.90, abs=0.003)
    assert mutation.lower_bound(950, 1000) == pytest.approx(0.937, abs=0.002)


def test_a_limit_that_is_not_kept_is_marked():
    cost = reduction.Cost(us=30.0, ratio=11.0, limit=10.0)
    assert not cost.within
    assert reduction.cells(cost) == ("30.0", "[bold red]11.0[/]")


def test_json_has_what_is_documented(tmp_path, capsys):
    file = tmp_path / "costs.json"
    reduction.main(["--systems", SYSTEM, "--rounds", "1", "--json", str(file)])
    written = json.loads(file.read_text())
    assert set(written) == {"rounds", "systems", "derivatives_by_hand", "commands", "machine"}
    (system,) = written["systems"]
    costs = {"one_state", "of_batch", "terms", "derivatives", "of_block", "tick"}
    assert set(system) == {"system", "nv", "r", "bare_us", "threads", "within"} | costs
    assert all(set(system[name]) == COST for name in costs)
    assert (
        min(system["bare_us"], system["threads"], *(system[name][of] for name in costs for of in ("us", "ratio"))) > 0
    )
    assert system["one_state"]["ratio"] == pytest.approx(system["one_state"]["us"] / system["bare_us"])
    for each in written["derivatives_by_hand"]:
        figures = {"us", "block_us", "hand_us", "ratio", "difference", "limit", "within"}
        assert set(each) == {"system"} | figures
        assert each["difference"] < 1e-10
    assert [each["system"] for each in written["derivatives_by_hand"]] == ["space-robot", "free-panda"]
    assert {each["command"] for each in written["commands"]} == {"import rnc_pin", "rnc-pin --help"}
    assert all(set(each) == {"command", "seconds", "limit", "within"} for each in written["commands"])
    assert all(each["seconds"] > 0 for each in written["commands"])
    assert set(written["machine"]) == {"cpus", "python", "numpy", "pin", "python_loop_ms", "load"}
    shown = capsys.readouterr().out
    assert SYSTEM in shown
    assert "rnc-pin --help" in shown


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


def test_a_peer_that_computes_other_accelerations_is_not_timed(tmp_path, monkeypatch, capsys):
    robot = rnc.Robot.from_example("panda", lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0})
    goal, peer = robot.configuration(), tmp_path / "peer"
    monkeypatch.delenv("RNC_PIN_CROCODDYL", raising=False)
    plan_peers.beside(robot, goal, [1.0, 1.0])
    assert "Crocoddyl is missing" in capsys.readouterr().out
    answer = {"version": "0", "accelerations": [[1.0] * robot.nv] * 5, "solutions": []}
    peer.write_text(f"#!/bin/sh\ncat > /dev/null\necho '{json.dumps(answer)}'\n", encoding="utf-8")
    peer.chmod(0o755)
    monkeypatch.setenv("RNC_PIN_CROCODDYL", str(peer))
    plan_peers.beside(robot, goal, [1.0, 1.0])
    assert "not timed" in capsys.readouterr().out


def test_torques_of_a_peer_count_only_if_the_hand_follows_within_limits(capsys):
    robot = rnc.Robot.from_example("panda", lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0})
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
    held = reduced.at(np.array(whole_body_peers._START), np.zeros(reduced.r)).G  # gravity, balanced
    hand = reduced.at(np.array(whole_body_peers._START)).position.placement(robot.frame_id("panda_hand")).translation
    for efforts, followed in ((held, True), (np.zeros(robot.nv), False)):
        whole_body_peers._report("peer", 1e-5, np.tile(efforts, (100, 1)), reduced, [[hand]] * 100)
        assert ("does NOT do the task" in capsys.readouterr().out) is not followed


def test_a_tree_that_grew_beyond_its_table_is_refused(tmp_path):
    from benchmarks import codebase

    (tmp_path / "rnc_pin").mkdir()
    (tmp_path / "rnc_pin" / "one.py").write_text('"""Text."""\n\n# a comment\nONE = 1\nTWO = (\n    2\n)\n')
    table = "".join(f"| {name} | {4 if 'without' in name else 99} |\n" for name in codebase.sizes(tmp_path))
    (tmp_path / "CONTRIBUTING.md").write_text(table)
    assert codebase.check(tmp_path) == []
    (tmp_path / "rnc_pin" / "two.py").write_text("three = 3\n")
    assert codebase.check(tmp_path) == ["lines of Python without comments: 5, and CONTRIBUTING.md allows 4"]
