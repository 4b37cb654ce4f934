"""Paths of a car over given poses: whoever drives the planned speed and steering angle arrives; and its legs."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

import rnc_pin as rnc
from polynomials import in_axes, powers
from rnc_pin.motion.planning import CarPath
from rnc_pin.motion.planning.car_path import Leg, best_leg, path_distances

WHEELBASE, LIMIT = 1.3, 0.6


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


def test_a_path_moves_and_turns_with_its_poses():
    """Nothing depends on where the world's axes are: charts belong to the poses."""
    start, goal = np.array([0.0, 0, 0.2]), np.array([6.0, 2.5, 1.1])
    turn, shift, a_turn = 1.9, np.array([3.0, -7.0]), np.array([0.0, 0.0, 2 * np.pi])
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])

    def moved(pose):
        return np.array([*(rotation @ pose[:2] + shift), pose[2] + turn])

    path, other = CarPath(start, goal, 5.0, 1.0), CarPath(moved(start), moved(goal) + a_turn, 5.0, 1.0)
    assert len(path.legs) == len(other.legs)
    np.testing.assert_allclose(other.poses[:, :2], path.poses[:, :2] @ rotation.T + shift, atol=1e-9)
    np.testing.assert_allclose(other.poses[:, 2], path.poses[:, 2] + turn, atol=1e-9)


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


def bending_cost(leg, radius):
    """``integral of 1 + (radius curvature)^2`` over a leg as it is driven, and whether its bends are allowed."""
    _, poses, _, _ = leg.drive(4.0, 1.0, 4001)
    lengths = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    bent = lengths > 1e-6  # it starts and ends at rest
    curvature = np.diff(poses[:, 2])[bent] / lengths[bent]
    allowed = np.abs(curvature).max() * radius < 0.985 and np.abs(np.tan(poses[:, 2] - leg.chart)).max() < 3.7
    return np.sum(lengths[bent] * (1 + (radius * curvature) ** 2)), allowed


@pytest.mark.parametrize("forward_only", [False, True])
def test_the_leg_is_drivable_the_cheapest_of_its_charts_and_the_same_in_a_mirror(forward_only):
    generator, found, radius = np.random.default_rng(8), 0, 0.6
    for start, goal in zip(*generator.uniform(-1, 1, (2, 40, 3)) * [4.0, 4.0, 1.2], strict=True):
        try:
            leg = best_leg(start, goal, radius, forward_only)
        except rnc.InfeasibleError:
            continue
        found += 1
        _, poses, speeds, steering = leg.drive(3.0, 0.9, 101)
        np.testing.assert_allclose(poses[[0, -1]], [start, goal], atol=1e-9)
        assert np.abs(np.tan(steering)).max() <= 0.9 / radius
        assert (speeds.min() >= 0) | ((speeds.max() <= 0) & (not forward_only))
        cost, _ = bending_cost(leg, radius)
        room, middle = np.deg2rad(75.0) - abs(goal[2] - start[2]) / 2, (start[2] + goal[2]) / 2
        for share in (-0.8, -0.5, -0.25, 0.0, 0.25, 0.5, 0.8):
            other = Leg(start, goal, middle + share * room)
            backs_up = other.drive(1.0, 1.0, 3)[2][1] < 0
            others_cost, allowed = bending_cost(other, radius)
            assert not allowed or (forward_only and backs_up) or cost <= others_cost * (1 + 1e-3)
        mirrored = best_leg(start * [1, -1, -1], goal * [1, -1, -1], radius, forward_only)
        assert mirrored.length == pytest.approx(leg.length, rel=1e-9)
    assert 5 < found < 40
