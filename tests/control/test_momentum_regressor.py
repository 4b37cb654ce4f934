"""Regressors of unknown masses: momentum is linear in them."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.control import MomentumRegressor, UnknownMass
from systems import drifting_manipulator, free_flying_panda, space_robot


@pytest.mark.parametrize(("make", "base", "joints", "rates"), [
    (space_robot, "platform", ("joint_1", "joint_3"), ["rad/s"]),
    (drifting_manipulator, "root_joint", ("joint_1", "joint_2"), ["m/s", "m/s", "rad/s"]),
    (free_flying_panda, "root_joint", ("panda_joint2", "panda_joint7"), ["m/s"] * 3 + ["rad/s"] * 3),
], ids=["turning", "planar", "free"])  # fmt: skip
def test_unknown_masses_say_what_they_predict_in_units_of_their_own(make, base, joints, rates):
    """``y = Y p`` where the momentum is zero, with one mass in kg and one in units of 0.25 kg."""
    robot = make().robot
    regressor = MomentumRegressor(robot, base, [UnknownMass(joints[0]), UnknownMass(joints[1], unit=0.25)])
    size = len(rates)
    assert regressor.names == tuple(f"mass behind {joint}" for joint in joints)
    assert (regressor.units, regressor.predicted) == (("kg", "0.25 kg"), tuple(robot.velocity_names[:size]))
    assert regressor.predicted_units == tuple(rates)
    masses = np.array([robot.model.inertias[robot.joint_id(joint)].mass for joint in joints])
    generator, data = np.random.default_rng(3), robot.model.createData()
    for _ in range(3):
        q, v = robot.random_configuration(generator), generator.normal(size=robot.nv)
        A = pin.crba(robot.model, data, q)[:size]
        v[:size] = -np.linalg.solve(A[:, :size], A[:, size:] @ v[size:])
        y, Y = regressor.regress(q, v)
        np.testing.assert_allclose(Y @ (masses / [1.0, 0.25]), y, atol=1e-9 * (1 + np.abs(y).max()))
        assert np.abs(y).max() > 1e-4
    for index, unit in enumerate((1.0, 0.25)):
        true = robot.model.inertias[robot.joint_id(joints[index])]
        found = regressor.inertia(index, 0.4)
        assert found.mass == pytest.approx(0.4 * unit)
        np.testing.assert_allclose(found.lever, true.lever, atol=1e-12)
        np.testing.assert_allclose(found.inertia, true.inertia * found.mass / true.mass, atol=1e-12)


def arm_on_base(base=None, light=False):
    """A body that moves freely, or turns or slides, with three bodies in a chain on it: a turn, a ball, a slide."""
    model, generator = pin.Model(), np.random.default_rng(6)
    model.name, model.gravity.linear = "arm", np.zeros(3)
    parent = model.addJoint(0, base or pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    kinds = (("hip", pin.JointModelRX()), ("knee", pin.JointModelSpherical()), ("foot", pin.JointModelPZ()))
    for mass, (name, kind) in zip((7.0, 2.0, 3.0, 0.0 if light else 1.5), (("", None), *kinds), strict=True):
        if kind is not None:
            place = pin.SE3(pin.exp3(generator.uniform(-1, 1, 3)), generator.uniform(-0.5, 0.5, 3))
            parent = model.addJoint(parent, kind, place, name)
        inertia = np.diag([0.4, 0.5, 0.6]) * mass
        model.appendBodyToJoint(parent, pin.Inertia(mass, generator.uniform(-0.1, 0.1, 3), inertia), pin.SE3.Identity())
    if light:
        add_body(model, "tip", "RY", 1.0, parent)
    return rnc.Robot(model)


@pytest.mark.parametrize("base", [None, pin.JointModelPlanar(), pin.JointModelRZ(), pin.JointModelPX()])
def test_momentum_is_linear_in_masses_and_the_base_moves_as_it_is_conserved(base):
    """By the kinetic energy of a robot of other masses: ``dE/dv`` of the base is zero at the base's predicted rate."""
    robot = arm_on_base(base)
    unknown = [UnknownMass("foot", 0.5), UnknownMass("knee", 3.0)]
    regressor = MomentumRegressor(robot, "body", unknown)
    assert regressor.units == ("0.5 kg", "3 kg")
    p = np.array([1.9, 0.3])
    model = robot.model.copy()
    for joint, mass in (("foot", 0.95), ("knee", 0.9)):
        index = robot.joint_id(joint)
        old = model.inertias[index]
        model.inertias[index] = pin.Inertia(mass, old.lever, old.inertia * mass / old.mass)
    data, rows, generator = model.createData(), robot.velocity_indices("body"), np.random.default_rng(2)
    for _ in range(3):
        q, v = robot.random_configuration(generator), generator.normal(size=robot.nv)
        before = v.copy()
        W0, W = regressor.predict(q, v)
        y, Y = regressor.regress(q, v)
        np.testing.assert_array_equal(v, before)
        np.testing.assert_array_equal(Y, W)
        np.testing.assert_array_equal(y, v[rows] - W0)
        known = robot.model.copy()  # rates are those of the momentum under the inertia of the known bodies alone
        for joint in ("foot", "knee"):
            known.inertias[robot.joint_id(joint)] = pin.Inertia.Zero()
        A = pin.crba(known, known.createData(), q)[rows, rows]
        momentum = np.array(
            [
                (pin.computeKineticEnergy(model, data, q, v + e) - pin.computeKineticEnergy(model, data, q, v - e)) / 2
                for e in np.eye(robot.nv)[rows]
            ]
        )
        np.testing.assert_allclose(A @ (y - Y @ p), momentum, atol=1e-9)


def test_masses_that_cannot_be_estimated_are_refused():
    robot = arm_on_base(light=True)
    for unknown, error, words in (
        ([], rnc.ConfigurationError, "name at least one body of unknown mass"),
        ([UnknownMass("hip"), UnknownMass("foot")], rnc.ModelError, "body behind joint 'foot' has no mass to estimate"),
    ):
        with pytest.raises(error) as caught:
            MomentumRegressor(robot, "body", unknown)
        assert str(caught.value) == words
    regressor = MomentumRegressor(robot, "body", [UnknownMass("hip"), UnknownMass("tip")])
    assert regressor.names == ("mass behind hip", "mass behind tip")
    alone = rnc.Robot.from_urdf("space_robot.urdf")
    every = [UnknownMass(name) for name in alone.joint_names]
    with pytest.raises(rnc.ConfigurationError) as caught:
        MomentumRegressor(alone, "platform", every)
    assert str(caught.value) == "no body of known mass turns with joint 'platform'"
