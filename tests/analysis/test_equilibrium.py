"""Equilibria: against closed forms, under constraints, with few actuators."""

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg
import scipy.optimize

import rnc_pin as rnc
import systems
from bodies import add_body
from rnc_pin.analysis.equilibrium import _Search
from systems import four_bar
from textbook_systems import RESTING, SPEED, G, acrobot, angle_of, hanging_chain, sideways_pendulum, wheeled_pendulum


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
    assert (held.q[1], held.q[0]) == (1.0, pytest.approx(-np.arctan2(np.sin(1.0), 3 + np.cos(1.0)), abs=1e-9))
    check(reduced, held)


def test_a_loop_is_closed_and_rests():
    reduced = four_bar()
    free = rnc.NonholonomicSystem(reduced.robot, [rnc.LoopClosure("coupler_tip", "rocker_tip", "point")]).reduce(
        [rnc.JointPosition("crank")]
    )
    guess = reduced.robot.configuration({"crank": 1.0, "coupler": -0.4, "rocker": 1.5})
    found = rnc.equilibrium(free, guess)
    assert np.abs(free.assembly.residual(found.q)).max() < 1e-9
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
    assert np.abs(reduced.assembly.residual(found.q)).max() < 1e-9
    check(reduced, found)


@pytest.mark.parametrize(("call", "error", "words"), [
    (lambda r, q: rnc.equilibrium(r, q, hold=["pitch"]), rnc.ConstraintError, "rate of 'pitch' changes by"),
    (lambda r, q: rnc.equilibrium(r, q, hold=["pich"]), rnc.ModelError, "did you mean 'pitch'"),
    (lambda r, q: rnc.equilibrium(r, q[:-1]), rnc.InputError, "q has shape"),
    (lambda r, q: rnc.equilibrium(r, np.tile(q, (2, 1))), rnc.InputError, "expected one configuration"),
    (lambda r, q: rnc.equilibrium(r, q, v2=[1.0]), rnc.InputError, "v2 has shape"),
])  # fmt: skip
def test_what_is_not_found_is_said(call, error, words):
    reduced = wheeled_pendulum()
    with pytest.raises(error, match=words) as raised:
        call(reduced, reduced.robot.configuration({"pitch": 0.3}))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("guess", "hold"), [((0.5, 0.9, -0.4), ()), ((-0.6, 0.3, 1.4), ()), ((0.5, 0.9, -0.4), (1,))])
def test_of_a_surface_of_equilibria_the_nearest_is_found(guess, hold):
    """A chain with a free first hinge rests with its centre of mass below that: the rest is a constrained minimum."""
    reduced = hanging_chain(["hinge_1", "hinge_2"])
    found = rnc.equilibrium(reduced, guess, hold=[f"hinge_{k}" for k in hold])

    def across(q):
        return np.array([2.5, 1.5, 0.5]) @ np.sin(np.cumsum(q))

    kept = [{"type": "eq", "fun": lambda q, k=k: q[k] - guess[k]} for k in hold]
    expected = scipy.optimize.minimize(
        lambda q: np.sum((q - guess) ** 2), guess, constraints=[{"type": "eq", "fun": across}, *kept],
        options={"ftol": 1e-14}, method="SLSQP",
    )  # fmt: skip
    np.testing.assert_allclose(found.q, expected.x, atol=1e-5)
    np.testing.assert_allclose(across(found.q), 0, atol=1e-9)
    q = np.cumsum(found.q)  # weights below a hinge, with their levers
    expected_T = [G * (1.5 * np.sin(q[1]) + 0.5 * np.sin(q[2])), G * 0.5 * np.sin(q[2])]
    np.testing.assert_allclose(found.T, expected_T, atol=1e-8)


def test_of_inputs_that_hold_the_smallest_are_taken():
    B = np.array([[1.0, 0.5, -2.0], [0.0, 1.0, 3.0]])
    reduced = hanging_chain(B, 2)
    found = rnc.equilibrium(reduced, [0.4, -1.1])
    np.testing.assert_array_equal(found.q, [0.4, -1.1])
    needed = G * np.array([1.5 * np.sin(0.4) + 0.5 * np.sin(-0.7), 0.5 * np.sin(-0.7)])
    np.testing.assert_allclose(found.T, np.linalg.pinv(B) @ needed, atol=1e-9)
    assert found.residual < 1e-9


def driven_bicycle():
    """One that nothing keeps upright."""
    robot = systems.bicycle().robot
    wheels = [rnc.RollingWheel("rear", 0.3), rnc.RollingWheel("front", 0.3)]
    return rnc.NonholonomicSystem(robot, wheels, ["rear_wheel"]).reduce()


@pytest.mark.parametrize("make", [
    wheeled_pendulum, lambda: hanging_chain(["hinge_1", "hinge_2"]), systems.four_bar, driven_bicycle,
], ids=["pendulum on wheels", "chain", "four-bar", "bicycle"])  # fmt: skip
def test_a_step_towards_an_equilibrium_is_that_of_newton(make):
    """Far from one, moving, loops open: forces that inputs do not reach vanish to first order, and so do gaps."""
    reduced = make()
    model, generator = reduced.robot.model, np.random.default_rng(5)
    q = reduced.robot.random_configuration(generator, 0.4)
    v2, free = 0.6 * generator.normal(size=reduced.r), np.ones(reduced.n, dtype=bool)
    free[-1] = False
    search = _Search(reduced, v2, free, q, None, np.zeros(reduced.r, dtype=bool))
    here = search._at(q, v2)
    state = reduced.at(q, v2)
    scale = 1 / np.sqrt(np.diag(state.H))
    influence = scale[:, None] * state.input_matrix
    np.testing.assert_allclose(influence.T @ here.force, 0, atol=1e-9)  # T leaves the least
    np.testing.assert_allclose(here.force, scale * (state.H @ here.v2_dot), atol=1e-9)
    np.testing.assert_allclose(here.v2_dot, reduced.forward_dynamics(q, v2, here.T), atol=1e-9)
    step, basis = search._newton(here)
    unreached = scipy.linalg.null_space(influence.T)

    def left(p):
        moved = reduced.at(p, v2)
        force = unreached.T @ (scale * (moved.H @ moved.v2_dot(here.T)))
        return np.concatenate([force, reduced.assembly.residual(p)[reduced.assembly.leading]])

    assert np.abs(left(q)).max() > 0.1
    h = 1e-5

    def along(way):
        return (left(pin.integrate(model, q, h * way)) - left(pin.integrate(model, q, -h * way))) / (2 * h)

    np.testing.assert_allclose(along(step), -left(q), atol=1e-5 * (1 + np.abs(left(q)).max()))
    assert step[-1] == 0.0
    np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-12)
    for way in basis.T:
        np.testing.assert_allclose(along(way), 0, atol=1e-5)
    assert basis.shape[1] == reduced.n - 1 - len(left(q))
    np.testing.assert_allclose(basis.T @ step, 0, atol=1e-9)  # no longer than it has to be


def test_what_rests_to_one_part_in_ten_to_the_ten_is_left_where_it_is():
    reduced = sideways_pendulum()
    near, far = (np.array([share * angle_of(1e-10 * RESTING)]) for share in (0.97, 1.03))
    np.testing.assert_array_equal(rnc.equilibrium(reduced, near).q, near)
    found = rnc.equilibrium(reduced, far)
    assert abs(found.q[0]) < 1e-3 * far[0]
    assert found.residual < 1e-3 * 0.35 * 1e-10 * RESTING


def test_one_part_in_ten_to_the_nine_is_accepted_where_nothing_can_move():
    reduced = sideways_pendulum()
    near, far = (np.array([share * angle_of(1e-9 * RESTING)]) for share in (0.97, 1.03))
    np.testing.assert_array_equal(rnc.equilibrium(reduced, near, ["hinge_0"]).q, near)
    with pytest.raises(rnc.ConstraintError, match=r"rate of 'hinge_0' changes by -1\.13e-09 a second$"):
        rnc.equilibrium(reduced, far, ["hinge_0"])


def test_a_hinge_that_turns_under_gravity_is_no_steady_motion():
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.equilibrium(sideways_pendulum(), [0.0], v2=[SPEED])
    assert str(told.value) == (
        "no steady motion found near the guess: at best the shape variable 'hinge_0' moves by 0.7 a second"
    )


@pytest.mark.parametrize(("gap", "closed"), [(0.97e-9, True), (1.03e-9, False), (2e-3, False)])
def test_a_loop_that_a_motor_holds_has_to_be_closed(gap, closed):
    reduced = four_bar()
    robot = reduced.robot
    q = reduced.assembled(robot.configuration({"crank": 1.0, "coupler": -0.4, "rocker": 1.5}), hold=["crank"])
    data, step = robot.model.createData(), 1e-6

    def ends(rocker):
        p = np.array([q[0], q[1], q[2] + rocker])
        pin.framesForwardKinematics(robot.model, data, p)
        first, second = (data.oMf[robot.frame_id(name)] for name in ("coupler_tip", "rocker_tip"))
        return p, np.abs(first.rotation.T @ (second.translation - first.translation)).max()

    open_q, found = ends(gap * step / ends(step)[1])
    if gap < 1e-6:
        assert found == pytest.approx(gap, rel=1e-3)
    if closed:
        np.testing.assert_array_equal(rnc.equilibrium(reduced, open_q, robot.joint_names).q, open_q)
        return
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.equilibrium(reduced, open_q, robot.joint_names)
    assert "closure_" in str(told.value)
    assert str(told.value).endswith(f"(coupler_tip, rocker_tip) is left {found:.3g} from zero")


@pytest.mark.parametrize(("gear", "holds"), [(1e-8, True), (1e-12, False)])
def test_a_motor_without_strength_is_none(gear, holds):
    reduced = hanging_chain(np.diag([1.0, gear]), 2)
    guess = np.array([0.9, -0.4])
    found = rnc.equilibrium(reduced, guess)
    if holds:
        np.testing.assert_array_equal(found.q, guess)
        assert found.T[1] == pytest.approx(0.5 * G * np.sin(0.5) / gear, rel=1e-6)
    else:  # the second link hangs down
        assert found.q.sum() == pytest.approx(0, abs=1e-9)


def test_a_grain_of_dust_hangs_too():
    """Its forces are ten million times smaller than those of the other pendulum, in roots of the inertias."""
    model = pin.Model()
    for k, mass in enumerate((1.0, 1e-14)):
        add_body(model, f"hinge_{k}", "RY", mass, com=(0.0, 0.0, -0.5), moments=0.1 * mass)
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), []).reduce()
    found = rnc.equilibrium(reduced, [0.6, -0.9])
    np.testing.assert_allclose(found.q, 0.0, atol=1e-8)


def search_from(reduced, guess):
    guess = np.asarray(guess, float)
    known = np.zeros(reduced.r, dtype=bool)
    return _Search(reduced, np.zeros(reduced.r), np.ones(reduced.n, dtype=bool), guess, None, known)


def test_rows_that_say_nothing_take_no_direction_away():
    """Of a pendulum on wheels without motors only the pitch matters: eight directions keep it."""
    reduced = wheeled_pendulum(())
    pitch = reduced.robot.velocity_indices("pitch").start
    search = search_from(reduced, reduced.robot.configuration({"pitch": 0.3, "root_joint": (1.0, 2.0, 0.5)}))
    step, basis = search._newton(search._at(search._guess, search._v2))
    assert basis.shape == (reduced.n, reduced.n - 1)
    np.testing.assert_allclose(basis[pitch], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.delete(step, pitch), 0.0, atol=1e-9)
    assert step[pitch] == pytest.approx(-np.tan(0.3), rel=1e-9)


@pytest.mark.parametrize(("step", "limited"), [
    ([0.9, -0.15], [0.3, -0.05]), ([0.1, -1.2], [0.025, -0.3]), ([-0.29, 0.1], [-0.29, 0.1]), ([0.0, 0.0], [0, 0]),
])  # fmt: skip
def test_no_step_is_longer_than_three_tenths(step, limited):
    search = search_from(hanging_chain([], 2), [0.1, 0.2])
    np.testing.assert_allclose(search._limited(np.array(step)), limited, rtol=1e-14)
