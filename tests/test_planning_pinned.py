"""References, legs and paths at the edges of what they are: times, signs, thresholds and words."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.errors import InputError
from rnc_pin.planning import CarPath, Harmonic, Hold, Joined, MinimumJerk, TaskReference, ViaPoints
from rnc_pin.planning.car_planner import _ahead, _behind, _joined, _moves, plan_legs
from rnc_pin.planning.driven_path import continued_back, distances
from rnc_pin.planning.leg import Leg, best_legs
from rnc_pin.planning.references import InTurn, Slowed
from tolerances import ROUNDING

# ---------------------------------------------------------------------- references


def assert_same(point, *expected):
    for part, value in zip(point, expected, strict=True):
        np.testing.assert_allclose(part, value, atol=ROUNDING)


def test_a_minimum_jerk_motion_has_the_rates_of_its_quintic():
    """Begun late: before, at the first and from the last moment on it rests, and between it is the polynomial."""
    reference, move = MinimumJerk([1.0, 2.0], [4.0, 1.0], 2.0, begin=3.0), np.array([3.0, -1.0])
    assert (reference.size, reference.duration) == (2, 5.0)
    for t in (-1.0, 2.999, 3.0):
        assert_same(reference.at(t)[:3], [1.0, 2.0], 0.0, 0.0)
    for s in (0.0, 0.1, 0.5, 0.8, 0.9999):
        assert_same(
            reference.at(3.0 + 2.0 * s),
            [1.0, 2.0] + move * (10 * s**3 - 15 * s**4 + 6 * s**5),
            move * (30 * s**2 - 60 * s**3 + 30 * s**4) / 2,
            move * (60 * s - 180 * s**2 + 120 * s**3) / 4,
            move * (60 - 360 * s + 360 * s**2) / 8,
        )
    assert_same(reference.at(2.999), [1.0, 2.0], 0.0, 0.0, 0.0)
    for t in (5.0, 99.0):
        assert_same(reference.at(t), [4.0, 1.0], 0.0, 0.0, 0.0)


def test_via_points_begin_when_the_first_says_and_may_be_numbers():
    times, points = [2.0, 3.0, 5.0], [1.0, 4.0, 2.0]
    reference = ViaPoints(times, points)
    assert (reference.size, reference.duration) == (1, 5.0)
    for t, point in zip(times, points, strict=True):
        np.testing.assert_allclose(reference.at(t).position, [point], atol=ROUNDING)
    for t in (2.0, 1.9, 5.0):
        assert_same(reference.at(t)[1:3], 0.0, 0.0)
    columns = ViaPoints(times, np.column_stack([points, np.negative(points), times]))
    for t in (2.3, 3.3, 4.9):
        for whole, one in zip(columns.at(t), reference.at(t), strict=True):
            np.testing.assert_allclose(whole[:2], [one[0], -one[0]], atol=1e-9)
    two = ViaPoints([0.0, 1.0], [0.0, 1.0]).at(0.3)  # from rest to rest: the quintic
    np.testing.assert_allclose(two.position, [10 * 0.027 - 15 * 0.0081 + 6 * 0.00243], atol=ROUNDING)


def test_a_harmonic_grows_by_the_step_of_degree_seven():
    """``35 u^4 - 84 u^5 + 70 u^6 - 20 u^7`` of the ramp, by Leibniz with the sine; from its end on the sine alone."""
    center, amplitude, rate, phase, ramp = np.array([0.3, -0.2]), np.array([0.5, 2.0]), 2 * np.pi * 0.4, 0.7, 3.0
    reference, step = (
        Harmonic(center, amplitude, 0.4, phase, ramp),
        np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20]),
    )
    growth = [step.deriv(k) if k else step for k in range(4)]
    for t in (0.5, 2.0, 2.999, 3.0, 7.0):
        g = [growth[k](t / ramp) / ramp**k if t < ramp else float(k == 0) for k in range(4)]
        wave = [amplitude * rate**k * np.sin(rate * t + phase + k * np.pi / 2) for k in range(4)]
        expected = [sum(n * g[k] * wave[i - k] for k, n in enumerate(row)) for i, row in enumerate(PASCAL)]
        expected[0] = expected[0] + center
        assert_same(reference.at(t), *expected)
    for t in (0.0, -1.0):
        assert_same(reference.at(t), center, 0.0, 0.0, 0.0)
    assert reference.duration == np.inf
    at_once = Harmonic([0.0], 1.0, 0.25, ramp=0.0)
    assert_same(at_once.at(1.0), [1.0], 0.0, -(np.pi**2) / 4, 0.0)
    assert_same(at_once.at(1e-12)[:2], 0.0, np.pi / 2)


PASCAL = ((1,), (1, 1), (1, 2, 1), (1, 3, 3, 1))


def test_references_that_are_joined_slowed_or_in_turn():
    first, second = MinimumJerk([0.0], [1.0], 2.0), MinimumJerk([1.0], [5.0], 1.0, begin=2.0)
    turn = InTurn([first, second])
    assert (turn.size, turn.duration) == (1, 3.0)
    for t, part in ((1.0, first), (1.999, first), (2.0, second), (2.5, second), (3.0, second), (9.0, second)):
        assert_same(turn.at(t), *part.at(t))
    joined = Joined([first, Hold([7.0, 8.0]), second])
    assert (joined.size, joined.duration) == (4, 3.0)
    np.testing.assert_allclose(joined.at(2.5).position, [1.0, 7.0, 8.0, 3.0])
    assert (Joined([]).size, Joined([]).duration, Hold([1.0]).duration) == (0, 0.0, 0.0)
    assert TaskReference(first, second).duration == TaskReference(second, first).duration == 3.0
    slow, point = Slowed(second, 4.0), second.at(2.3)
    assert (slow.size, slow.duration) == (1, 12.0)
    assert_same(slow.at(9.2), *(part / 4.0**k for k, part in enumerate(point)))
    assert Slowed(second, 0.5).duration == 1.5


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Hold([np.inf]), r"value of a constant reference has to be finite, found \[inf\]"),
        (lambda: MinimumJerk([0.0], [np.nan], 1.0), "goal of a minimum-jerk reference has to be finite"),
        (lambda: MinimumJerk([np.nan], [0.0], 1.0), "start of a minimum-jerk reference has to be finite"),
        (lambda: MinimumJerk([0.0], [1.0], -1.0), "has to be positive, found -1.0"),
        (lambda: ViaPoints([0.0, 1.0], [0.0]), "at least two increasing times, and one point each"),
        (lambda: ViaPoints([0.0, 2.0, 1.0], [0.0, 1.0, 2.0]), "increasing"),
        (lambda: ViaPoints([0.0, np.nan], [0.0, 1.0]), "times of via points has to be finite"),
        (lambda: ViaPoints([0.0, 1.0], [0.0, np.inf]), "via points has to be finite"),
        (lambda: Slowed(Hold([1.0]), 0.0), "has to be positive and finite, found 0.0"),
        (lambda: Slowed(Hold([1.0]), np.inf), "has to be positive and finite, found inf"),
        (lambda: Harmonic([0.0], [1.0, 2.0], 1.0), "numbers or lists of 1"),
    ],
)
def test_references_that_make_no_sense_are_refused_by_name(make, words):
    with pytest.raises(InputError, match=words):
        make()


# ---------------------------------------------------------------------- legs


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


def test_moves_lead_to_a_pose_and_away_from_it():
    """One and the same move from a pose and back from where it leads."""
    pose, moves = np.array([1.0, -2.0, 0.7]), _moves(False)[:9] * [2.0, 2.0, 1.0]
    after = _ahead(pose, moves)
    c, s = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(after[:, :2], pose[:2] + moves[:, :2] @ [[c, s], [-s, c]], atol=1e-12)
    np.testing.assert_allclose(after[:, 2], 0.7 + moves[:, 2], atol=1e-12)
    for move, there in zip(moves, after, strict=True):
        np.testing.assert_allclose(_behind(there, move[None]), pose[None], atol=1e-12)


def test_of_several_ways_the_cheapest_is_joined():
    start, goal = np.zeros(3), np.array([8.0, 0.0, 0.0])
    between = np.array([[4.0, 1.0, 0.0], [4.0, 0.0, 0.0], [4.0, -2.0, 0.0]])
    cost, legs = _joined(start, between, goal, radius=1.0, forward_only=True)
    assert cost == pytest.approx(8.0)
    assert [leg.goal.tolist() for leg in legs] == [[4.0, 0.0, 0.0], [8.0, 0.0, 0.0]]
    many = np.column_stack([np.full(90, 4.0), np.linspace(-3.0, 1.45, 90), np.zeros(90)])
    cost, legs = _joined(start, many, goal, radius=1.0, forward_only=True)
    assert abs(legs[0].goal[1]) == np.abs(many[:, 1]).min()
    assert cost < 8.01
    assert _joined(start, between * [-1, 1, 1], goal, radius=1.0, forward_only=True) is None


def test_the_same_pose_is_refused_and_one_beside_it_is_not():
    start = np.array([1.0, 2.0, 0.3])
    for turn in (0.0, 2 * np.pi, -4 * np.pi):
        with pytest.raises(rnc.ConfigurationError, match="start and goal of the path are the same pose"):
            plan_legs(start, start + np.array([0, 0, turn]), 1.0)
    assert len(plan_legs(start, start + np.array([0, 0, np.pi]), 1.0)) > 1
    assert len(plan_legs(start, start + np.array([0.0, 0.5, 0.0]), 1.0)) > 1


# ---------------------------------------------------------------------- paths


def test_a_path_goes_on_straight_behind_its_start():
    heading = 2.0
    along = np.array([np.cos(heading), np.sin(heading)])
    poses = np.column_stack([np.outer(np.arange(5) * 0.2, along) + np.array([1.0, -1.0]), np.full(5, heading)])
    whole = continued_back(poses, 1.0)
    np.testing.assert_array_equal(whole[-5:], poses[:, :2])
    np.testing.assert_allclose(whole[0], [1.0, -1.0] - along)
    steps = np.linalg.norm(np.diff(whole, axis=0), axis=1)
    assert steps[:-4].max() <= 0.2 * (1 + 1e-9)
    assert steps.min() > 0.1
    np.testing.assert_allclose((whole - whole[0]) @ [-along[1], along[0]], 0.0, atol=1e-12)
    np.testing.assert_allclose(continued_back(poses[:1], 1.0)[[0, -1]], [[1.0, -1.0] - along, [1.0, -1.0]])
    aside = np.array([-along[1], along[0]])
    points = np.array([[1.0, -1.0] - 0.55 * along + 0.1 * aside, [1.0, -1.0] - 1.5 * along, [1.0, -1.0] + 1.1 * along])
    np.testing.assert_allclose(distances(points, whole), [0.1, 0.5, 0.3], atol=1e-9)


def test_a_path_of_several_legs_shares_its_time_by_their_lengths():
    """It stops between them; distance, heading and place go on without a jump, whatever a heading is called."""
    wheelbase, duration = 1.2, 9.0
    via = [(4.0, 1.0, 0.2 + 2 * np.pi), (2.0, 0.2, 0.1)]
    path = CarPath((0.0, 0.0, 0.0), (6.0, 0.0, -0.1), duration, wheelbase, via=via)
    assert len(path.legs) == 3
    lengths = [leg.length for leg in path.legs]
    assert path.length == pytest.approx(sum(lengths))
    ends = duration * np.cumsum(lengths) / path.length
    signs = [1.0, -1.0, 1.0]
    driven = np.cumsum(np.multiply(signs, lengths))
    for end, leg, distance in zip(ends, path.legs, driven, strict=True):
        point, place = path.reference.at(end), path.position.at(end)
        np.testing.assert_allclose(point.position, [distance, 0.0], atol=1e-5)
        np.testing.assert_allclose(point.velocity, 0.0, atol=1e-9)
        np.testing.assert_allclose(place.position, leg.goal[:2], atol=1e-9)
    assert path.times[0] == 0.0
    assert path.times[-1] == pytest.approx(duration)
    assert (np.diff(path.times) >= -1e-12).all()
    np.testing.assert_allclose(path.poses[-1], [6.0, 0.0, -0.1], atol=1e-9)
    assert np.abs(np.diff(path.poses[:, 2])).max() < 0.05
    for k in (100, 700, 1100):
        np.testing.assert_allclose(path.position.at(path.times[k]).position, path.poses[k, :2], atol=1e-9)
        speed, steering = path.reference.at(path.times[k]).velocity[0], path.reference.at(path.times[k]).position[1]
        turning = (path.poses[k + 1, 2] - path.poses[k - 1, 2]) / (path.times[k + 1] - path.times[k - 1])
        assert turning == pytest.approx(speed * np.tan(steering) / wheelbase, abs=1e-3)
        assert np.sign(speed) == signs[k // 401]


@pytest.mark.parametrize(
    ("start", "options", "words"),
    [
        ((0.0, 0.0), {}, r"start of a path: expected x, y and heading, found \[0.0, 0.0\]"),
        ((0.0, 0.0, 0.0), {"duration": 0.0}, "found 0, 1 and 0.785398"),
        ((0.0, 0.0, 0.0), {"wheelbase": 0.0}, "found 5, 0 and 0.785398"),
        ((0.0, 0.0, 0.0), {"max_steering": np.pi / 2}, "found 5, 1 and 1.5708"),
        ((0.0, 0.0, 0.0), {"max_steering": -0.1}, "found 5, 1 and -0.1"),
    ],
)
def test_a_path_at_the_edge_of_what_makes_sense(start, options, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        CarPath(start, (4.0, 0.0, 0.0), **{"duration": 5.0, "wheelbase": 1.0, **options})


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
