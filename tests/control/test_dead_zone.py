"""Trackers and estimators under noise and delay: dead zones, and gains that know how late the loop is."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control.dead_zone import apply_dead_zone
from rnc_pin.control.estimation import adapt
from rnc_pin.plants import Faults, FaultyPlant, ReducedPlant


@pytest.fixture(scope="module")
def sleigh():
    return systems.sleigh()


# ---------------------------------------------------------------------- dead zones


def test_what_is_beyond_a_zone_is_no_longer_than_the_true_error():
    """Noise within the zone is taken away: zero, or the true error shortened, entry by entry."""
    generator, zone = np.random.default_rng(0), np.array([0.1, 0.5, 0.0])
    true = generator.normal(size=(1000, 3))
    learnt_from = apply_dead_zone(true + zone * generator.uniform(-1, 1, size=true.shape), zone)
    share = learnt_from / true
    assert share.min() >= 0.0
    assert share.max() <= 1.0 + 1e-12
    assert np.abs(true - learnt_from).max() <= 2 * zone.max() + 1e-12
    np.testing.assert_array_equal(apply_dead_zone(true, 0.0), true)


def test_estimates_do_not_drift_within_the_dead_zone_and_never_away_from_the_truth():
    """Against (20) as it is, whose estimates end somewhere in the noise."""
    generator, p, dt = np.random.default_rng(3), np.array([1.0, 2.0]), 1e-3
    guess, ends, low, high = p + np.array([0.3, -0.4]), [], np.zeros(2), np.full(2, 9.0)
    for zone in (0.0, 0.05):
        estimate, distance = guess, np.linalg.norm(guess - p)
        for _ in range(5000):
            W = generator.normal(size=(2, 2))
            error = W @ (p - estimate) + 0.05 * generator.uniform(-1, 1, size=2)
            estimate = adapt(estimate, W, error, 5.0, dt, low, high, zone)
            now = np.linalg.norm(estimate - p)
            assert zone == 0.0 or now <= distance + 1e-4
            distance = now
        ends.append(distance)
    assert ends[1] < 0.1
    W = np.eye(2)
    np.testing.assert_array_equal(adapt(p, W, np.array([0.04, -0.05]), 5.0, dt, low, high, 0.05), p)


# ---------------------------------------------------------------------- delay


def late(sleigh, ticks, dt=0.01, **told):
    swing = rnc.planning.MinimumJerk([0.0, 0.0], [1.0, 0.8], duration=2.0)
    target = rnc.control.ReducingOutputController(sleigh, swing, k2=2.0)
    q0 = sleigh.robot.configuration()
    tracker = rnc.tuned_tracker(sleigh, target, q0, 2.0, dt, **told)
    plant = FaultyPlant(ReducedPlant(sleigh), Faults(delay=ticks), sleigh, dt)
    return rnc.simulate(sleigh, tracker, q0, 4.0, dt, plant=plant)


def test_gains_that_know_the_delay_survive_it(sleigh):
    """The default rate is 20/s: with 8 samples of delay, and half a one, 20 * 0.085 is more than pi / 2."""
    with pytest.raises(rnc.DivergenceError):
        late(sleigh, 8)
    run = late(sleigh, 8, delay=0.08)
    np.testing.assert_allclose(run.x2[-1], [1.0, 0.8], atol=0.01)


def test_a_scenario_says_delay_and_dead_zone():
    changes = {"controller.delay": 0.012, "controller.dead_zone": 0.01, "comparisons": {}}
    gains = [Scenario.load("unicycle", each).experiment.controller.gains for each in ({"comparisons": {}}, changes)]
    assert (gains[1].k < gains[0].k).all()
    assert gains[1].dead_zone == gains[1].describe()["dead_zone"] == 0.01
    assert "dead_zone" not in gains[0].describe()
    with pytest.raises(rnc.ConfigurationError, match=r"dead_zone"):
        Scenario.load("unicycle", {"controller.dead_zone": -1.0}).build()
    with pytest.raises(rnc.ConfigurationError, match=r"delay.*belongs to the preset 'scaled'"):
        Scenario.load("unicycle", {"controller.delay": 0.01, "controller.preset": "paper"}).build()
