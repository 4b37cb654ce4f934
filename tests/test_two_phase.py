"""Class 3: split control, the point stabiliser for chained systems, and the two phases together (section 4.2)."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.control import (
    ChainedStabilizer,
    PositionTracker,
    SplitController,
    UnicycleStabilizer,
)
from rnc_pin.planning import Hold
from systems import mobile_manipulator
from tolerances import FINITE_DIFFERENCE

EXAMPLE = Path(__file__).parent.parent / "examples" / "two_phases.py"


def chain_rate(x, u):
    return np.concatenate([[u[0], u[1]], x[1:-1] * u[0]])


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


@pytest.mark.parametrize("goal", [(-1.6, 2.0, 0.0), (0.0, 0.4, 2.5)])
def test_a_goal_outside_the_chart_is_refused_before_anything_moves(goal):
    reduced = mobile_manipulator()
    q0 = reduced.robot.configuration({"root_joint": (-1.6, 0.4, 0.2), "joint_1": 0.4, "joint_2": -1.4})
    measured = reduced.measure(q0, np.zeros(4))
    stabilizer = UnicycleStabilizer(np.array(goal), np.array([1, 2]))
    with pytest.raises(rnc.ConfigurationError, match="has to lie ahead or behind"):
        stabilizer.initial_state(measured._replace(x2=measured.x2[2:]))


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


def test_every_output_belongs_to_one_part():
    tracker = PositionTracker(Hold([0.0, 0.0]))
    with pytest.raises(rnc.ConfigurationError, match="expected each of 0 to 3 once"):
        SplitController([(tracker, np.array([0, 1])), (tracker, np.array([1, 2]))], 4)
