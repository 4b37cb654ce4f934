"""Coordinates about a configuration: closed forms of bases, Pinocchio's differences of joints, and derivatives."""

import numpy as np
import pinocchio as pin
import pytest

from rnc_pin.model.coordinates import ConfigurationManifold, PlacementChart, arc_chord, heading_of

STEP = 1e-6


def model_of(base):
    model = pin.Model()
    for k, kind in enumerate((pin.JointModelRX(), pin.JointModelRUBY(), base, pin.JointModelSpherical())):
        model.addJoint(k, kind, pin.SE3.Identity(), f"j{k}")
    return model


BASES = [pin.JointModelPlanar(), pin.JointModelFreeFlyer(), pin.JointModelPX()]


@pytest.mark.parametrize("base", BASES, ids=lambda base: base.shortname())
def test_coordinates_and_derivatives(base):
    model, generator = model_of(base), np.random.default_rng(0)
    center = pin.integrate(model, pin.neutral(model), generator.uniform(-1, 1, model.nv))
    chart = PlacementChart(model, center)
    np.testing.assert_allclose(chart.coordinates(center[None])[0], 0.0, atol=1e-15)
    q = np.array([pin.integrate(model, center, generator.uniform(-0.8, 0.8, model.nv)) for _ in range(3)])
    found, J = chart.coordinates(q), chart.jacobian(q)
    for k, each in enumerate(q):
        data, there = model.createData(), model.createData()
        pin.forwardKinematics(model, data, center)
        pin.forwardKinematics(model, there, each)
        relative = data.liMi[3].inverse() * there.liMi[3]
        if base.shortname() == "JointModelPlanar":
            yaw = np.arctan2(relative.rotation[1, 0], relative.rotation[0, 0])
            np.testing.assert_allclose(found[k, 2:5], [*relative.translation[:2], yaw], atol=1e-13)
        elif base.shortname() == "JointModelFreeFlyer":
            np.testing.assert_allclose(found[k, 2:5], relative.translation, atol=1e-13)
            np.testing.assert_allclose(found[k, 5:8], pin.log3(relative.rotation), atol=1e-12)
        others = np.r_[:2, 2 + base.nv : model.nv]
        np.testing.assert_allclose(found[k, others], pin.difference(model, center, each)[others], atol=1e-13)
        for v, column in zip(np.eye(model.nv), J[k].T, strict=True):
            ahead, behind = (chart.coordinates(pin.integrate(model, each, s * STEP * v)[None])[0] for s in (1, -1))
            np.testing.assert_allclose(column, (ahead - behind) / (2 * STEP), atol=1e-8)
    parts = np.array([0.0, 0.3, 1.0])
    between = ConfigurationManifold(model).interpolate(center, q[0], parts)
    np.testing.assert_allclose(between, [pin.interpolate(model, center, q[0], part) for part in parts], atol=1e-13)


@pytest.mark.parametrize("turn", [-3.0, -1e-3, 0.4, 2.5, 5.0])
def test_the_chord_of_an_arc_and_its_heading(turn):
    np.testing.assert_allclose(arc_chord(turn), [np.sin(turn) / turn, (1 - np.cos(turn)) / turn], atol=1e-12)
    yaw = heading_of(pin.rpy.rpyToMatrix(0.3, -0.4, turn))
    assert np.exp(1j * yaw) == pytest.approx(np.exp(1j * turn), abs=1e-14)
