"""Learning while actuators give less than they are asked for: nothing that would ask for more."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.control import PositionGains, PositionTracker, VelocityGains, VelocityTarget, VelocityTracker
from rnc_pin.control.windup import saturation_mask
from rnc_pin.planning import Hold


@pytest.mark.parametrize("deficit", [-2.5, -0.5, 0.0, 0.5, 2.5])
@pytest.mark.parametrize("added", [-2.5, -0.5, 0.0, 0.5, 2.5])
def test_the_mask_has_outputs_whose_force_would_grow_towards_the_deficit(deficit, added):
    expected = (deficit > 0 and added > 0) or (deficit < 0 and added < 0)
    assert saturation_mask(np.array([deficit]), np.array([added])).tolist() == [expected]


class Ahead:
    """Every rate 0.2 below what is wanted."""

    def initial_state(self, measurement):
        return None

    def step(self, t, measurement, state):
        return VelocityTarget(v2=measurement.v2 + 0.2, v2_dot=np.array([0.3, -0.1, 0.4])), None


def test_a_velocity_tracker_stops_learning_where_a_force_is_missing_and_only_there():
    tracker = VelocityTracker(Ahead(), VelocityGains(k=10.0, beta=10.0, sigma=0.5))
    seen = rnc.Measurement(x2=np.zeros(3), v2=np.array([0.1, 0.2, -0.3]))
    _, state = tracker.step(0.0, seen, tracker.initial_state(seen))
    _, state = tracker.step(0.1, seen, state)
    _, free = tracker.step(0.2, seen, state)
    _, held = tracker.step(0.2, seen._replace(force_deficit=np.array([3.0, -3.0, 0.0])), state)
    for before, unbounded, found in zip(state[1:4], free[1:4], held[1:4], strict=True):
        np.testing.assert_array_equal(found[0], before[0])  # its leak included
        np.testing.assert_array_equal(found[1:], unbounded[1:])
        assert (unbounded[0] != before[0]).all()


def test_a_position_tracker_stops_learning_where_a_force_is_missing_and_only_there():
    """The force that is learnt, f, stays: what is primed of it and what the error adds."""
    tracker = PositionTracker(Hold([0.5, 0.5, 0.5]), PositionGains.paper())
    seen = rnc.Measurement(x2=np.zeros(3))
    _, state = tracker.step(0.0, seen, tracker.initial_state(seen))
    _, state = tracker.step(0.1, seen, state)
    _, free = tracker.step(0.2, seen, state)
    _, held = tracker.step(0.2, seen._replace(force_deficit=np.array([3.0, -3.0, 0.0])), state)
    assert free.f[0] > state.f[0]  # the error has not changed, so that f alone is learnt
    assert held.f[0] == pytest.approx(state.f[0], abs=1e-14)
    np.testing.assert_array_equal(held.f[1:], free.f[1:])
