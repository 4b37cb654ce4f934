"""Paths of a car in one leg or several: whoever drives the planned speed and steering angle arrives; and its legs."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

from polynomials import in_axes, powers
from rnc_pin.planning import CarPath
from rnc_pin.planning.car_path import Leg, best_legs, continued_back, path_distances, plan_legs

WHEELBASE, LIMIT = 1.3, 0.6
MANOEUVRES = {
    "parallel parking": ((0, 0, 0), (0, 2, 0)),
    "turning round": ((0, 0, 0), (-4, 0, np.pi)),
    "turning round on the spot": ((1, 2, 0.3), (1, 2, 0.3 + np.pi)),
    "same x": ((2, -1, 0), (2, 2, 0.5)),
    "a little aside": ((0, 0, 0), (0.3, 0.3, 0)),
    "a steep heading": ((0, 0, 1.5), (5, 0, 0)),
    "far": ((0, 0, 0), (-40, 20, np.pi / 2)),
}


def drive(path, start, steps=600):
    """Pose at the end, largest steering angle and lowest speed of a car with these inputs (Runge-Kutta)."""
    h = path.duration / steps
    points = [path.reference.at(k * h / 2) for k in range(2 * steps + 1)]
    speed, steering = np.array([point.velocity[0] for point in points]), np.array([p.position[1] for p in points])

    def rate(pose, k):
        u = speed[k]
        return np.array([u * np.cos(pose[2]), u * np.sin(pose[2]), u * np.tan(steering[k]) / WHEELBASE])

    pose = np.array(start, float)
    for k in range(0, 2 * steps, 2):
        k1 = rate(pose, k)
        k2 = rate(pose + h / 2 * k1, k + 1)
        k3 = rate(pose + h / 2 * k2, k + 1)
        k4 = rate(pose + h * k3, k + 2)
        pose = pose + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return pose, np.abs(steering).max(), speed.min()


def assert_same_pose(pose, goal, atol):
    np.testing.assert_allclose(pose[:2], goal[:2], atol=atol)
    assert abs(np.sin((pose[2] - goal[2]) / 2)) < atol


@pytest.mark.parametrize(("start", "goal"), [
    ((-8, 3, 0), (0, 0, 0)), ((0, 0, 0.4), (6, 2, -0.3)), ((0, 0, 0), (-5, 1, 0.2)), ((1, 1, 0), (9, 1, 0)),
])  # fmt: skip
def test_one_leg_where_one_will_do(start, goal):
    path = CarPath(start, goal, 5.0, WHEELBASE)
    assert len(path.legs) == 1
    pose, *_ = drive(path, start, 4000)
    assert_same_pose(pose, goal, 1e-5)


@pytest.mark.parametrize("forward_only", [False, True])
@pytest.mark.parametrize("name", MANOEUVRES)
def test_manoeuvres(name, forward_only):
    start, goal = MANOEUVRES[name]
    path = CarPath(start, goal, 20.0, WHEELBASE, max_steering=LIMIT, forward_only=forward_only)
    pose, steering, speed = drive(path, start)
    assert_same_pose(pose, goal, 1e-3)
    assert steering <= LIMIT
    assert not forward_only or speed > -1e-9
    # At rest with straight wheels between legs.
    for leg, other in pairwise(path.legs):
        np.testing.assert_array_equal(leg.goal, other.start)
    ends = path.times[np.flatnonzero(np.diff(path.times) == 0)]
    assert len(ends) == len(path.legs) - 1
    for t in (0.0, *ends, path.duration):
        point = path.reference.at(t)
        np.testing.assert_allclose([*point.velocity, point.position[1]], 0.0, atol=1e-9)


def test_random_pairs_are_all_reached_within_the_limit():
    """12 pairs in a box of 6 m and 12 in one of 16 m, half of each forwards only: all 24 are found."""
    generator, counts = np.random.default_rng(3), np.zeros(4, int)
    for index in range(24):
        box = 3.0 if index % 4 < 2 else 8.0
        poses = generator.uniform([-box, -box, -np.pi], [box, box, np.pi], (2, 3))
        path = CarPath(*poses, 20.0, WHEELBASE, max_steering=LIMIT, forward_only=bool(index % 2))
        pose, steering, speed = drive(path, poses[0])
        assert_same_pose(pose, poses[1], 1e-3)
        assert steering <= LIMIT
        assert index % 2 == 0 or speed > -1e-9
        counts[len(path.legs)] += 1
    assert counts.sum() == 24
    assert counts[1:].all()  # paths of one, two and three legs are all among them


def test_a_path_moves_and_turns_with_its_poses():
    """Nothing depends on where the world's axes are: charts belong to the poses."""
    start, goal = np.array([0.0, 0, 0.2]), np.array([1.0, 2.5, 2.8])
    turn, shift, a_turn = 1.9, np.array([3.0, -7.0]), np.array([0.0, 0.0, 2 * np.pi])
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])

    def moved(pose):
        return np.array([*(rotation @ pose[:2] + shift), pose[2] + turn])

    path, other = CarPath(start, goal, 5.0, 1.0), CarPath(moved(start), moved(goal) + a_turn, 5.0, 1.0)
    assert len(path.legs) == len(other.legs)
    np.testing.assert_allclose(other.poses[:, :2], path.poses[:, :2] @ rotation.T + shift, atol=1e-9)
    np.testing.assert_allclose(other.poses[:, 2], path.poses[:, 2] + turn, atol=1e-9)


def test_a_path_goes_by_the_poses_that_it_is_given():
    via = [(3.0, 2.0, 1.0), (1.0, 4.0, 1.2)]
    path = CarPath((0, 0, 0), (-2, 0, 0.5), 9.0, 1.0, via=via)
    stops = np.array([leg.goal for leg in path.legs])
    for pose in via:
        assert (np.abs(stops - pose).max(axis=1) < 1e-12).any()
    driven = np.linalg.norm(np.diff(path.poses[:, :2], axis=0), axis=1).sum()
    np.testing.assert_allclose(driven, path.length, rtol=1e-3)


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


def test_a_speed_output_that_is_twice_the_speed_goes_twice_the_distance():
    doubled = SimpleNamespace(outputs=lambda curvatures: (0.5 * curvatures, np.full_like(curvatures, 2.0)))
    plain, path = (CarPath((0, 0, 0), (3.0, 1.0, 0.5), 4.0, 0.8, geometry=each) for each in (None, doubled))
    for t in (1.0, 2.5, 4.0):
        distance, steering = plain.reference.at(t).position
        expected = [2.0 * distance, 0.5 * np.tan(steering) / 0.8]
        np.testing.assert_allclose(path.reference.at(t).position, expected, atol=1e-6)


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
    np.testing.assert_allclose(path_distances(points, path), expected, atol=1e-9)
    stopped = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]])  # a stop is twice in a path
    np.testing.assert_allclose(path_distances(np.array([[1.0, 0.5], [2.0, -0.2]]), stopped), [0.5, 0.2])


# ---------------------------------------------------------------------- plans of several legs


@pytest.mark.parametrize(("goal", "forward_only"), [
    ((0.2, 1.1, 0.3), False), ((-0.4, 0.7, 2.8), False), ((0.1, -0.9, -1.2), True),
])  # fmt: skip
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


def test_a_car_backs_up_unless_told_not_to():
    (leg,) = plan_legs(np.zeros(3), np.array([-3.0, 0.0, 0.0]), 0.5)
    assert leg.length == pytest.approx(3.0)
    assert len(CarPath(np.zeros(3), (-3.0, 0.0, 0.0), 2.0, 1.0).legs) == 1
    assert len(CarPath(np.zeros(3), (4.0, 0.0, 0.0), 2.0, 1.0, max_steering=0.02).legs) == 1


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
