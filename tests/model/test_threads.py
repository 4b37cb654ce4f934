"""One model, evaluated by several threads."""

import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest

import rnc_pin as rnc
from by_numpy import by_numpy
from kinds import KINDS, driven_arm
from systems import random_states, space_robot_in_joints

THREADS, ROUNDS = 4, 100


@pytest.fixture
def eager_switching():
    """Threads switch after each microsecond, as often as Python can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def plain(reduced, q, v2, t):
    state = by_numpy(reduced, q, v2=v2)
    return np.concatenate([np.ravel(each) for each in (state.J1, state.R_dot, state.A_star_dot, state.M, state.V)])


@cache
def masses(reduced):
    unknown = [rnc.control.UnknownMass("joint_3")]
    return rnc.control.MomentumRegressor(reduced.robot, "platform", unknown).estimated(reduced)


def with_mass(reduced, q, v2, t):
    return masses(reduced).with_parameters(np.array([10.0 + t])).at(q, v2).H


@pytest.mark.parametrize(("make", "evaluate"), [
    (KINDS["bodies that roll"], plain),
    (space_robot_in_joints, with_mass),
])  # fmt: skip
def test_threads_that_evaluate_one_model_find_what_one_thread_finds(make, evaluate, eager_switching):
    reduced = make()
    arguments = [(q, v2, 0.37 * k) for k, (q, v2) in enumerate(random_states(reduced, 2 * THREADS))]
    expected = [evaluate(reduced, *each) for each in arguments]

    def wrong(k):
        own = range(k, len(arguments), THREADS)
        found = [(i, evaluate(reduced, *arguments[i])) for _ in range(ROUNDS) for i in own]
        return sum(not np.array_equal(each, expected[i]) for i, each in found)

    with ThreadPoolExecutor(THREADS) as threads:
        assert sum(threads.map(wrong, range(THREADS))) == 0


def test_an_evaluation_at_another_time_in_between_changes_nothing():
    reduced = driven_arm().reduce()
    ((q, v2),), T = random_states(reduced, 1), np.ones(reduced.p)

    class Interposed:  # the kernel's caller converts it to an array
        def __array__(self, *_, **__):
            reduced.forward_dynamics(q, v2, T, t=0.9)
            return T

    found = reduced.forward_dynamics(q, v2, Interposed(), t=0.1)
    np.testing.assert_array_equal(found, reduced.forward_dynamics(q, v2, T, t=0.1))
