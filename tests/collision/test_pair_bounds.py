"""Support functions against points on the surfaces, and against coal's distances to a half space."""

import coal
import numpy as np
import pinocchio as pin
import pytest

from rnc_pin.collision.pair_bounds import support
from rnc_pin.collision.shapes import hull_of
from tolerances import ROUNDING

HULL = hull_of(np.random.default_rng(0).normal(size=(40, 3)), "hull")
SHAPES = [
    coal.Box(0.2, 0.4, 0.7), coal.Sphere(0.3), coal.Capsule(0.1, 0.5), coal.Cylinder(0.2, 0.6), coal.Cone(0.3, 0.5),
    coal.Ellipsoid(0.2, 0.3, 0.5), HULL,
]  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_support_is_the_depth_below_a_plane(shape):
    """coal's distance to a half space is exact up to rounding."""
    generator, request, result = np.random.default_rng(4), coal.DistanceRequest(), coal.DistanceResult()
    directions = generator.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for direction, found in zip(directions, support(shape, directions), strict=True):
        result.clear()
        plane = coal.Halfspace(-direction, -10.0)  # 10 m away along the direction
        apart = coal.distance(shape, coal.Transform3s(), plane, coal.Transform3s(), request, result)
        assert found == pytest.approx(10.0 - apart, abs=ROUNDING)


def test_a_half_space_is_bounded_along_its_normal_alone():
    normal = pin.rpy.rpyToMatrix(0.3, 0.2, 0.1)[:, 2]
    found = support(coal.Halfspace(normal, 0.4), np.array([normal, -normal, [1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(found, [0.4, np.inf, np.inf])
