"""Paths of a car in one leg or several: whoever drives the planned speed and steering angle arrives."""

import time
from itertools import pairwise

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.errors import InfeasibleError
from rnc_pin.planning import CarPath
from rnc_pin.planning.driven_path import distances

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


@pytest.mark.parametrize(
    ("start", "goal"),
    [((-8, 3, 0), (0, 0, 0)), ((0, 0, 0.4), (6, 2, -0.3)), ((0, 0, 0), (-5, 1, 0.2)), ((1, 1, 0), (9, 1, 0))],
)
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


def test_random_pairs_are_all_reached_within_the_limit_and_quickly():
    """28 pairs in a box of 6 m and 28 in one of 16 m, half of each forwards only: all 56 are found."""
    generator, counts, slowest = np.random.default_rng(3), np.zeros(4, int), 0.0
    for index in range(56):
        box = 3.0 if index % 4 < 2 else 8.0
        poses = generator.uniform([-box, -box, -np.pi], [box, box, np.pi], (2, 3))
        begin = time.process_time()
        path = CarPath(*poses, 20.0, WHEELBASE, max_steering=LIMIT, forward_only=bool(index % 2))
        slowest = max(slowest, time.process_time() - begin)
        pose, steering, speed = drive(path, poses[0])
        assert_same_pose(pose, poses[1], 1e-3)
        assert steering <= LIMIT
        assert index % 2 == 0 or speed > -1e-9
        counts[len(path.legs)] += 1
    assert counts.sum() == 56
    assert counts[1:].all()  # paths of one, two and three legs are all among them
    assert slowest < 1.0


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
    np.testing.assert_allclose(drive_length(path), path.length, rtol=1e-3)


def drive_length(path):
    return np.linalg.norm(np.diff(path.poses[:, :2], axis=0), axis=1).sum()


@pytest.mark.parametrize(
    ("goal", "options", "words"),
    [
        ((0, 0, 0), {}, "the same pose"),
        ((0, 0, 2 * np.pi), {}, "the same pose"),
        ((1, 2), {}, "goal of a path: expected x, y and heading"),
        ((1, np.nan, 0), {}, "goal of a path: expected x, y and heading"),
        ((1, 0, 0), {"via": [(0, 1)]}, "via pose of a path"),
        ((1, 0, 0), {"max_steering": 1.6}, "between 0 and pi/2, found 5, 1 and 1.6"),
        ((1, 0, 0), {"max_steering": 0.0}, "largest steering angle"),
    ],
)
def test_bad_arguments_are_refused(goal, options, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        CarPath((0, 0, 0), goal, 5.0, 1.0, **options)


def test_where_no_path_is_found_it_says_so(monkeypatch):
    monkeypatch.setattr("rnc_pin.planning.car_planner._moves", lambda forward_only: np.array([[1.5, 0.0, 0.0]]))
    with pytest.raises(InfeasibleError, match=r"forward legs is found from \(0, 0, 0 deg\) to \(0, 2, 0 deg\)"):
        CarPath((0, 0, 0), (0, 2, 0), 5.0, 1.0, forward_only=True)


def test_distances_from_a_polyline():
    path = np.column_stack([np.linspace(0, 2, 5), np.zeros(5)])
    points = np.array([[0.3, 0.2], [-3.0, 4.0], [1.1, -0.5], [2.0, 0.0]])
    np.testing.assert_allclose(distances(points, path), [0.2, 5.0, 0.5, 0.0], atol=1e-15)
