"""Numbers that PairMeasurement reads, against coal's and closed forms."""

import coal
import numpy as np
import pytest

from rnc_pin.collision.pairs import LinkPair, PairMeasurement
from rnc_pin.errors import SimulationError


def test_a_failed_search_of_a_depth_is_an_error(monkeypatch):
    monkeypatch.setattr(coal, "distance", lambda *given: -np.finfo(float).max)
    measurement = PairMeasurement([coal.Sphere(0.3)] * 2, [LinkPair(0, 1, ("front", "rear"))])
    with pytest.raises(SimulationError, match="no penetration depth of front / rear"):
        measurement.measure(np.array([0]), np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)))


def test_wheels_that_touch_have_distance_0_at_every_turn(generator):
    """Two wheels of 0.1 m whose axles are 0.2 m apart: coal fails with its finest tolerance in 1 of 100 poses."""
    measurement = PairMeasurement([coal.Cylinder(0.1, 0.04)] * 2, [LinkPair(0, 1, ("front", "rear"))])
    for _ in range(1000):
        turned = np.linalg.qr(generator.standard_normal((3, 3)))[0]
        turned[:, 0] *= np.linalg.det(turned)
        turns = ((np.cos(a), np.sin(a)) for a in generator.uniform(-3, 3, 2))
        rolled = [[[c, -s, 0], [s, c, 0], [0, 0, 1]] for c, s in turns]
        middle = generator.standard_normal(3)
        origins = np.array([middle, middle + 0.2 * turned[:, 0]])
        assert abs(measurement.measure(np.array([0]), turned @ rolled, origins)[0, 0]) < 1e-6
