"""Coordinates about a configuration: closed forms of bases, Pinocchio's differences of joints, and derivatives."""

import numpy as np
import pinocchio as pin
import pytest

from rnc_pin.model.coordinates import PlacementChart

STEP = 1e-6


def model_of(base):
    model = pin.Model()
    for k, kind in enumerate((base, pin.JointModelRX(), pin.JointModelRUBY(), pin.JointModelSpherical())):
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
        relative = data.oMi[1].inverse() * there.oMi[1]
        if base.shortname() == "JointModelPlanar":
            yaw = np.arctan2(relative.rotation[1, 0], relative.rotation[0, 0])
            np.testing.assert_allclose(found[k, :3], [*relative.translation[:2], yaw], atol=1e-13)
        elif base.shortname() == "JointModelFreeFlyer":
            np.testing.assert_allclose(found[k, :3], relative.translation, atol=1e-13)
            np.testing.assert_allclose(found[k, 3:6], pin.log3(relative.rotation), atol=1e-12)
        np.testing.assert_allclose(found[k, base.nv :], pin.difference(model, center, each)[base.nv :], atol=1e-13)
        for v, column in zip(np.eye(model.nv), J[k].T, strict=True):
            ahead, behind = (chart.coordinates(pin.integrate(model, each, s * STEP * v)[None])[0] for s in (1, -1))
            np.testing.assert_allclose(column, (ahead - behind) / (2 * STEP), atol=1e-8)
