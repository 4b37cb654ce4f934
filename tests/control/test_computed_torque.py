"""Computed torque over a kinematic target."""

import numpy as np

from rnc_pin.control import ComputedTorque, VelocityTarget
from systems import random_states, space_robot


class Counting:
    """A target that is written down."""

    def initial_state(self, measurement):
        return 5

    def step(self, t, measurement, state):
        return VelocityTarget(
            np.array([0.4, -0.2, 0.3]), np.array([1.1, 0.7, -0.9]), estimates=np.array([t])
        ), state + 1


def test_computed_torque_makes_the_velocity_error_fade_at_its_gain():
    """Closed loop of the model under its force: ``v2_dot = v2d_dot + k (v2d - v2)``."""
    reduced, k = space_robot(), np.array([3.0, 7.0, 1.5])
    law = ComputedTorque(reduced, Counting(), k)
    for q, v2 in random_states(reduced, 3, condition=30.0):
        m = reduced.at(q, v2).measure()
        command, state = law.step(0.7, m, law.initial_state(m))
        assert state == 6
        rate = reduced.forward_dynamics(q, v2, reduced.allocate(q, command.F))
        np.testing.assert_allclose(rate, [1.1, 0.7, -0.9] + k * ([0.4, -0.2, 0.3] - v2), atol=1e-8)
        assert command.estimates.tolist() == [0.7]
        assert command.v2_desired.tolist() == [0.4, -0.2, 0.3]
    assert law.describe()["k"] == [3.0, 7.0, 1.5]
