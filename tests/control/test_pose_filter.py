"""Kalman filter of a base's pose: closed forms, and consistency over seeds."""

import numpy as np
import pytest
import scipy

import rnc_pin as rnc
from rnc_pin.control import PoseFilter, WheelOdometry
from textbook_systems import differential_drive

CART = differential_drive()
RADIUS, TRACK = 0.1, 0.4
SLIP, ENCODER, GYRO, BIAS = 0.01, 0.1, 0.01, 0.002
FIX = np.diag([0.02, 0.03, 0.05]) ** 2
SEEDS, TICK, FINE, SECONDS = 100, 0.25, 20, 5.0


def odometry():
    wheels = [rnc.RollingWheel(f"{side}_wheel", RADIUS) for side in ("left", "right")]
    joints = ["left_wheel_joint", "right_wheel_joint"]
    return WheelOdometry(rnc.NonholonomicSystem(CART, wheels, joints).reduce(), "base")


def angles(left, right):
    return CART.configuration({"left_wheel_joint": left, "right_wheel_joint": right})


def matrix(pose):
    """Homogeneous matrix of a pose (x, y, heading)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])


def driven(seed, gyro, heading=True):
    """One run by the textbook kinematics of a differential drive in small steps; filter errors and their squares."""
    draw, filter = np.random.default_rng(seed), driven.filters[gyro]
    pose, wheels, bias = np.array([0.3, -0.2, 2.0]), np.zeros(2), 0.1 * draw.normal()
    first = np.diag([0.05, 0.05, 0.1, 0.1]) ** 2
    guess = pose + [0, 0, 0.1] * draw.normal(size=3)
    turned = np.array([[np.cos(guess[2]), -np.sin(guess[2])], [np.sin(guess[2]), np.cos(guess[2])]])
    guess[:2] += turned @ (0.05 * draw.normal(size=2))
    estimate = filter.initial_state(0.0, angles(*wheels), guess, first)
    dt, found = TICK / FINE, []
    for k in range(round(SECONDS / TICK)):
        t, before = k * TICK, pose[2]
        rates = np.array([6.0 + 3.0 * np.sin(0.7 * t), 6.0 - 4.0 * np.sin(0.4 * t)])
        slip = np.sqrt(dt) * SLIP * draw.normal(size=(FINE, 3))
        rolled = RADIUS * rates * dt + slip[:, :2]
        across, forward, turn = slip[:, 2], rolled.mean(axis=1), np.diff(rolled)[:, 0] / TRACK
        heading_between = before + np.cumsum(turn) - turn / 2
        c, s = np.cos(heading_between), np.sin(heading_between)
        pose = pose + np.sum([c * forward - s * across, s * forward + c * across, turn], axis=1)
        wheels = wheels + rates * TICK + np.sqrt(TICK) * ENCODER * draw.normal(size=2)
        bias += BIAS * np.sqrt(TICK) * draw.normal()
        rate = (pose[2] - before) / TICK + bias + GYRO / np.sqrt(TICK) * draw.normal() if gyro else None
        estimate = filter.predict(t + TICK, angles(*wheels), estimate, rate)
        if k % 10 == 9:
            fix = pose + np.sqrt(np.diag(FIX)) * draw.normal(size=3)
            estimate = filter.correct(*((fix, FIX) if heading else (fix[:2], FIX[:2, :2])), estimate).estimate
        if k % 10 in (7, 9):
            error = np.append(estimate.error(pose), bias - estimate.bias)[: 4 if gyro else 3]
            size = len(error)
            found.append(error @ np.linalg.solve(estimate.covariance[:size, :size], error))
    return found


driven.filters = {
    gyro: PoseFilter(odometry(), SLIP, ENCODER, GYRO if gyro else None, BIAS, gate=1 - 1e-9) for gyro in (False, True)
}


@pytest.mark.parametrize(("gyro", "heading"), [(False, True), (True, True), (True, False)])
def test_covariance_is_consistent_over_seeds(gyro, heading):
    """Mean squared errors in standard deviations are chi-square distributed, before and after each fix."""
    squares = np.array([driven(seed, gyro, heading) for seed in range(SEEDS)])
    size = 4 if gyro else 3
    low, high = scipy.stats.chi2.ppf([0.0005, 0.9995], SEEDS * size) / SEEDS
    assert ((low < squares.mean(axis=0)) & (squares.mean(axis=0) < high)).all()


def test_without_noise_of_fixes_the_fix_is_the_estimate():
    filter = driven.filters[False]
    estimate = filter.initial_state(0.0, angles(0, 0), [0, 0, 0], np.eye(4))
    fix = filter.correct([0.3, -0.2, 0.5], 1e-12 * np.eye(3), estimate)
    np.testing.assert_allclose(fix.estimate.pose, [0.3, -0.2, 0.5], atol=1e-9)
    np.testing.assert_allclose(fix.estimate.covariance[:3, :3], 0.0, atol=1e-11)


def test_a_straight_step_has_the_covariance_of_the_textbook():
    """Both wheels slip alike: forward (s/2)^2 * 2, turn 2 (s/track)^2; across s^2; heading errors bend the path."""
    filter, heading = PoseFilter(odometry(), SLIP), 0.2
    estimate = filter.initial_state(0.0, angles(0, 0), [0, 0, 0], np.diag([0, 0, heading**2, 0]))
    found = filter.predict(1.0, angles(2.0, 2.0), estimate)
    way, turn = 0.2, 2 * (SLIP / TRACK) ** 2
    np.testing.assert_allclose(found.pose, [way, 0.0, 0.0], atol=1e-12)
    expected = np.diag([SLIP**2 / 2, SLIP**2 + way**2 * (heading**2 + turn / 4), heading**2 + turn, 0.0])
    expected[1, 2] = expected[2, 1] = way * (heading**2 + turn / 2)
    np.testing.assert_allclose(found.covariance, expected, atol=1e-15)


def test_errors_are_motions_of_the_frame():
    filter = driven.filters[False]
    pose, other = np.array([1.0, 2.0, 3.0]), np.array([0.5, 2.5, -2.5])
    error = filter.initial_state(0.0, angles(0, 0), pose).error(other)
    twist = np.array([[0, -error[2], error[0]], [error[2], 0, error[1]], [0, 0, 0]])
    np.testing.assert_allclose(matrix(pose) @ scipy.linalg.expm(twist), matrix(other), atol=1e-12)


def test_the_bias_of_the_gyroscope_is_found_at_rest():
    filter = PoseFilter(odometry(), slip=1e-4, gyro=1e-3)
    estimate = filter.initial_state(0.0, angles(0, 0), [0, 0, 0], np.diag([0, 0, 0, 1.0]))
    for k in range(200):
        estimate = filter.predict(0.1 * (k + 1), angles(0, 0), estimate, 0.05)
    assert estimate.bias == pytest.approx(0.05, abs=1e-4)
    assert abs(estimate.pose[2]) < 1e-3


def test_outliers_are_refused():
    filter = PoseFilter(odometry(), SLIP)
    estimate = filter.initial_state(0.0, angles(0, 0), [0, 0, 0], np.diag([0.1, 0.1, 0.1, 0]) ** 2)
    fix = filter.correct([1.0, 0.0, 0.0], FIX, estimate)
    assert not fix.accepted
    assert fix.estimate is estimate
    assert fix.distance == pytest.approx(1.0 / (0.01 + FIX[0, 0]))


@pytest.mark.parametrize(("change", "words"), [
    ({"slip": -1.0}, "slip: expected a density of at least zero, found -1.0"),
    ({"slip": 0.0}, "expected one of them above zero"),
    ({"gyro": 0.0}, "gyro: expected a density above zero"),
    ({"gate": 1.0}, "gate: expected a probability"),
])  # fmt: skip
def test_wrong_densities_are_refused(change, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        PoseFilter(odometry(), **{"slip": SLIP, **change})


def test_wrong_measurements_are_refused():
    filter = PoseFilter(odometry(), SLIP)
    estimate = filter.initial_state(1.0, angles(0, 0), [0, 0, 0])
    with pytest.raises(rnc.ConfigurationError, match="give the density 'gyro'"):
        filter.predict(2.0, angles(0, 0), estimate, 0.1)
    with pytest.raises(rnc.InputError, match="time runs backwards"):
        filter.predict(0.5, angles(0, 0), estimate)
    with pytest.raises(rnc.InputError, match="turn_rate: expected a finite number, found nan"):
        PoseFilter(odometry(), SLIP, gyro=0.01).predict(2.0, angles(0, 0), estimate, np.nan)
    with pytest.raises(rnc.InputError, match=r"fix: expected \(x, y\) or"):
        filter.correct([1.0], np.eye(1), estimate)
    with pytest.raises(rnc.InputError, match="without negative eigenvalues"):
        filter.correct([1.0, 0.0], -np.eye(2), estimate)
    with pytest.raises(rnc.InputError, match=r"covariance: expected finite numbers \(4, 4\)"):
        filter.initial_state(0.0, angles(0, 0), [0, 0, 0], np.eye(3))
