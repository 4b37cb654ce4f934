"""Equilibria: against closed forms, under constraints, with few actuators."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from systems import ALL, four_bar, random_states
from textbook_systems import acrobot, wheeled_pendulum


def check(reduced, found):
    assert found.residual < 1e-8
    linear = rnc.linearize(reduced, found.q, T=found.T)  # which checks that it rests
    np.testing.assert_allclose(linear.T, found.T, atol=1e-7)


@pytest.mark.parametrize(("start", "end"), [(0.3, 0.0), (-1.4, 0.0), (1.7, np.pi), (3.0, np.pi)])
def test_the_pendulum_stands_or_hangs_whatever_is_nearer(start, end):
    reduced = wheeled_pendulum()
    guess = reduced.robot.configuration({"root_joint": (0.4, -0.3, 2.0), "pitch": start, "left_axle": 1.0})
    found = rnc.equilibrium(reduced, guess)
    expected = reduced.robot.configuration({"root_joint": (0.4, -0.3, 2.0), "pitch": end, "left_axle": 1.0})
    np.testing.assert_allclose(found.q, expected, atol=1e-9)
    np.testing.assert_allclose(found.T, 0, atol=1e-9)
    check(reduced, found)


def test_an_off_centre_mass_leans_the_other_way():
    """Centre of mass above the axle: (h, d) in the body leans by -atan(d / h)."""
    reduced = wheeled_pendulum()
    model = reduced.robot.model
    joint = model.getJointId("pitch")
    inertia = model.inertias[joint]
    model.inertias[joint] = pin.Inertia(inertia.mass, inertia.lever + np.array([0.05, 0, 0]), inertia.inertia)
    found = rnc.equilibrium(reduced, reduced.robot.configuration())
    lean = reduced.robot.joint_values(found.q)["pitch"]
    assert lean == pytest.approx(-np.arctan2(0.05, inertia.lever[2]), abs=1e-9)
    check(reduced, found)


def test_one_actuator_holds_a_family_and_the_nearest_of_it_is_found():
    """An acrobot rests with its centre of mass below the shoulder: 3 sin(a) + sin(a + b) = 0."""
    reduced = acrobot()
    guess = np.array([0.2, 1.0])
    found = rnc.equilibrium(reduced, guess)
    a, b = found.q
    assert 3 * np.sin(a) + np.sin(a + b) == pytest.approx(0, abs=1e-9)
    along = np.array([np.cos(a + b), -3 * np.cos(a) - np.cos(a + b)])
    assert along @ (found.q - guess) == pytest.approx(0, abs=1e-7)  # no nearer one beside it
    check(reduced, found)
    held = rnc.equilibrium(reduced, guess, hold=["elbow"])
    assert held.q[1] == 1.0
    assert held.q[0] == pytest.approx(-np.arctan2(np.sin(1.0), 3 + np.cos(1.0)), abs=1e-9)
    check(reduced, held)


def test_what_is_fully_actuated_stays():
    reduced = ALL["tiago"]()
    q, _ = random_states(reduced, 1, seed=2)[0]
    found = rnc.equilibrium(reduced, q)
    np.testing.assert_array_equal(found.q, q)
    check(reduced, found)


def test_a_loop_is_closed_and_rests():
    reduced = four_bar()
    free = rnc.NonholonomicSystem(reduced.robot, [rnc.LoopClosure("coupler_tip", "rocker_tip", "point")]).reduce(
        [rnc.JointPosition("crank")]
    )
    guess = reduced.robot.configuration({"crank": 1.0, "coupler": -0.4, "rocker": 1.5})
    found = rnc.equilibrium(free, guess)
    assert np.abs(free.position_residual(found.q)).max() < 1e-9
    check(free, found)
    held = rnc.equilibrium(reduced, reduced.assembled(guess, hold=["crank"]), hold=["crank"])
    assert held.q[0] == pytest.approx(1.0)
    assert np.abs(held.T).max() > 0.1
    check(reduced, held)


@pytest.mark.parametrize("guess", [(2.6382, 0.1483, -2.6641), (-0.3365, -2.6001, -0.4021)])
def test_a_step_that_leads_away_is_made_shorter(guess):
    """From these an open loop overshoots: the first step is halved up to ten times."""
    reduced = four_bar()
    found = rnc.equilibrium(reduced, np.array(guess))
    assert np.abs(reduced.position_residual(found.q)).max() < 1e-9
    check(reduced, found)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda r, q: rnc.equilibrium(r, q, hold=["pitch"]), rnc.ConstraintError, "rate of 'pitch' changes by"),
        (lambda r, q: rnc.equilibrium(r, q, hold=["pich"]), rnc.ModelError, "did you mean 'pitch'"),
        (lambda r, q: rnc.equilibrium(r, q[:-1]), rnc.InputError, "q has shape"),
        (lambda r, q: rnc.equilibrium(r, np.tile(q, (2, 1))), rnc.InputError, "expected one configuration"),
        (lambda r, q: rnc.equilibrium(r, q, v2=[1.0]), rnc.InputError, "v2 has shape"),
    ],
)
def test_what_is_not_found_is_said(call, error, words):
    reduced = wheeled_pendulum()
    with pytest.raises(error, match=words) as raised:
        call(reduced, reduced.robot.configuration({"pitch": 0.3}))
    assert "\n" not in str(raised.value)


def test_a_loop_that_stays_open_is_said():
    robot = four_bar().robot
    system = rnc.NonholonomicSystem(robot, [rnc.LoopClosure("coupler_tip", "rocker_tip", "point")])
    guess = robot.configuration({"crank": 1.0, "coupler": -0.4, "rocker": 2.2})
    with pytest.raises(rnc.ConstraintError, match=r"and closure_x\(coupler_tip, rocker_tip\) is left 0\.\d+ from zero"):
        rnc.equilibrium(system.reduce([rnc.JointPosition("crank")]), guess, hold=["crank", "rocker"])
