"""Others compute the accelerations and motions that we do; times are not judged here."""

import numpy as np
import pytest

from benchmarks.peers import pinocchio_calls
from benchmarks.peers.__main__ import evaluations, hand_difference
from benchmarks.peers.cases import CASES
from benchmarks.peers.motion import Motion, cost_at
from benchmarks.states import regular_states
from tolerances import KKT


@pytest.mark.parametrize("name", ["space-robot", "mobile-manipulator", "free-panda", "free-panda-joints"])
def test_the_solution_by_hand_agrees(name):
    case = CASES[name]()
    assert hand_difference(case, regular_states(case.reduced, case.q0, 5)) < KKT


def test_pinocchios_own_dynamics_agree_and_a_wrong_one_is_noticed():
    case = CASES["space-robot"]()
    rows = list(evaluations(case, [pinocchio_calls], rounds=1))
    assert [row["peer"] for row in rows] == [
        "KKT in Python",
        "Pinocchio forwardDynamics",
        "Pinocchio constraintDynamics",
    ]
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
