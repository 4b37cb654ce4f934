"""Closed forms of the exponential map against Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from drawn_motions import random_joint
from rnc_pin.model.configuration_manifold import ConfigurationManifold
from tolerances import ROUNDING

CLOSED = [pin.JointModelRX, pin.JointModelPlanar, pin.JointModelRUBZ, pin.JointModelTranslation]


@pytest.mark.parametrize("seed", range(30))
def test_maps_are_those_of_pinocchio(seed):
    """Trees of joints with closed forms, and with any others; turns of more than half a circle and none at all."""
    generator, model = np.random.default_rng(seed), pin.Model()
    for parent in range(3):
        closed = CLOSED[generator.integers(len(CLOSED))]()
        model.addJoint(parent, closed if seed % 3 else random_joint(generator), pin.SE3.Identity(), f"joint {parent}")
    manifold, n = ConfigurationManifold(model), 6
    start = np.array(
        [pin.integrate(model, pin.neutral(model), 3.0 * generator.normal(size=model.nv)) for _ in range(n)]
    )
    step = 3.0 * generator.normal(size=(n, model.nv))
    step[-1] = 0.0
    end = np.array([pin.integrate(model, *each) for each in zip(start, step, strict=True)])
    np.testing.assert_allclose(manifold.integrate(start, step), end, atol=ROUNDING)
    found = manifold.difference(start, end)
    np.testing.assert_allclose(
        found, [pin.difference(model, *each) for each in zip(start, end, strict=True)], atol=ROUNDING
    )
    parts = generator.uniform(size=n)
    expected = [pin.interpolate(model, *each) for each in zip(start, end, parts, strict=True)]
    np.testing.assert_allclose(manifold.interpolate(start, end, parts), expected, atol=ROUNDING)
    along = manifold.interpolate(start[0], end[0], parts)
    np.testing.assert_allclose(along, [pin.interpolate(model, start[0], end[0], part) for part in parts], atol=ROUNDING)
