"""Trackers and estimators under noise and delay: dead zones, and gains that know how late the loop is."""

from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.control import PositionGains, PositionTracker, VelocityGains, VelocityTracker
from rnc_pin.control.dead_zone import apply_dead_zone
from rnc_pin.control.estimation import adapt
from rnc_pin.plants import Faults, FaultyPlant, ReducedPlant
from rnc_pin.scenario.execution import execute, plan


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


def noisily(sleigh, tracker, noise, samples=3000):
    """Learnt gains of a tracker that follows a circle perfectly and measures it with bounded noise."""
    generator, dt = np.random.default_rng(1), 0.01
    m = sleigh.at(sleigh.robot.configuration(), [1.0, 0.5]).measure()
    state = tracker.initial_state(m)
    for k in range(samples):
        seen = m._replace(v2=m.v2 + noise * generator.uniform(-1, 1, size=2))
        _, state = tracker.step(k * dt, seen, state)
    return state


class Circle:
    """Asks for what is there."""

    def initial_state(self, measurement):
        return None

    def step(self, t, measurement, state):
        return rnc.control.VelocityTarget(v2=np.array([1.0, 0.5]), v2_dot=np.zeros(2)), None


def test_noise_within_the_dead_zone_teaches_a_velocity_tracker_nothing(sleigh):
    gains = VelocityGains(sigma=0.0)
    drifted = noisily(sleigh, VelocityTracker(Circle(), gains), 0.05)
    assert np.abs(drifted.g).max() > 0.01
    state = noisily(sleigh, VelocityTracker(Circle(), replace(gains, dead_zone=0.05)), 0.05)
    for learnt in (state.g, state.C, state.D):
        np.testing.assert_array_equal(learnt, 0.0)


def test_what_is_learnt_stays_within_the_dead_zone_and_grows_beyond_it(sleigh):
    tracker = VelocityTracker(Circle(), VelocityGains(dead_zone=np.array([0.1, 0.0])))
    m = sleigh.at(sleigh.robot.configuration(), [0.95, 0.45]).measure()
    state = tracker.initial_state(m)._replace(g=np.ones(2), time=0.0)
    _, state = tracker.step(0.01, m, state)
    assert state.g[0] == 1.0  # leak included
    assert state.g[1] > 1.0
    _, state = tracker.step(0.02, m._replace(v2=np.array([0.85, 0.45])), state)
    assert state.g[0] > 1.0


def test_a_position_tracker_learns_nothing_within_its_dead_zone(sleigh):
    generator, dt, learnt = np.random.default_rng(2), 0.01, []
    for zone in (0.0, 0.01):
        tracker = PositionTracker(rnc.planning.Hold(np.zeros(2)), PositionGains(dead_zone=zone))
        m = sleigh.at(sleigh.robot.configuration(), np.zeros(2)).measure(np.zeros(2))
        state = tracker.initial_state(m)
        for k in range(1000):
            x2 = 0.009 * generator.uniform(-1, 1, size=2)
            _, state = tracker.step(k * dt, m._replace(x2=x2), state)
        learnt.append(np.abs(state.f + tracker.gains.beta * state.e).max())
    assert learnt[0] > 1e-3
    assert learnt[1] < 1e-12


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


def test_rates_are_bounded_by_the_delay(sleigh):
    q = sleigh.robot.configuration()[None]
    for delay in (0.02, 0.2):
        gains = VelocityGains.scaled(sleigh, q, 0.002, slowest=0.1, delay=delay)
        rates = np.linalg.eigvals(np.linalg.solve(sleigh.at(q[0]).H, np.diag(gains.k)))
        np.testing.assert_allclose(np.abs(rates).max() * (delay + 0.001), np.pi / 4, rtol=1e-9)
    default, none = VelocityGains.scaled(sleigh, q, 0.002), VelocityGains.scaled(sleigh, q, 0.002, delay=0.0)
    np.testing.assert_array_equal(default.k, none.k)
    with pytest.raises(rnc.InfeasibleError, match=r"with a delay of 0.2 s allows"):
        VelocityGains.scaled(sleigh, q, 0.002, delay=0.2)
    with pytest.raises(rnc.ConfigurationError, match="delay of a loop"):
        VelocityGains.scaled(sleigh, q, 0.002, delay=-1.0)
    assert (
        PositionGains.scaled(np.eye(2)[None], 0.002, delay=0.004).k1 < PositionGains.scaled(np.eye(2)[None], 0.002).k1
    ).all()


def test_a_scenario_says_delay_and_dead_zone():
    changes = {"controller.delay": 0.012, "controller.dead_zone": 0.01, "comparisons": {}}
    gains = [plan("unicycle", each).experiment.controller.gains for each in ({"comparisons": {}}, changes)]
    assert (gains[1].k < gains[0].k).all()
    assert gains[1].dead_zone == gains[1].describe()["dead_zone"] == 0.01
    assert "dead_zone" not in gains[0].describe()
    with pytest.raises(rnc.ConfigurationError, match=r"dead_zone"):
        plan("unicycle", {"controller.dead_zone": -1.0})
    with pytest.raises(rnc.ConfigurationError, match=r"delay.*belongs to the preset 'scaled'"):
        plan("unicycle", {"controller.delay": 0.01, "controller.preset": "paper"})


def test_tiago_eight_ticks_late_holds_with_gains_that_know_it():
    """Without, it leaves its joint range at the largest inputs that it has."""
    late = {"comparisons": {}, "plots": {}, "faults.delay": 8, "simulation.duration": 1.4}
    runs = [execute(plan("tiago", {**late, **knows})).trajectory for knows in ({"controller.delay": 0.016}, {})]
    assert [str(run.outcome) for run in runs] == ["completed", "limit"]
    assert np.abs(runs[0].T).max() < 200.0 < 1000.0 < np.abs(runs[1].T).max()
