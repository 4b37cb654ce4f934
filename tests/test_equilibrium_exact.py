"""Equilibria at their limits: what counts as rest, how far steps go, and when the search ends."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.analysis.equilibrium import _Search
from systems import four_bar
from textbook_systems import RESTING, SPEED, G, angle_of, hanging_chain, sideways_pendulum, wheeled_pendulum


def test_what_rests_to_one_part_in_ten_to_the_ten_is_left_where_it_is():
    """A little further on it is brought down; of the whole gravity, sideways too."""
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
    """Every joint held: it rests, whatever its ends do, to a nanometre."""
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


def test_two_motors_on_one_hinge_share_its_load():
    """In proportion to their gears; a hinge without one hangs."""
    reduced = hanging_chain(np.array([[0.0, 0.0], [1.0, 2.0]]), 2)
    found = rnc.equilibrium(reduced, [0.2, 1.0])
    needed = G * 0.5 * np.sin(found.q.sum())
    assert 1.5 * np.sin(found.q[0]) + 0.5 * np.sin(found.q.sum()) == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(found.T, [0.2 * needed, 0.4 * needed], rtol=1e-8)


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
    model.name = "pendulums"
    for k, mass in enumerate((1.0, 1e-14)):
        joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), f"hinge_{k}")
        inertia = pin.Inertia(mass, np.array([0.0, 0.0, -0.5]), 0.1 * mass * np.eye(3))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), []).reduce()
    found = rnc.equilibrium(reduced, [0.6, -0.9])
    np.testing.assert_allclose(found.q, 0.0, atol=1e-8)


def search_from(reduced, guess):
    guess = np.asarray(guess, float)
    return _Search(reduced, np.zeros(reduced.r), np.ones(reduced.n, dtype=bool), guess)


def test_rows_that_say_nothing_take_no_direction_away():
    """Of a pendulum on wheels without motors only the pitch matters: eight directions keep it."""
    reduced = wheeled_pendulum(())
    pitch = reduced.robot.velocity_indices("pitch").start
    search = search_from(reduced, reduced.robot.configuration({"pitch": 0.3, "root_joint": (1.0, 2.0, 0.5)}))
    step, basis = search._newton(search._at(search._guess))
    assert basis.shape == (reduced.n, reduced.n - 1)
    np.testing.assert_allclose(basis[pitch], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.delete(step, pitch), 0.0, atol=1e-9)
    assert step[pitch] == pytest.approx(-np.tan(0.3), rel=1e-9)


@pytest.mark.parametrize(
    ("step", "limited"),
    [([0.9, -0.15], [0.3, -0.05]), ([0.1, -1.2], [0.025, -0.3]), ([-0.29, 0.1], [-0.29, 0.1]), ([0.0, 0.0], [0, 0])],
)
def test_no_step_is_longer_than_three_tenths(step, limited):
    search = search_from(hanging_chain([], 2), [0.1, 0.2])
    np.testing.assert_allclose(search._limited(np.array(step)), limited, rtol=1e-14)


@pytest.fixture
def way(monkeypatch):
    """Points at which steps were computed, with these, and how many configurations were looked at."""
    seen, newton, at = {"points": [], "looks": 0}, _Search._newton, _Search._at

    def recorded(self, here):
        found = newton(self, here)
        seen["points"].append((here, found[0]))
        return found

    def counted(self, q, v2=None):
        seen["looks"] += 1
        return at(self, q, v2)

    monkeypatch.setattr(_Search, "_newton", recorded)
    monkeypatch.setattr(_Search, "_at", counted)
    return seen


@pytest.mark.parametrize("guess", [(2.6382, 0.1483, -2.6641), (-0.3365, -2.6001, -0.4021)])
def test_every_step_leads_nearer_and_is_as_long_as_it_may(way, guess):
    """Newton's, limited, and halved as long as it leads away."""
    reduced = four_bar()
    search = search_from(reduced, guess)
    end = search.any_near()
    points = [*way["points"], (end, None)]
    shorter = 0
    for (here, step), (after, _) in pairwise(points):
        assert after.left < here.left
        step = step * min(1.0, 0.3 / np.abs(step).max())
        while search._at(here.q + step).left >= here.left:
            step, shorter = step / 2, shorter + 1
        np.testing.assert_allclose(after.q, here.q + step, rtol=1e-12)
    assert shorter > 0


def test_the_search_ends_where_it_need_not_go_on(way):
    """What is held up as it stands takes one look, and one step that is none."""
    reduced, guess = hanging_chain(["hinge_0", "hinge_1"], 2), [0.4, -1.1]
    np.testing.assert_array_equal(rnc.equilibrium(reduced, guess).q, guess)
    assert (way["looks"], len(way["points"])) == (1, 1)


def test_the_search_ends_where_it_cannot_go_on(way):
    """A link that is held cannot come nearer: that is said after one step and its halves."""
    with pytest.raises(rnc.ConstraintError):
        rnc.equilibrium(hanging_chain([], 1), [0.4], hold=["hinge_0"])
    assert len(way["points"]) == 1
    assert way["looks"] < 20


def test_a_way_back_that_gets_lost_is_not_taken():
    """From here the way towards the guess wanders off what rests."""
    found = rnc.equilibrium(hanging_chain(["hinge_1", "hinge_2"]), (1.4, -2.56, -0.65))
    assert found.residual < 1e-7
