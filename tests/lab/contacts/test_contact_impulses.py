"""Impulses of contacts that push: conditions of the complementarity problem, and impacts by hand."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.lab.contacts.contact_impulses import FrictionGroup, FrictionImpulses, RigidImpulses


def problem(kind, friction, seed):
    """Two contacts of three rows each of a random body with six degrees of freedom."""
    generator = np.random.default_rng(seed)
    rows = generator.normal(size=(6, 6))
    groups = [FrictionGroup(slice(1, 3), 0, friction), FrictionGroup(slice(4, 6), 3, friction)]
    G, b = rows @ rows.T, generator.normal(size=6) - [1, 0, 0, 1, 0, 0]
    return G, b, groups, kind(G, b, [0, 3], groups)


@pytest.mark.parametrize("seed", range(8))
def test_conditions_with_a_coefficient_of_friction(seed):
    G, b, groups, impulses = problem(FrictionImpulses, 0.3, seed)
    p = impulses.solve()
    y = G @ p + b
    assert min(*p[[0, 3]], *y[[0, 3]]) > -1e-9
    assert np.abs(p * y)[[0, 3]].max() < 1e-9
    for each in groups:
        force, slip, limit = p[each.rows], y[each.rows], 0.3 * p[each.normal]
        assert np.linalg.norm(force) <= limit + 1e-9
        np.testing.assert_allclose(np.linalg.norm(slip) * force, -limit * slip, atol=1e-9)


def test_conditions_without_slip():
    refused = 0
    for seed in range(30):
        G, b, groups, impulses = problem(RigidImpulses, np.inf, seed)
        try:
            p = impulses.solve()
        except rnc.SimulationError:
            refused += 1
            continue
        y = G @ p + b
        assert min(*p[[0, 3]], *y[[0, 3]]) > -1e-7
        for each in groups:
            closed = abs(y[each.normal]) < 1e-7
            assert np.abs((y if closed else p)[each.rows]).max() < 1e-7
    assert 0 < refused < 20


@pytest.mark.parametrize(("kind", "friction"), [(FrictionImpulses, 0.3), (RigidImpulses, np.inf)])
def test_rebounds_do_not_create_energy(kind, friction):
    for seed in range(20):
        G, b, _, impulses = problem(kind, friction, seed)
        try:
            p = impulses.impact(np.array([0.5, 1.0]))
        except rnc.SimulationError:
            continue
        assert p @ (G @ p / 2 + b) < 1e-9
