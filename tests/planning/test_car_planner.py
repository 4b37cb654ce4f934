"""Plans of several legs: which stops are tried, and which is taken."""

import re
from itertools import product

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.planning import (
    CarPath,
    car_planner,
)
from rnc_pin.planning.car_planner import _moves, plan_legs
from rnc_pin.planning.leg import Leg, best_legs


@pytest.mark.parametrize("forward_only", [False, True])
def test_moves_are_those_of_a_lattice_that_a_leg_reaches_cheapest_first(forward_only):
    moves, ways = _moves(forward_only), (1,) if forward_only else (1, -1)
    lattice = []
    degrees = product(range(-60, 61, 20), range(-120, 121, 30), ways)
    for distance, (bearing, turn, way) in product((1.2, 2, 3, 4, 5, 6, 8, 11), degrees):
        along = np.deg2rad(bearing)
        lattice.append([way * distance * np.cos(along), distance * np.sin(along), np.deg2rad(turn)])
    costs, _ = best_legs(np.zeros((len(lattice), 3)), np.array(lattice), 1.0, forward_only)
    reached, _ = best_legs(np.zeros_like(moves), moves, 1.0, forward_only)
    np.testing.assert_allclose(reached, np.sort(costs[np.isfinite(costs)]))
    there = np.array(lattice)[np.isfinite(costs)]
    ours, theirs = (np.unique(np.round(each, 9) + 0.0, axis=0) for each in (moves, there))
    np.testing.assert_allclose(ours, theirs, atol=1e-8)


def placed(pose):
    """The matrix of a pose."""
    c, n = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -n, pose[0]], [n, c, pose[1]], [0.0, 0.0, 1.0]])


def planned(start, goal, radius, forward_only):
    """Stops of the cheapest plan, by loops: each pair of a first and a last move, and what joins them."""

    def costs(first, last, samples=201):
        ends = np.broadcast_arrays(np.asarray(first), np.asarray(last))
        return best_legs(*(each.reshape(-1, 3) for each in ends), radius, forward_only, samples)[0]

    moves = _moves(forward_only) * [radius, radius, 1.0]
    after = [[*(placed(start) @ [x, y, 1.0])[:2], start[2] + turn] for x, y, turn in moves]
    before = []
    for move in moves:
        there = placed(goal) @ np.linalg.inv(placed(move))
        before.append([*there[:2, 2], goal[2] - move[2]])
    once = sorted([*after, *before], key=lambda stop: (costs(start, stop, 25) + costs(stop, goal, 25))[0])[:40]
    two = [(costs(start, stop) + costs(stop, goal))[0] for stop in once]
    few = [k for turn in range(-120, 121, 30) for k in np.flatnonzero(np.rad2deg(moves[:, 2]).round() == turn)[:13]]
    first, last = np.array(after)[few], np.array(before)[few]
    out, home = costs(start, first, 25), costs(last, goal, 25)
    pairs = np.array([out[k] + costs(stop, last, 25) + home for k, stop in enumerate(first)])
    ways = [(first[k // len(few)], last[k % len(few)]) for k in np.argsort(pairs, axis=None)[:40]]
    three = [(costs(start, a) + costs(a, b) + costs(b, goal))[0] for a, b in ways]
    plans = [(np.min(two) + 6 * radius, [once[np.argmin(two)]]), (np.min(three) + 9 * radius, ways[np.argmin(three)])]
    return min(plans, key=lambda plan: plan[0])[1]


@pytest.mark.parametrize(("goal", "legs"), [((2.6, 1.9, -2.98), 2), ((-0.7, 0.4, 0.3), 3), ((0.2, 1.3, -2.0), 3)])
def test_a_plan_goes_by_the_cheapest_stops_of_the_lattice(goal, legs):
    start, goal = np.array([0.3, -0.2, 0.4]), np.array(goal)
    found = plan_legs(start, goal, 0.45, True)
    np.testing.assert_allclose([leg.goal for leg in found[:-1]], planned(start, goal, 0.45, True), atol=1e-9)
    np.testing.assert_array_equal(found[-1].goal, goal)
    assert len(found) == legs


@pytest.mark.parametrize("saved", [2.9, 3.1])
def test_one_more_stop_has_to_save_three_turning_radii(monkeypatch, saved):
    radius, two, three = 0.4, [Leg(np.zeros(3), np.ones(3), 0.0)] * 2, [Leg(np.ones(3), np.zeros(3), 0.0)] * 3
    offers = iter([None, (10.0, two), (10.0 - saved * radius, three)])
    monkeypatch.setattr(car_planner, "_joined", lambda *stops, radius, forward_only: next(offers))
    assert plan_legs(np.zeros(3), np.array([0.0, 1.0, 0.0]), radius) is (two if saved < 3 else three)


@pytest.mark.parametrize(
    ("forward_only", "legs", "advice"),
    [(True, "forward legs", "allow more steering or backing up"), (False, "legs", "allow more steering")],
)
def test_a_plan_that_is_not_found_says_what_was_asked_and_what_may_help(monkeypatch, forward_only, legs, advice):
    monkeypatch.setattr(car_planner, "_moves", lambda forward_only: np.array([[1.5, 0.0, 0.0]]))
    words = (
        f"no path of at most three {legs} is found from (1.23, -2, 40 deg) to (1.5, 0.346, 220 deg) with turns of "
        f"at least 1.23 m: {advice}, or give poses to go by"
    )
    start, goal = np.array([1.2345, -2.0, np.deg2rad(40.2)]), np.array([1.5, 0.34567, np.deg2rad(219.7)])
    with pytest.raises(rnc.InfeasibleError, match=f"^{re.escape(words)}$"):
        plan_legs(start, goal, 1.23456, forward_only)


def test_the_same_pose_is_refused_and_one_beside_it_is_not():
    start = np.array([1.0, 2.0, 0.3])
    for turn in (0.0, 2 * np.pi, -4 * np.pi):
        with pytest.raises(rnc.ConfigurationError, match="start and goal of the path are the same pose"):
            plan_legs(start, start + np.array([0, 0, turn]), 1.0)
    assert len(plan_legs(start, start + np.array([0, 0, np.pi]), 1.0)) > 1
    assert len(plan_legs(start, start + np.array([0.0, 0.5, 0.0]), 1.0)) > 1


@pytest.mark.parametrize(
    ("goal", "forward_only"),
    [((0.2, 1.1, 0.3), False), ((-0.4, 0.7, 2.8), False), ((0.1, -0.9, -1.2), True)],
)
def test_a_plan_is_the_same_in_a_mirror_and_in_any_size(goal, forward_only):
    """Several legs: left is right, and of a car of a hundred times the size all is a hundred times as long."""
    start, goal = np.zeros(3), np.array(goal)
    legs = plan_legs(start, goal, 0.5, forward_only)
    assert len(legs) > 1
    whole = sum(leg.length for leg in legs)
    mirrored = plan_legs(start, goal * [1, -1, -1], 0.5, forward_only)
    assert sum(leg.length for leg in mirrored) == pytest.approx(whole, rel=1e-9)
    large = plan_legs(start, goal * [100, 100, 1], 50.0, forward_only)
    for leg, other in zip(legs, large, strict=True):
        np.testing.assert_allclose(other.goal, leg.goal * [100, 100, 1], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("radius", "apart", "same"), [(0.5, 4e-7, True), (500.0, 4e-4, True), (0.5, 4e-6, False)])
def test_a_pose_is_the_same_to_a_millionth_of_the_turning_radius(radius, apart, same):
    start, goal = np.zeros(3), np.array([0.0, apart, 0.0])
    if same:
        with pytest.raises(rnc.ConfigurationError, match="are the same pose"):
            plan_legs(start, goal, radius)
    else:
        assert plan_legs(start, goal, radius)


def test_a_heading_is_the_same_to_two_billionths_of_a_radian():
    start = np.array([1.0, 2.0, 0.3])
    with pytest.raises(rnc.ConfigurationError, match="are the same pose"):
        plan_legs(start, start + np.array([0.0, 0.0, 1.5e-9]), 1.0)
    assert len(plan_legs(start, start + np.array([0.0, 0.0, 3e-9]), 1.0)) > 1


def test_a_car_backs_up_unless_told_not_to():
    (leg,) = plan_legs(np.zeros(3), np.array([-3.0, 0.0, 0.0]), 0.5)
    assert leg.length == pytest.approx(3.0)
    assert len(CarPath(np.zeros(3), (-3.0, 0.0, 0.0), 2.0, 1.0).legs) == 1
    assert len(CarPath(np.zeros(3), (4.0, 0.0, 0.0), 2.0, 1.0, max_steering=0.02).legs) == 1
