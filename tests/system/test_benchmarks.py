"""Tools behind the recorded figures: mutants, records, sizes, peers, replays of verdicts, and changed robots."""

import importlib
from collections import Counter

import numpy as np
import pinocchio as pin
import pytest

import perturbed_urdf as perturbed
from benchmarks import __main__ as entry
from benchmarks import perturbations, recording, verdicts
from benchmarks.peers import pinocchio_calls
from benchmarks.peers.__main__ import evaluations, hand_difference
from benchmarks.peers.cases import CASES
from benchmarks.peers.motion import Motion, cost_at
from benchmarks.states import regular_states
from rnc_pin.robots.robot_files import shipped_directory
from tolerances import KKT


def test_a_sample_says_what_the_whole_has_at_least():
    """Wilson's bound, one-sided: by the table of the binomial distribution 95 of 100 leave 90 %."""
    from benchmarks import mutation  # with Cosmic Ray, which takes seconds

    assert mutation.lower_bound(95, 100) == pytest.approx(0.90, abs=0.003)
    assert mutation.lower_bound(950, 1000) == pytest.approx(0.937, abs=0.002)


@pytest.mark.parametrize("name", ["optimal", "reduction", "set_points", "ways", "whole_body"])
def test_every_benchmark_finds_what_it_measures(name):
    importlib.import_module(f"benchmarks.{name}")


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


@pytest.mark.parametrize("name", ["space-robot", "mobile-manipulator", "free-panda", "free-panda-joints"])
def test_the_solution_by_hand_agrees(name):
    case = CASES[name]()
    assert hand_difference(case, regular_states(case.reduced, case.q0, 5)) < KKT


def test_pinocchios_own_dynamics_agree_and_a_wrong_one_is_noticed():
    case = CASES["space-robot"]()
    rows = list(evaluations(case, [pinocchio_calls], rounds=1))
    peers = ["KKT in Python", "Pinocchio forwardDynamics", "Pinocchio constraintDynamics"]
    assert [row["peer"] for row in rows] == peers
    assert max(row["difference"] for row in rows) < KKT
    assert all(row["us"] > 0 and row["ratio"] == pytest.approx(row["ours_us"] / row["us"]) for row in rows)
    states = regular_states(case.reduced, case.q0, 5)
    moved = states._replace(T=states.T + 1e-3)
    assert pinocchio_calls.kkt(case, states).difference(case, moved) > 1e-6


@pytest.mark.parametrize("name", ["mobile-manipulator", "free-panda-joints"])
def test_motions_agree(name):
    motion = Motion(CASES[name](), duration=0.3)
    theirs = motion.configurations(motion.theirs(1e-12))
    assert motion.displacement(motion.ours(1e-12), theirs) < 1e-10
    assert motion.displacement(motion.ours(1e-12)[::-1], theirs) > 1e-3


def test_costs_are_compared_at_equal_error():
    """Of an integrator of order eight the cost grows with the eighth root of the accuracy."""
    errors = [1e-6, 1e-9, 1e-12]
    times = [error ** (-1 / 8) for error in errors]
    assert cost_at(1e-10, errors, times) == pytest.approx(10 ** (10 / 8))
    assert np.isfinite(cost_at(1e-14, errors, times))


@pytest.mark.parametrize("number", [0, 4, 5])
def test_drawn_runs_are_judged_as_they_are(number):
    """One of each scenario; with seed 0 they hit boxes, and exceed positions, velocities and efforts."""
    case = verdicts.drawn_case(0, number)
    assert [str(kind) for kind, each in case.items() if each.true not in (None, each.found)] == []


@pytest.mark.long
def test_two_hundred_drawn_runs_and_all_built_in_scenarios(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["verdicts", "--runs", "200"])
    verdicts.main()
    out = capsys.readouterr().out
    for line in out.splitlines():
        if line.startswith("| ") and not line.startswith("| finding"):
            missed, invented = line.split("|")[3:5]
            assert (int(missed), int(invented)) == (0, 0), out


@pytest.mark.parametrize("name", ["noise", "names", "order", "mirrored"])
def test_a_changed_robot_turns_as_heavily(name):
    """Eigenvalues of the mass matrix of the revolute joints of an arm."""
    urdf = (shipped_directory() / "space_robot.urdf").read_text()
    models = [pin.buildModelFromXML(each) for each in (urdf, perturbed.PERTURBATIONS[name](urdf, 1))]
    M, changed = (pin.crba(model, model.createData(), pin.neutral(model)) for model in models)
    found = np.linalg.eigvalsh(changed)
    np.testing.assert_allclose(found, np.linalg.eigvalsh(M), rtol=2e-2 if name == "noise" else 1e-9)
    assert urdf != perturbed.PERTURBATIONS[name](urdf, 1) != perturbed.PERTURBATIONS["noise"](urdf, 2)


@pytest.mark.filterwarnings("ignore::rnc_pin.ModelWarning")
def test_trials_of_a_robot(brief):
    found = list(perturbations.trials("dirt/wide_wheels", draws=2))
    expected = {name: 1 + (name in perturbed.DRAWN) for name in perturbed.PERTURBATIONS if name != "no drives"}
    assert Counter(each.perturbation for each in found) == expected
    assert {each.after for each in found} == {"planar skid-steered, 4 wheels, 4 inputs"}
    assert perturbations.share(found) == 1


@pytest.mark.long  # a quarter of an hour
@pytest.mark.filterwarnings("ignore::rnc_pin.ModelWarning")
def test_drafts_keep_the_kind_of_base():
    found = [trial for name in perturbations.sources() for trial in perturbations.trials(name)]
    assert perturbations.share(found) >= 0.99, [str(trial) for trial in found if not trial.kept]
