"""Numbers that PairMeasurement reads, against coal's and closed forms."""

import coal
import numpy as np
import pytest

from rnc_pin.collision.pairs import LinkPair, PairMeasurement
from rnc_pin.errors import SimulationError

SHAPES = [coal.Sphere(0.3), coal.Box(0.4, 0.6, 0.8), coal.Cylinder(0.2, 0.5), coal.Capsule(0.1, 0.7), coal.Sphere(0.2)]
PAIRS = [LinkPair(a, b, (f"{a}", f"{b}")) for a in range(5) for b in range(a + 1, 5)]


@pytest.fixture
def placed():
    generator = np.random.default_rng(5)
    rotations = np.linalg.qr(generator.standard_normal((5, 3, 3)))[0]
    rotations *= np.linalg.det(rotations)[:, None, None]
    origins = generator.uniform(-0.6, 0.6, (5, 3))
    origins[4] = origins[1]  # a sphere inside a box
    measurement = PairMeasurement(SHAPES, PAIRS)
    measurement.place(range(len(PAIRS)), rotations, origins)
    return measurement


def test_memory_has_the_numbers_of_the_attributes(placed, monkeypatch):
    assert placed._memory is not None
    found = placed.measure([3, 0, 6, 9, 8])
    assert found[2, 0] < 0 < found[1, 0]
    monkeypatch.setattr(placed, "_memory", None)
    np.testing.assert_array_equal(found, placed.measure([3, 0, 6, 9, 8]))


@pytest.mark.parametrize("memory", [True, False])
def test_a_failed_search_of_a_depth_is_an_error(placed, monkeypatch, memory):
    monkeypatch.setattr(coal, "distance", lambda *given: -np.finfo(float).max)
    if not memory:
        monkeypatch.setattr(placed, "_memory", None)
    with pytest.raises(SimulationError, match="no penetration depth of 0 / 4"):
        placed.measure([3])


def test_wheels_that_touch_have_distance_0_at_every_turn():
    """Two wheels of 0.1 m whose axles are 0.2 m apart: coal fails with its finest tolerance in 1 of 100 poses."""
    generator = np.random.default_rng(0)
    measurement = PairMeasurement([coal.Cylinder(0.1, 0.04)] * 2, [LinkPair(0, 1, ("front", "rear"))])
    for _ in range(1000):
        turned = np.linalg.qr(generator.standard_normal((3, 3)))[0]
        turned[:, 0] *= np.linalg.det(turned)
        turns = ((np.cos(a), np.sin(a)) for a in generator.uniform(-3, 3, 2))
        rolled = [[[c, -s, 0], [s, c, 0], [0, 0, 1]] for c, s in turns]
        middle = generator.standard_normal(3)
        measurement.place([0], turned @ rolled, np.array([middle, middle + 0.2 * turned[:, 0]]))
        assert abs(measurement.measure([0])[0, 0]) < 1e-6
