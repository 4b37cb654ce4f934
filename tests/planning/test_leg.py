"""Legs of a car path: curves, costs and limits."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from polynomials import in_axes, powers
from rnc_pin.planning import MinimumJerk
from rnc_pin.planning.leg import Leg, best_legs


def test_the_cost_of_a_leg_is_that_of_the_curve():
    """``integral of 1 + (radius curvature)^2`` over the curve as it is driven, curvature by differences of heading."""
    start, goal, radius = np.array([0.0, 0.0, 0.3]), np.array([6.0, 2.5, -0.2]), 1.2
    (cost,), (chart,) = best_legs(start[None], goal[None], radius)
    _, poses, _, steering = Leg(start, goal, chart).drive(4.0, 1.0, 40_001)
    lengths = np.array([np.hypot(*(b - a)[:2]) for a, b in pairwise(poses)])
    bent = lengths > 1e-7  # it starts and ends at rest
    curvature = np.diff(poses[:, 2])[bent] / lengths[bent]
    assert cost == pytest.approx(np.sum(lengths[bent] * (1 + (radius * curvature) ** 2)), rel=1e-3)
    assert cost > 1.05 * lengths.sum()
    middle = (0.5 * (steering[1:] + steering[:-1]))[bent]
    np.testing.assert_allclose(np.tan(middle), curvature, atol=1e-4)  # of a wheelbase of 1 m


STEEPEST = np.tan(np.deg2rad(75.0))


def cheapest_leg(start, goal, radius, forward_only, samples):
    """Cost and axes, one pose, one chart and one condition at a time."""
    turn = np.arctan2(np.sin(goal[2] - start[2]), np.cos(goal[2] - start[2]))
    room, s, best = np.deg2rad(75.0) - abs(turn) / 2, np.linspace(0, 1, samples), (np.inf, 0.0)
    for part in (0.0, -0.25, 0.25, -0.5, 0.5, -0.8, 0.8) if room > 0 else ():
        chart = start[2] + turn / 2 + part * room
        dx, quintic = in_axes(start, goal, chart)
        slope, bend = powers(s, 1) @ quintic / dx, powers(s, 2) @ quintic / dx**2
        curvature = bend / (1 + slope**2) ** 1.5
        if (forward_only and dx < 0) or np.abs(slope).max() > STEEPEST or np.abs(radius * curvature).max() > 0.99:
            continue
        cost = abs(dx) * np.trapezoid(np.sqrt(1 + slope**2) * (1 + (radius * curvature) ** 2), s)
        best = min(best, (cost, chart))
    return best


@pytest.mark.parametrize(("forward_only", "samples", "radius"), [(False, 201, 0.7), (True, 25, 0.7), (False, 25, 0.02)])
def test_the_best_leg_is_the_cheapest_of_seven_charts(forward_only, samples, radius):
    generator = np.random.default_rng(4)
    starts = generator.uniform([-2, -2, -9], [2, 2, 9], (150, 3))
    x, y, turn = (generator.uniform([0.5, -3, -1.8], [6, 3, 1.8], (150, 3)) * generator.choice([-1, 1], (150, 1))).T
    c, n = np.cos(starts[:, 2]), np.sin(starts[:, 2])
    goals = starts + np.column_stack([c * x - n * y, n * x + c * y, turn])
    options = {} if samples == 201 else {"samples": samples}
    costs, charts = best_legs(starts, goals, radius, forward_only, **options)
    pairs = zip(starts, goals, strict=True)
    expected = np.array([cheapest_leg(a, b, radius, forward_only, samples) for a, b in pairs])
    found = np.isfinite(costs)
    assert 20 < found.sum() < 149
    parts = np.abs(charts - starts[:, 2] - (goals - starts)[:, 2] / 2)[found]
    assert (parts > 0.1).sum() > 10  # more than the first of the charts is used
    np.testing.assert_allclose(costs, expected[:, 0], rtol=1e-10)
    np.testing.assert_allclose(charts, expected[:, 1], rtol=1e-10)


@pytest.mark.parametrize("way", [1, -1])
def test_a_leg_is_longer_than_a_millionth_of_the_turning_radius(way):
    goals = np.array([[1.9e-6, 0.0, 0.0], [2.1e-6, 0.0, 0.0]]) * way
    costs, _ = best_legs(np.zeros((2, 3)), goals, 2.0)
    np.testing.assert_allclose(costs, [np.inf, 2.1e-6], rtol=1e-6)


def test_a_leg_is_driven_as_its_quintic_says():
    """Flatness by hand: heading, speed and steering of y(x), with x by the minimum-jerk law."""
    start, goal, chart = np.array([1.0, -2.0, 0.4 + 4 * np.pi]), np.array([-2.5, -1.4, -0.3]), 0.25
    leg, wheelbase, duration = Leg(start, goal, chart), 1.7, 2.5
    dx, quintic = in_axes(start, goal, chart)
    times, poses, speeds, steering = leg.drive(duration, wheelbase, 9)
    np.testing.assert_allclose(times, np.arange(9) * duration / 8)
    u = np.arange(9) / 8
    s, s_dot = 10 * u**3 - 15 * u**4 + 6 * u**5, 30 * (u - u**2) ** 2 / duration
    y, slope, bend = (powers(s, order) @ quintic / dx**order for order in range(3))
    c, n = np.cos(chart), np.sin(chart)
    np.testing.assert_allclose(poses[:, 0], 1.0 + c * dx * s - n * y, atol=1e-10)
    np.testing.assert_allclose(poses[:, 1], -2.0 + n * dx * s + c * y, atol=1e-10)
    np.testing.assert_allclose(poses[:, 2], 4 * np.pi + chart + np.arctan(slope), atol=1e-10)
    np.testing.assert_allclose(speeds, dx * s_dot * np.hypot(1, slope), atol=1e-10)
    curvature = bend / np.hypot(1, slope) ** 3
    np.testing.assert_allclose(steering, np.arctan(wheelbase * curvature), atol=1e-10)
    length, _ = quad(lambda x: np.hypot(1, (powers([x], 1) @ quintic / dx).item()), 0, 1)
    assert leg.length == pytest.approx(abs(dx) * length, rel=1e-5)


def test_a_straight_leg_costs_its_length_in_the_direction_that_it_is_driven():
    for heading in (0.0, 2.0, -3.0):
        along = np.array([np.cos(heading), np.sin(heading), 0.0])
        start = np.array([1.0, -2.0, heading])
        for way, forward_only, cost in ((3.0, False, 3.0), (3.0, True, 3.0), (-3.0, False, 3.0), (-3.0, True, np.inf)):
            costs, charts = best_legs(start[None], (start + way * along)[None], 0.5, forward_only)
            np.testing.assert_allclose(costs, [cost])
            if np.isfinite(cost):
                leg = Leg(start, start + way * along, charts[0])
                assert leg.length == pytest.approx(3.0)
                times, poses, speeds, steering = leg.drive(2.0, 1.0, 5)
                np.testing.assert_allclose(times, [0.0, 0.5, 1.0, 1.5, 2.0])
                s = MinimumJerk([0.0], [way], 2.0)
                moved = np.array([s.at(t).position for t in times]) * along
                np.testing.assert_allclose(poses, start + moved, atol=1e-12)
                np.testing.assert_allclose(speeds, [s.at(t).velocity[0] for t in times], atol=1e-12)
                np.testing.assert_allclose(steering, 0.0, atol=1e-12)


def test_a_leg_is_driven_where_its_bends_are_wide_enough():
    """Aside by a third of the way: the sharpest curvature of the quintic, and a little less than that of the car."""
    start, goal = np.zeros(3), np.array([3.0, 1.0, 0.0])
    s = np.linspace(0, 1, 20_001)
    slope, bend = (30 * s**2 - 60 * s**3 + 30 * s**4) / 3.0, (60 * s - 180 * s**2 + 120 * s**3) / 9.0
    tightest = np.abs(bend / (1 + slope**2) ** 1.5).max()
    _, poses, speeds, steering = Leg(start, goal, 0.0).drive(1.0, 1.0, 2001)
    assert np.tan(np.abs(steering)).max() == pytest.approx(tightest, rel=1e-4)
    turned = [best_legs(start[None], goal[None], radius)[0][0] for radius in (0.9 / tightest, 2.0 / tightest)]
    assert np.isfinite(turned).tolist() == [True, False]
    length = np.trapezoid(np.sqrt(1 + slope**2), s) * 3.0
    assert Leg(start, goal, 0.0).length == pytest.approx(length, rel=1e-6)
    assert np.trapezoid(speeds, np.linspace(0, 1, 2001)) == pytest.approx(length, rel=1e-6)
    np.testing.assert_allclose(poses[-1], goal, atol=1e-12)


def test_legs_turn_by_less_than_twice_what_a_chart_holds():
    """150 degrees between start and goal: just below there may be a leg, just above there is none."""
    far = 40.0
    for degrees, found in ((140.0, True), (151.0, False), (-140.0, True), (-151.0, False)):
        turn = np.deg2rad(degrees)
        goal = np.array([[far * np.cos(turn / 2), far * np.sin(turn / 2), turn]])
        (cost,), _ = best_legs(np.zeros((1, 3)), goal, 0.1)
        assert np.isfinite(cost) == found
    (cost,), _ = best_legs(np.zeros((1, 3)), np.zeros((1, 3)), 1.0)
    assert cost == np.inf  # nothing to drive along


@pytest.mark.parametrize("forward_only", [False, True])
def test_legs_cost_the_same_wherever_they_are_and_mirrored(forward_only):
    generator = np.random.default_rng(8)
    starts, goals = generator.uniform(-1, 1, (2, 60, 3)) * [4.0, 4.0, 1.2]
    costs, charts = best_legs(starts, goals, 0.6, forward_only)
    assert 10 < np.isfinite(costs).sum() < 60
    mirrored, _ = best_legs(starts * [1, -1, -1], goals * [1, -1, -1], 0.6, forward_only)
    np.testing.assert_allclose(mirrored, costs, rtol=1e-9)
    longer, _ = best_legs(starts * [5, 5, 1], goals * [5, 5, 1], 3.0, forward_only)
    np.testing.assert_allclose(longer, 5 * costs, rtol=1e-9)
    turn, c, s = 0.8, np.cos(0.8), np.sin(0.8)
    turned = [
        np.column_stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2] + turn]) for p in (starts, goals)
    ]
    np.testing.assert_allclose(best_legs(*turned, 0.6, forward_only)[0], costs, rtol=1e-9)
    for start, goal, cost, chart in zip(starts, goals, costs, charts, strict=True):
        if np.isfinite(cost):
            leg = Leg(start, goal, chart)
            _, poses, speeds, steering = leg.drive(3.0, 0.9, 101)
            np.testing.assert_allclose(poses[[0, -1]], [start, goal], atol=1e-9)
            assert np.abs(np.tan(steering)).max() <= 0.9 / 0.6
            assert (speeds.min() >= 0) | (speeds.max() <= 0)
            assert not forward_only or speeds.min() >= 0
            assert leg.length <= cost
