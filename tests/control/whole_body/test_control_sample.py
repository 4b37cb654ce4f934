"""The predicted end of a sample, beside Pinocchio's own integration."""

import numpy as np
import pinocchio as pin
import pytest

from rnc_pin.control.whole_body import ControlSample
from systems import mobile_manipulator, random_states, spinning_space_robot


@pytest.mark.parametrize("system", [mobile_manipulator, spinning_space_robot])
def test_the_end_is_where_the_commanded_velocity_leads(system):
    reduced, dt = system(), 0.01
    for q, v2 in random_states(reduced, 3, seed=2):
        sample = ControlSample(reduced, 1.5, q, v2, dt)
        v = reduced.at(q).R @ v2 + reduced.at(q).b
        np.testing.assert_allclose(sample.end.q, pin.integrate(reduced.robot.model, q, dt * v), atol=1e-12)
        np.testing.assert_allclose(sample.start.v, v, atol=1e-12)
        np.testing.assert_array_equal(sample.end.v2, v2)
        assert (sample.time, sample.dt) == (1.51, dt)
