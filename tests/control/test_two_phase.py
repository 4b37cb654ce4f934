"""Class 3: split control, the point stabiliser for chained systems, and the two phases together (section 4.2)."""

import runpy

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import chain_rate
from places import ROOT
from rnc_pin.control import (
    ChainedStabilizer,
    PositionTracker,
    SplitController,
    UnicycleStabilizer,
)
from rnc_pin.model.measurement import Measurement
from rnc_pin.planning import Hold
from rnc_pin.scenario.run import execute, plan
from tolerances import FINITE_DIFFERENCE, ROUNDING

PAPER = {"controller.preset": "paper", "comparisons": {}, "plots": {}, "simulation.dt": 0.02}

EXAMPLE = ROOT / "examples" / "two_phases.py"


@pytest.mark.parametrize("n", [3, 4, 5])
def test_chained_systems_converge_exponentially_from_anywhere(n):
    """Astolfi 1996, on the chain itself: every coordinate below 1e-3 of where it began, and inputs stay bounded."""
    stabilizer = ChainedStabilizer(n, k=0.5, rate=1.5)
    generator = np.random.default_rng(n)
    for _ in range(5):
        x = generator.uniform(-1, 1, n)
        x[0] = np.sign(x[0]) * max(abs(x[0]), 0.5)
        start, h, largest = np.abs(x).max(), 2e-3, 0.0
        # A linear system whose poles are close together overshoots; by how much depends on the gains alone.
        bound = 10 * np.linalg.norm(stabilizer.P) * np.linalg.norm(stabilizer.coordinates(x))
        for _ in range(round(16.0 / h)):
            u = stabilizer.command(x)
            largest = max(largest, np.abs(u).max())
            middle = x + h / 2 * chain_rate(x, u)
            x = x + h * chain_rate(middle, stabilizer.command(middle))
        assert np.abs(x).max() < 1e-3 * start
        assert largest < bound


def test_poles_are_where_they_were_asked_for():
    """z is linear: under u1 = -k x1 it moves by a matrix whose eigenvalues are the poles."""
    stabilizer = ChainedStabilizer(4, k=0.5, rate=2.0)
    columns, h = [], 1e-6
    for z in np.eye(3):
        x = np.concatenate([[1.0], z])
        moved = x + h * chain_rate(x, stabilizer.command(x))
        columns.append((stabilizer.coordinates(moved) - z) / h)
    poles = np.sort(np.linalg.eigvals(np.column_stack(columns)).real)
    np.testing.assert_allclose(poles, [-2.4, -2.2, -2.0], atol=1e-3)


def test_rate_of_the_command_is_exact():
    stabilizer, x, h = ChainedStabilizer(4), np.array([0.8, -0.3, 0.5, 0.2]), 1e-6
    u = np.array([-0.7, 0.4])
    ahead, behind = (stabilizer.command(x + sign * h * chain_rate(x, u)) for sign in (1, -1))
    np.testing.assert_allclose(stabilizer.command_rate(x, u), (ahead - behind) / (2 * h), atol=FINITE_DIFFERENCE)


@pytest.mark.parametrize("arguments", [(2, 0.5, 1.5), (3, 0.0, 1.5), (3, 2.0, 1.5)])
def test_chains_and_rates_that_make_no_sense_are_refused(arguments):
    with pytest.raises(rnc.ConfigurationError, match="needs n >= 3 and 0 < k < rate"):
        ChainedStabilizer(*arguments)


def test_a_chain_saturates_and_refuses_where_it_has_no_law():
    """Inputs have one bound, the path is the one without it, and x1 = 0 is outside the domain."""
    held, free = ChainedStabilizer(3, max_input=0.5), ChainedStabilizer(3, max_input=1e9)
    for x in np.random.default_rng(0).normal(size=(20, 3)):
        u, law = held.command(x), free.command(x)
        assert np.linalg.norm(u) <= 0.5 + ROUNDING
        np.testing.assert_allclose(u[0] * law[1], u[1] * law[0], atol=1e-9 * np.abs(law).max())
    h, x, u = 1e-6, np.array([0.8, -0.3, 0.5]), np.array([-0.7, 0.4])
    ahead, behind = (held.command(x + sign * h * chain_rate(x, u)) for sign in (1, -1))
    np.testing.assert_allclose(held.command_rate(x, u), (ahead - behind) / (2 * h), atol=FINITE_DIFFERENCE)
    for x in ([0.0, 0.1, 0.0], [0.0, 0.0, 0.0], [1e-320, 1.0, 1.0]):
        with pytest.raises(rnc.InputError, match="outside the domain of its stabiliser"):
            held.command(np.array(x))


GOAL = np.array([0.4, -0.7, 2.0])


def seen(pose, v2=(0.0, 0.0)):
    return Measurement(x1=np.array(pose[:2]), x2=np.array([0.0, pose[2]]), v2=np.array(v2))


def beside(dx, dy, turn):
    """A pose in the goal's axes."""
    c, s = np.cos(GOAL[2]), np.sin(GOAL[2])
    return GOAL + np.array([c * dx - s * dy, s * dx + c * dy, turn])


def driven(stabilizer, pose, duration, dt=0.02, state=None, start=0.0):
    """The pose, the state and all targets after kinematics alone: arcs at the velocities asked for."""
    v2, targets = np.zeros(2), []
    state = stabilizer.initial_state(seen(pose)) if state is None else state
    for sample in range(round(duration / dt)):
        target, state = stabilizer.step(start + sample * dt, seen(pose, v2), state)
        v2 = target.v2
        half = v2[1] * dt / 2
        way = dt * v2[0] * np.sinc(half / np.pi)
        pose = pose + np.array([way * np.cos(pose[2] + half), way * np.sin(pose[2] + half), 2 * half])
        targets.append(v2)
    return pose, state, np.array(targets)


def off(pose):
    turn = np.remainder(pose[2] - GOAL[2] + np.pi, 2 * np.pi) - np.pi
    return np.hypot(*(pose[:2] - GOAL[:2])), abs(turn)


SPECIAL = [(0, 1, 0), (0, 0, 3.1), (1, 0, np.pi), (-1, 0, 1.5707), (-2, 1e-9, np.pi), (0, 1e-9, 1.5707), (0, 0.01, 0)]


@pytest.mark.parametrize("start", [*SPECIAL, *np.random.default_rng(1).uniform(-3, 3, (8, 3))])
def test_a_unicycle_arrives_in_x_y_and_heading_from_anywhere(start):
    """Abeam, turned round, on the spot: and never faster than its limits, wherever it is."""
    stabilizer = UnicycleStabilizer(GOAL, np.array([0, 1]), max_speed=(0.8, 0.6))
    pose, state, asked = driven(stabilizer, beside(*start), 26.0)
    distance, turn = off(pose)
    assert state.resting
    assert distance < stabilizer.tolerance
    assert turn < stabilizer.tolerance
    assert (np.abs(asked).max(axis=0) < (0.8, 0.6)).all()


@pytest.mark.parametrize("ahead", [1.0, -1.0])
def test_a_unicycle_sets_out_the_way_that_its_goal_lies(ahead):
    stabilizer = UnicycleStabilizer(GOAL, np.array([0, 1]))
    _, first, _ = driven(stabilizer, beside(-ahead, 0.05, 0.02), 0.02)
    _, state, asked = driven(stabilizer, beside(-ahead, 0.05, 0.02), 0.1)
    assert first.backwards == state.backwards == (ahead < 0)
    assert (asked[2:, 0] * ahead > 0).all()


@pytest.mark.parametrize("left", [(0.05, 0, 0), (0, 0.05, 0), (0, 0, 0.05)], ids=["x", "y", "heading"])
def test_it_rests_only_where_all_three_are_small_and_wakes_up_when_pushed(left):
    stabilizer = UnicycleStabilizer(GOAL, np.array([0, 1]), tolerance=0.01)
    _, state, asked = driven(stabilizer, beside(*left), 0.5)
    assert not state.resting
    assert np.abs(asked).max() > 1e-3
    _, resting, asked = driven(stabilizer, beside(0.004, -0.003, 0.002), 1.0)
    assert resting.resting
    np.testing.assert_array_equal(asked, 0.0)
    pose, state, _ = driven(stabilizer, beside(*left), 20.0, state=resting, start=1.0)
    assert state.resting
    assert max(off(pose)) < 0.01
    moving = seen(beside(0, 0, 0), (0.1, 0.0))  # through the goal is not at the goal
    assert not stabilizer.step(0.0, moving, stabilizer.initial_state(moving))[1].resting


@pytest.mark.parametrize("start", [(-1.2, 0.7, 0.4), (1.5, 0.3, -0.2), (-0.5, 0.9, 2.0), (-1.0, 0.002, 0.001)])
@pytest.mark.parametrize("t", [0.4, 7.0], ids=["setting out", "later"])
def test_rate_of_what_the_unicycle_is_asked_for_is_exact(start, t):
    """Against differences along a motion that is not the one asked for."""
    stabilizer, h, v2 = UnicycleStabilizer(GOAL, np.array([0, 1])), 1e-6, np.array([0.3, -0.5])
    pose = beside(*start)
    _, state = stabilizer.step(0.0, seen(pose, v2), stabilizer.initial_state(seen(pose)))
    rate = np.array([v2[0] * np.cos(pose[2]), v2[0] * np.sin(pose[2]), v2[1]])
    ahead, behind = (stabilizer.step(t + sign * h, seen(pose + sign * h * rate, v2), state)[0].v2 for sign in (1, -1))
    target = stabilizer.step(t, seen(pose, v2), state)[0]
    np.testing.assert_allclose(target.v2_dot, (ahead - behind) / (2 * h), atol=1e-6)


def test_what_makes_no_sense_for_a_unicycle_is_refused():
    for settings, words in (
        ({"k": 2.0, "rate": 1.0}, "needs 0 < k < rate"),
        ({"tolerance": 0.0}, "tolerance > 0"),
        ({"max_speed": (1.0, 0.0)}, "positive limits"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=words):
            UnicycleStabilizer(GOAL, np.array([0, 1]), **settings)
    stabilizer = UnicycleStabilizer(GOAL, np.array([0, 1]))
    with pytest.raises(rnc.InputError, match="position and heading have to be given"):
        stabilizer.initial_state(seen((0.0, np.nan, 0.0)))


def test_the_hand_arrives_first_and_stays_while_the_platform_drives(tmp_path, monkeypatch, capsys):
    """Figure 7, by the script in ``examples``."""
    monkeypatch.chdir(tmp_path)
    script = runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert capsys.readouterr().out.strip()
    run, goal = script["run"], (-1.3, 0.0, 0.0)
    hand = np.linalg.norm(run.x2[:, :2], axis=1)
    platform = np.linalg.norm(run.x1 - goal[:2], axis=1) + np.abs(run.x2[:, 3] - goal[2])
    hand_arrived, all_arrived = (run.time[np.flatnonzero(error > 0.02)[-1] + 1] for error in (hand, platform))
    assert hand_arrived < all_arrived / 3
    assert hand[run.time > 4.0].max() < 0.02
    assert platform[-1] < 0.02
    assert np.abs(np.diff(run.x1[run.time < 4.0], axis=0)).max() < 1e-4  # the platform waited


def test_at_the_papers_gains_the_platform_arrives_in_heading_too():
    """Figure 7 with k = 10, k1 = k2 = 10, gamma = 2: slow loops, so it drives slowly, and rests."""
    run = execute(plan("mobile-manipulator-two-phase", PAPER)).trajectory
    pose = np.column_stack([run.x1[:, :2], run.x2[:, 3]])
    assert np.abs(pose[-1] - [-1.3, 0.0, 0.0]).max() < 0.03
    assert np.abs(run.v2_desired[-1, 2:]).max() == 0.0
    assert np.abs(run.x2[run.time > 6.0, :2]).max() < 0.02  # the hand stays


def test_every_output_belongs_to_one_part():
    tracker = PositionTracker(Hold([0.0, 0.0]))
    with pytest.raises(rnc.ConfigurationError, match="expected each of 0 to 3 once"):
        SplitController([(tracker, np.array([0, 1])), (tracker, np.array([1, 2]))], 4)
