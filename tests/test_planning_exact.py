"""Legs, plans, paths and references are those of plain rewritings: every number of them, on odd inputs."""

import re
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

import rnc_pin as rnc
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.planning import CarPath, FireTruckChart, Geodesic, Harmonic, MinimumJerk, ViaPoints, car_planner
from rnc_pin.planning.car_planner import _joined, _moves, plan_legs
from rnc_pin.planning.driven_path import continued_back, distances
from rnc_pin.planning.leg import Leg, best_legs

STEEPEST = np.tan(np.deg2rad(75.0))


def powers(s, order):
    """Rows of a quintic's value, slope, ... at s (n,) by its coefficients: (n, 6)."""
    exponents = np.arange(6)
    factors = np.prod([exponents - k for k in range(order)], axis=0)  # zero where the power is lower than the order
    return factors * np.asarray(s)[:, None] ** np.maximum(exponents - order, 0)


def in_axes(start, goal, chart):
    """Extent along the axes' x, and the quintic y(x) (6,) between the poses, straight at both ends."""
    c, n = np.cos(chart), np.sin(chart)
    dx, dy = np.array([[c, n], [-n, c]]) @ (goal - start)[:2]
    ends = np.array([0.0, dx])
    rows = np.concatenate([powers(ends / dx, order) / dx**order for order in range(3)])
    slopes = np.tan([start[2] - chart, goal[2] - chart])
    return dx, np.linalg.solve(rows, [0.0, dy, *slopes, 0.0, 0.0])


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


# ---------------------------------------------------------------------- plans


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


def test_a_plan_looks_at_all_pairs_coarsely_and_at_forty_closely(monkeypatch):
    """Of stops for two legs all; for three, thirteen of each of nine turns at either end, and what joins them."""
    looked = []

    def watched(starts, goals, radius, forward_only=False, samples=201):
        looked.append((len(starts), samples, radius, forward_only))
        return best_legs(starts, goals, radius, forward_only, samples)

    _moves(True)
    monkeypatch.setattr(car_planner, "best_legs", watched)
    assert plan_legs(np.zeros(3), np.array([0.0, 2.0, 0.0]), 0.5, True)
    turns = np.rad2deg(_moves(True)[:, 2]).round()
    few, both = sum(min(13, (turns == turn).sum()) for turn in range(-120, 121, 30)), 2 * len(turns)
    assert few > 90
    sizes = [(1, 201), (both, 25), (both, 25), (40, 201), (40, 201), (few**2, 25), (few, 25), (few, 25)]
    assert looked == [(*size, 0.5, True) for size in [*sizes, (40, 201), (40, 201), (40, 201)]]


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


def test_forty_one_ways_are_looked_at_coarsely_first(monkeypatch):
    calls = []

    def watched(starts, goals, *options):
        calls.append((len(starts), *options))
        return best_legs(starts, goals, *options)

    monkeypatch.setattr(car_planner, "best_legs", watched)
    ways = np.column_stack([np.full(41, 4.0), np.linspace(2.0, 0.0, 41), np.zeros(41)])
    for count, expected in ((40, [(40, 1.0, True)]), (41, [(41, 1.0, True, 25), (40, 1.0, True)])):
        calls.clear()
        cost, (leg,) = _joined(np.zeros(3), ways[-count:], radius=1.0, forward_only=True)
        assert calls == expected
        assert cost == pytest.approx(4.0)
        np.testing.assert_array_equal(leg.goal, [4.0, 0.0, 0.0])


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


# ---------------------------------------------------------------------- paths


def test_a_path_is_its_legs_driven_one_after_the_other():
    via, goal, wheelbase, duration = (4.0, 1.0, 0.2), (1.0, -0.5, 0.3), 1.2, 7.0
    path = CarPath((0.0, 0.0, 0.1), goal, duration, wheelbase, via=[via])
    assert [leg.goal.tolist() for leg in path.legs] == [list(via), list(goal)]
    first, second = path.legs
    share = duration * first.length / (first.length + second.length)
    driven = [leg.drive(time, wheelbase, 401) for leg, time in ((first, share), (second, duration - share))]
    np.testing.assert_allclose(path.times, [*driven[0][0], *(share + driven[1][0])])
    np.testing.assert_allclose(path.poses, np.concatenate([driven[0][1], driven[1][1]]), atol=1e-12)
    signed = 0.0
    for begin, (local, poses, speeds, steering) in zip((0.0, share), driven, strict=True):
        for k in (57, 200, 341):
            point, place = path.reference.at(begin + local[k]), path.position.at(begin + local[k])
            steps = np.linalg.norm(np.diff(poses[: k + 1, :2], axis=0), axis=1)
            assert point.position[0] == pytest.approx(signed + np.sign(speeds[k]) * steps.sum(), abs=1e-4)
            np.testing.assert_allclose([point.velocity[0], point.position[1]], [speeds[k], steering[k]], atol=1e-7)
            np.testing.assert_allclose(place.position, poses[k, :2], atol=1e-12)
        signed += np.sign(speeds[200]) * np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum()
    behind = np.array([[-d * np.cos(0.1), -d * np.sin(0.1)] for d in (1.0, 2.99, 3.25)])
    np.testing.assert_allclose(path.distance(behind), [0.0, 0.0, 0.25], atol=1e-9)


def test_a_path_may_steer_by_45_degrees_unless_told():
    """Just wide enough for a turning radius of the wheelbase, and not for one that is larger by a tenth."""
    s = np.linspace(0, 1, 201)
    goal = np.array([4.0, 1.6, 0.0])
    dx, quintic = in_axes(np.zeros(3), goal, 0.0)
    tightest = np.abs(powers(s, 2) @ quintic / dx**2 / np.hypot(1, powers(s, 1) @ quintic / dx) ** 3).max()
    for share, count in ((0.9, True), (1.6, False)):
        wheelbase = share / tightest
        legs = CarPath(np.zeros(3), goal, 3.0, wheelbase).legs
        assert (len(legs) == 1) == count
        told = CarPath(np.zeros(3), goal, 3.0, wheelbase, max_steering=np.pi / 4).legs
        assert [leg.goal.tolist() for leg in told] == [leg.goal.tolist() for leg in legs]


def test_the_stretch_behind_a_path_is_sampled_as_its_longest_step():
    poses = np.array([[1.0, 2.0, 0.5], [1.1, 2.0, 0.5], [1.1, 2.3, 0.5], [1.3, 2.3, 0.5]])
    back = np.array([1.0, 0.75, 0.5, 0.25])  # 1 m in steps of at most 0.3 m
    expected = [1.0, 2.0] - back[:, None] * [np.cos(0.5), np.sin(0.5)]
    np.testing.assert_allclose(continued_back(poses, 1.0), np.concatenate([expected, poses[:, :2]]))
    assert len(continued_back(poses[:1], 1.7)) == 1002  # a thousandth of the stretch where there is no step


def test_distances_are_those_of_all_segments():
    """Segments of unequal lengths, points before, beside, between and after."""
    turn = 3.0 * (np.arange(40) + np.random.default_rng(2).uniform(-0.2, 0.2, 40)) / 40
    path = np.column_stack([3 * np.cos(turn), 2 * np.sin(turn)])
    points = np.random.default_rng(3).uniform([-4, 0.0], [4, 3], (80, 2))
    points = np.concatenate([points[np.hypot(points[:, 0] / 3, points[:, 1] / 2) > 0.8], path[[0, 9, -1]]])
    expected = []
    for point in points:
        each = []
        for a, b in pairwise(path):
            share = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            each.append(np.linalg.norm(point - a - share * (b - a)))
        expected.append(min(each))
    np.testing.assert_allclose(distances(points, path), expected, atol=1e-9)
    stopped = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]])  # a stop is twice in a path
    np.testing.assert_allclose(distances(np.array([[1.0, 0.5], [2.0, -0.2]]), stopped), [0.5, 0.2])


# ---------------------------------------------------------------------- the chained form


def test_the_inputs_of_a_truck_of_any_lengths_give_the_chain_its_rates():
    chart, generator, h = FireTruckChart(1.4, 2.3), np.random.default_rng(1), 1e-6
    assert FireTruckChart() == FireTruckChart(1.0, 1.0)
    for _ in range(10):
        x, y, theta1, phi1, hitch, phi2 = generator.uniform(-0.9, 0.9, 6)
        state, v = np.array([x, y, theta1, phi1, theta1 + hitch, phi2]), generator.normal(size=3)
        u, *steered = chart.to_inputs(state, v)
        tractor = u * np.array([np.cos(theta1), np.sin(theta1), np.tan(phi1) / 1.4])
        trailer = -u * np.sin(hitch + phi2) / (2.3 * np.cos(phi2))  # its axle slips not, and is steered by phi2
        rate = np.array([*tractor, steered[0], trailer, steered[1]])
        _, x0, x1, _, y0, _ = chart.to_chain(state)
        expected = [v[0], v[1], x0 * v[0], x1 * v[0], v[2], y0 * v[0]]
        found = (chart.to_chain(state + h * rate) - chart.to_chain(state - h * rate)) / (2 * h)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("moved", [(2, 4), (3,), (4,), (5,)])  # heading with hitch zero, steering, hitch, trailer's
def test_each_angle_of_the_truck_stays_within_90_degrees(moved, sign):
    for degrees in (89.0, 90.0, 91.0):
        state = np.zeros(6)
        state[list(moved)] = sign * np.deg2rad(degrees)
        if degrees < 90:
            np.testing.assert_allclose(FireTruckChart().from_chain(FireTruckChart().to_chain(state)), state, atol=1e-9)
            continue
        words = "^a heading, steering or hitch angle is not within 90 degrees: outside the chained form$"
        with pytest.raises(rnc.InputError, match=words):
            FireTruckChart().to_chain(state)


# ---------------------------------------------------------------------- references


def test_via_points_are_joined_by_the_quintic_spline():
    """Pieces by hand: values at knots, four derivatives that go on over inner ones, rest at both ends."""
    knots, values = np.array([0.5, 1.2, 2.6, 3.1]), np.array([[1.0, 0.3], [-0.4, 2.0], [0.7, -1.1], [2.2, 0.6]])
    rows, right = [], []

    def condition(value, *terms):
        row = np.zeros(18)
        for piece, t, order, sign in terms:
            row[6 * piece : 6 * piece + 6] += sign * powers([t - knots[piece]], order)[0]
        rows.append(row)
        right.append(np.broadcast_to(value, 2))

    for piece in range(3):
        for end in (piece, piece + 1):
            condition(values[end], (piece, knots[end], 0, 1))
    for inner, order in product((1, 2), (1, 2, 3, 4)):
        condition(0.0, (inner - 1, knots[inner], order, 1), (inner, knots[inner], order, -1))
    for order in (1, 2):
        condition(0.0, (0, knots[0], order, 1))
        condition(0.0, (2, knots[3], order, 1))
    pieces = np.linalg.solve(rows, right).reshape(3, 6, 2)
    reference = ViaPoints(knots, values)
    for t in (0.5, 0.61, 1.2, 1.9, 2.7, 3.09):
        piece = np.searchsorted(knots, t, side="right") - 1
        for order, part in enumerate(reference.at(t)):
            expected = powers([t - knots[piece]], order)[0] @ pieces[piece]
            np.testing.assert_allclose(part, expected, rtol=1e-8, atol=1e-7)


def test_a_harmonic_has_no_phase_and_a_ramp_of_a_second_unless_told():
    plain, told = Harmonic([0.2, 0.1], 0.7, [0.3, 0.9]), Harmonic([0.2, 0.1], [0.7] * 2, [0.3, 0.9], [0.0] * 2, 1.0)
    assert plain.size == 2
    for t in (0.3, 0.99, 1.0, 2.2):
        for one, other in zip(plain.at(t), told.at(t), strict=True):
            np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(
        plain.at(1.01).position, [0.2, 0.1] + 0.7 * np.sin(2 * np.pi * 1.01 * np.array([0.3, 0.9]))
    )
    np.testing.assert_allclose(Harmonic([0.0], 2.0, 0.25, 0.4, ramp=0.5).at(0.25).position, [np.sin(0.4 + np.pi / 8)])
    tiny = Harmonic([0.0], 2.0, 0.25, 0.4, ramp=1e-12)  # grown at once, over a nanosecond at least
    np.testing.assert_allclose(tiny.at(1e-11).position, [2.0 * np.sin(0.4)], rtol=1e-9)


def test_refused_references_say_what_was_found():
    with pytest.raises(rnc.InputError, match=r"^start has shape \(1,\) but goal \(2,\)$"):
        MinimumJerk(0.5, [1.0, 2.0], 1.0)
    with pytest.raises(rnc.InputError, match=r"^amplitude, frequency and phase have to be numbers or lists of 2$"):
        Harmonic([0.0, 1.0], 1.0, [1.0, 2.0, 3.0])
    with pytest.raises(rnc.InputError, match=r"^start of a minimum-jerk reference has to be finite, found \[inf\]$"):
        MinimumJerk(np.inf, 1.0, 1.0)


def test_a_geodesic_among_other_outputs_is_the_shortest_turn():
    start, goal = np.array([0.4, 0.3, -1.1, 0.5, 2.0]), np.array([1.4, -0.7, 0.2, 1.9, -1.0])
    reference = Geodesic(start, goal, 2.5, Coordinates([False] * 5, [1]), begin=0.75)
    assert (reference.size, reference.duration) == (5, 3.25)
    first, last = (Rotation.from_rotvec(each[1:4]) for each in (start, goal))
    arc = (last * first.inv()).as_rotvec()

    def place(t):
        u = np.clip((t - 0.75) / 2.5, 0, 1)
        s = 10 * u**3 - 15 * u**4 + 6 * u**5
        turned = (Rotation.from_rotvec(s * arc) * first).as_rotvec()
        others = start + s * (goal - start)
        return np.array([others[0], *turned, others[4]])

    h = 1e-4
    for t in (0.0, 0.9, 1.7, 2.9, 3.25, 8.0):
        point = reference.at(t)
        np.testing.assert_allclose(point.position, place(t), atol=1e-10)
        np.testing.assert_allclose(point.velocity, (place(t + h) - place(t - h)) / (2 * h), atol=1e-6)
        second = (place(t + h) - 2 * place(t) + place(t - h)) / h**2
        np.testing.assert_allclose(point.acceleration, second, atol=1e-2 if t == 3.25 else 1e-5)
        assert np.isnan(point.jerk).tolist() == [False, True, True, True, False]
    line = Geodesic(0.5, 2.0, 1.0, Coordinates([False]))
    np.testing.assert_allclose([line.at(0.5).position, line.at(0.5).velocity], [[1.25], [1.5 * 1.875]])
