"""Commands beside closed forms: numbers, signs and thresholds that runs alone do not tell."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.control import UnicycleStabilizer
from rnc_pin.control.unicycle_stabilizer import DrivingState
from rnc_pin.model.evaluation_results import Measurement
from tolerances import ROUNDING

GOAL = np.array([0.4, -0.7, 2.0])
WHERE = np.array([2, 0])  # x and y in x1, neither first nor in order


def unicycle(**settings):
    fast = {"k": 0.5, "rate": 1.5, "ramp_time": 0.0, "max_speed": (1e9, 1e9)}
    return UnicycleStabilizer(GOAL, WHERE, **{**fast, **settings})


def seen(x, y, turn, v2=(0.0, 0.0)):
    """A pose in the goal's axes, as it is measured: x1 has an entry of somebody else's."""
    c, s = np.cos(GOAL[2]), np.sin(GOAL[2])
    x1 = np.array([GOAL[1] + s * x + c * y, np.nan, GOAL[0] + c * x - s * y])
    return Measurement(x1=x1, x2=np.array([np.nan, GOAL[2] + turn]), v2=np.array(v2))


def angle(value):
    return float(np.angle(np.exp(1j * value)))


def law(x, y, turn, backwards, k, rate):
    """(v, w) of the docstring: backwards the vehicle and its goal are turned round, and the speed changes sign."""
    about = np.pi if backwards else 0.0
    e, bearing = np.hypot(x, y), np.arctan2(-y, -x)
    alpha, theta = angle(bearing - turn - about), angle(bearing - about)
    h, c = 1.2 * rate**2 / k**2, 2.2 * rate
    speed = k * e * np.cos(alpha)
    turning = c * alpha + k * np.cos(alpha) * np.sinc(alpha / np.pi) * (alpha + h * theta)
    return np.array([-speed if backwards else speed, turning]), alpha**2 + h * theta**2


@pytest.mark.parametrize("backwards", [False, True])
def test_a_unicycle_is_asked_for_what_the_law_says(backwards):
    """Without limits, at poses of all bearings; its rate along any motion is that of the closed form."""
    k, rate, step = 0.7, 1.9, 1e-5
    stabilizer = unicycle(k=k, rate=rate)
    for x, y, turn, *v2 in np.random.default_rng(3).uniform(-1.5, 1.5, (25, 5)):
        state = DrivingState(0.0, False, backwards)
        desired, cost = law(x, y, turn, backwards, k, rate)
        if law(x, y, turn, not backwards, k, rate)[1] < 0.5 * cost:
            continue  # it turns about
        target, after = stabilizer.step(5.0, seen(x, y, turn, v2), state)
        assert after == state
        np.testing.assert_allclose(target.v2, desired, rtol=1e-9)
        moved = [
            law(x + s * v2[0] * np.cos(turn), y + s * v2[0] * np.sin(turn), turn + s * v2[1], backwards, k, rate)[0]
            for s in (-2 * step, -step, step, 2 * step)
        ]
        slope = (moved[0] - 8 * moved[1] + 8 * moved[2] - moved[3]) / (12 * step)
        np.testing.assert_allclose(target.v2_dot, slope, atol=1e-6 * (1 + np.abs(slope).max()))


@pytest.mark.parametrize("alpha", [9e-4, -9e-4, 1.1e-3, 0.0])
def test_a_unicycle_that_heads_for_its_goal_has_no_gap_in_its_law(alpha):
    """Next to the line of sight quotients are series: the exact ones, and the line of sight seen from aside."""
    theta, e, k, rate = 0.3, 2.0, 0.5, 1.5
    x, y, turn = -e * np.cos(theta), -e * np.sin(theta), theta - alpha
    speed, spin = 0.4, 0.8
    target, _ = unicycle(k=k, rate=rate).step(1.0, seen(x, y, turn, (speed, spin)), DrivingState(0.0, False, False))
    h, c, double = 1.2 * rate**2 / k**2, 2.2 * rate, 2 * alpha
    share = 1 - double**2 / 6 + double**4 / 120  # sin(2 alpha) / (2 alpha)
    slope = 2 * (-double / 3 + double**3 / 30)
    lean, theta_dot = alpha + h * theta, speed * np.sin(alpha) / e
    alpha_dot = theta_dot - spin
    np.testing.assert_allclose(target.v2, [k * e * np.cos(alpha), c * alpha + k * share * lean], rtol=1e-10)
    asked = c * alpha_dot + k * (slope * alpha_dot * lean + share * (alpha_dot + h * theta_dot))
    driven = k * (-speed * np.cos(alpha) ** 2 - e * np.sin(alpha) * alpha_dot)
    np.testing.assert_allclose(target.v2_dot, [driven, asked], rtol=1e-8)


def test_a_unicycle_slows_its_whole_motion_down_to_its_limits():
    """By one factor, so that its path is the one without limits; the rate is exact there too."""
    free, held, step = unicycle(), unicycle(max_speed=(0.3, 0.7)), 1e-5
    state = DrivingState(0.0, False, False)
    low, high = [-1.5, -0.2, -0.4, -1, -1], [-0.2, 0.2, 0.4, 1, 1]
    for x, y, turn, speed, spin in np.random.default_rng(4).uniform(low, high, (8, 5)):
        at = [
            seen(x + s * speed * np.cos(turn), y + s * speed * np.sin(turn), turn + s * spin, (speed, spin))
            for s in (0, -step, step)
        ]
        (v, w), target = free.step(1.0, at[0], state)[0].v2, held.step(1.0, at[0], state)[0]
        factor = np.sqrt(1 + (v / 0.3) ** 2 + (w / 0.7) ** 2)
        np.testing.assert_allclose(target.v2, [v / factor, w / factor], rtol=1e-12)
        behind, ahead = (held.step(1.0, each, state)[0].v2 for each in at[1:])
        np.testing.assert_allclose(target.v2_dot, (ahead - behind) / (2 * step), atol=1e-6)


def test_a_unicycle_takes_up_speed_softly():
    """In proportion to the time since it set out, until that is over; what it asks for then is the law's alone."""
    soft, at_once = unicycle(ramp_time=0.75), unicycle()
    here, state = seen(-1.0, 0.3, 0.2, (0.3, -0.4)), DrivingState(2.0, False, False)
    full = at_once.step(2.0, here, state)[0]
    for share in (0.0, 0.25, 0.5, 0.999):
        target, _ = soft.step(2.0 + 0.75 * share, here, state)
        np.testing.assert_allclose(target.v2, share * full.v2, atol=ROUNDING)
        np.testing.assert_allclose(target.v2_dot, share * full.v2_dot + full.v2 / 0.75, atol=ROUNDING)
    for t in (2.75, 2.751, 9.0):
        target, _ = soft.step(t, here, state)
        np.testing.assert_array_equal(target.v2, full.v2)
        np.testing.assert_array_equal(target.v2_dot, full.v2_dot)
    assert np.abs(full.v2_dot).min() > 0.01


def test_a_unicycle_waits_until_it_may_begin():
    """At that time and not before; what it aims at is said all the while, in the places that are its own."""
    stabilizer, here = unicycle(begin=1.5, ramp_time=1.0), seen(-1.0, 0.3, 0.2)
    state = stabilizer.initial_state(here)
    assert np.array_equal(state, [np.nan, False, False], equal_nan=True)
    for t, since in ((0.0, np.nan), (1.499, np.nan), (1.5, 1.5), (2.0, 1.5)):
        target, state = stabilizer.step(t, here, state)
        assert np.array_equal(state, [since, False, False], equal_nan=True)
        assert target.v2.shape == target.v2_dot.shape == (2,)
        assert (target.v2.any(), target.v2_dot.any()) == (t > 1.5, np.isfinite(since))
        np.testing.assert_array_equal(target.x1, [GOAL[1], np.nan, GOAL[0]])
        np.testing.assert_array_equal(target.x2, [np.nan, GOAL[2]])
    assert stabilizer.describe() == {
        "type": "UnicycleStabilizer", "goal": GOAL.tolist(), "begin": 1.5, "k": 0.5, "rate": 1.5, "tolerance": 2e-3,
        "ramp_time": 1.0, "max_speed": [1e9, 1e9],
    }  # fmt: skip


@pytest.mark.parametrize("backwards", [False, True])
def test_a_unicycle_rests_below_its_limit_and_wakes_at_twice_that(backwards):
    """Distance, heading and motion each; pushed away it sets out again at that time, the way its goal lies."""
    stabilizer = unicycle(tolerance=0.01, ramp_time=1.0)
    drives, rests = (DrivingState(*each, backwards) for each in ((0.0, False), (3.0, True)))
    for size in (0.0099, 0.0101):
        here, rest = (0.0, 0.0, 0.0), size < 0.01
        for at in (
            *(seen(0.6 * size, 0.8 * size, 0.0), seen(0.0, 0.0, -size)),
            *(seen(*here, (0.0, -size)), seen(*here, (size, 0.0))),
        ):
            target, state = stabilizer.step(4.0, at, drives)
            assert (state.resting, state.since) == (rest, 4.0 if rest else 0.0)
            if rest:
                assert (state.backwards, target.v2.any(), target.v2_dot.any()) == (backwards, False, False)
    for x, y, turn in ((0.0199, 0.0, 0.0), (0.0, -0.0199, 0.0), (0.0, 0.0, 0.0199)):
        target, state = stabilizer.step(5.0, seen(x, y, turn, (0.02, 0.0)), rests)
        assert state == rests
        assert not target.v2.any()
    for x in (0.0201, -0.0201):
        target, state = stabilizer.step(5.0, seen(x, 0.0, 0.0), rests)
        assert state == (5.0, False, x > 0)
        np.testing.assert_allclose(target.v2_dot, [-0.5 * x, 0.0], atol=ROUNDING)  # the law's k e, taken up in a second


def test_a_unicycle_turns_about_where_that_halves_what_its_angles_cost():
    """Of a cost of both angles, each with its weight, by the ratio of the law."""
    stabilizer, tried = unicycle(), set()
    for x, y, turn in np.random.default_rng(6).uniform(-3, 3, (40, 3)):
        costs = [law(x, y, turn, way, 0.5, 1.5)[1] for way in (False, True)]
        first = stabilizer.step(1.0, seen(x, y, turn), DrivingState(np.nan, False, False))[1]
        assert first == (1.0, False, costs[1] < costs[0])
        for way in (False, True):
            state = stabilizer.step(1.0, seen(x, y, turn), DrivingState(0.0, False, way))[1]
            assert state == (0.0, False, way != (costs[not way] < 0.5 * costs[way]))
            tried.add(bool(state.backwards != way))
    assert tried == {False, True}


@pytest.mark.parametrize("backwards", [False, True])
def test_a_unicycle_at_its_goal_turns_only(backwards):
    stabilizer, state = unicycle(tolerance=0.1), DrivingState(0.0, False, backwards)
    for turn in (0.5, -0.5):
        target, _ = stabilizer.step(1.0, seen(0.03, 0.0396, turn, (0.2, 0.3)), state)
        share = np.cos(turn) * np.sinc(turn / np.pi)
        np.testing.assert_allclose(target.v2, [0.0, -(3.3 + 0.5 * share) * turn], atol=ROUNDING)
        ahead, behind = (-(3.3 + 0.5 * np.cos(b) * np.sinc(b / np.pi)) * b for b in (turn + 1e-5, turn - 1e-5))
        np.testing.assert_allclose(target.v2_dot[1], 0.3 * (ahead - behind) / 2e-5, atol=1e-7)
        assert target.v2_dot[0] == pytest.approx(-0.5 * 0.2 * np.cos(turn) ** 2)


@pytest.mark.parametrize(("settings", "words"), [
    ({"k": 0.0}, "needs 0 < k < rate, found 0 and 1"),
    ({"k": 1.0}, "needs 0 < k < rate, found 1 and 1"),
    ({"tolerance": 0.0}, r"found 0, 1 and \(1.0, 1.0\)"),
    ({"ramp_time": -1e-9}, r"found 0.002, -1e-09 and \(1.0, 1.0\)"),
    ({"max_speed": (0.0, 1.0)}, r"found 0.002, 1 and \(0.0, 1.0\)"),
])  # fmt: skip
def test_a_unicycle_at_the_edge_of_what_makes_sense(settings, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        UnicycleStabilizer(GOAL, WHERE, **settings)
    least = {"k": 1e-9, "ramp_time": 0.0, "tolerance": 1e-9, "max_speed": (1e-9, 1e-9)}
    assert UnicycleStabilizer(GOAL, WHERE, **least).ramp_time == 0.0
    with pytest.raises(rnc.InputError, match="position and heading have to be given"):
        unicycle().initial_state(seen(0.0, np.nan, 0.0))


SPECIAL = [(0, 1, 0), (0, 0, 3.1), (1, 0, np.pi), (-1, 0, 1.5707), (-2, 1e-9, np.pi), (0, 1e-9, 1.5707), (0, 0.01, 0)]


@pytest.mark.parametrize("start", [*SPECIAL, *np.random.default_rng(1).uniform(-3, 3, (3, 3))])
def test_a_unicycle_arrives_in_x_y_and_heading_from_anywhere(start):
    """Abeam, turned round, on the spot: arcs at the velocities asked for, never faster than its limits."""
    stabilizer, dt = UnicycleStabilizer(GOAL, WHERE, max_speed=(0.8, 0.6)), 0.02
    pose, v2, state, asked = np.array(start, dtype=float), np.zeros(2), None, []
    for sample in range(1300):
        measured = seen(*pose, v2)
        state = stabilizer.initial_state(measured) if state is None else state
        target, state = stabilizer.step(sample * dt, measured, state)
        v2, half = target.v2, target.v2[1] * dt / 2
        way = dt * v2[0] * np.sinc(half / np.pi)
        pose += np.array([way * np.cos(pose[2] + half), way * np.sin(pose[2] + half), 2 * half])
        asked.append(v2)
    assert state.resting
    assert np.hypot(*pose[:2]) < stabilizer.tolerance
    assert abs(angle(pose[2])) < stabilizer.tolerance
    assert (np.abs(asked).max(axis=0) < (0.8, 0.6)).all()
