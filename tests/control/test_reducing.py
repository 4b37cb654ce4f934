"""Reducing outputs follow a reference."""

from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import Cubic
from rnc_pin.control import ReducingOutputController
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.planning import Hold


@pytest.mark.parametrize("monitored", [False, True])
def test_reducing_outputs_follow_at_their_gains(monitored):
    """Angles by the shorter way; batches; what is monitored is said and moves nothing."""
    reference, k2 = Cubic([0.1, 2.9], [0.5, -0.8], [0.4, 0.3], [-0.7, 1.1]), np.array([1.7, 0.6])
    reduced = SimpleNamespace(r=2, reducing=SimpleNamespace(coordinates=Coordinates([False, True])))
    aside = (np.array([2, 0]), Hold([0.5, 0.6])) if monitored else None
    law = ReducingOutputController(reduced, reference, k2, aside)
    generator = np.random.default_rng(1)
    m = Measurement(x1=np.zeros((4, 3)), x2=generator.uniform(-2, 2, (4, 2)), v2=generator.normal(size=(4, 2)))
    target, state = law.step(0.3, m, law.initial_state(m))
    point = reference.at(0.3)
    error = point.position - m.x2
    error[:, 1] = np.angle(np.exp(1j * error[:, 1]))
    np.testing.assert_allclose(target.v2, point.velocity + k2 * error, rtol=1e-12)
    np.testing.assert_allclose(target.v2_dot, point.acceleration + k2 * (point.velocity - m.v2), rtol=1e-12)
    np.testing.assert_array_equal(target.x2, np.tile(point.position, (4, 1)))
    assert state is target.estimates is target.prediction_error is None
    if monitored:
        np.testing.assert_array_equal(target.x1, np.tile([0.6, np.nan, 0.5], (4, 1)))
    else:
        assert target.x1 is None
    with pytest.raises(rnc.ConfigurationError, match="the reducing reference has 3 values for 2 outputs"):
        ReducingOutputController(reduced, Hold(np.zeros(3)))
    assert law.describe() == {"type": "ReducingOutputController", "k2": [1.7, 0.6]}
