"""Regressors of unknown masses, radii and tracks."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame
from rnc_pin.control import MomentumRegressor, UnknownMass, UnknownRadius, UnknownTrack, WheelRegressor
from rnc_pin.control.regressors import _axles
from rnc_pin.model.kinematics import Kinematics
from systems import drifting_manipulator, free_flying_panda, space_robot
from textbook_systems import reduced_cart, two_wheeled_cart
from tolerances import ROUNDING


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
    estimated = robot.model.copy()
    regressor._set_parameters(estimated, np.full(2, 0.4))
    for joint, unit in zip(joints, (1.0, 0.25), strict=True):
        true, found = (model.inertias[robot.joint_id(joint)] for model in (robot.model, estimated))
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
    p, model = np.array([1.9, 0.3]), robot.model.copy()
    for joint, mass in (("foot", 0.95), ("knee", 0.9)):
        index = robot.joint_id(joint)
        old = model.inertias[index]
        model.inertias[index] = pin.Inertia(mass, old.lever, old.inertia * mass / old.mass)
    data, rows, generator = model.createData(), robot.velocity_indices("body"), np.random.default_rng(2)
    for _ in range(3):
        q, v = robot.random_configuration(generator), generator.normal(size=robot.nv)
        before = v.copy()
        y, Y = regressor.regress(q, v)
        np.testing.assert_array_equal(v, before)
        known = robot.model.copy()  # rates are those of the momentum under the inertia of the known bodies alone
        for joint in ("foot", "knee"):
            known.inertias[robot.joint_id(joint)] = pin.Inertia.Zero()
        A = pin.crba(known, known.createData(), q)[rows, rows]
        unit = np.eye(robot.nv)[rows]
        less, more = ([pin.computeKineticEnergy(model, data, q, v + s * e) for e in unit] for s in (-1, 1))
        np.testing.assert_allclose(A @ (y - Y @ p), np.subtract(more, less) / 2, atol=1e-9)


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


TURNED = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.4, 0.5), np.array([0.02, -0.03, 0.05]))


def test_a_track_that_no_row_depends_on_is_refused():
    """On a cart that only slides nothing tells how far apart its wheels are, though their radii enter."""
    reduced = reduced_cart(two_wheeled_cart())
    unknown = [UnknownRadius(["right"]), UnknownTrack(["left", "right"]), UnknownRadius(["left"])]
    with pytest.raises(rnc.ConfigurationError) as caught:
        WheelRegressor(reduced, unknown)
    assert str(caught.value) == "no independent constraint row depends on the track of left, right"
    radii = WheelRegressor(reduced, unknown[::2])
    y, Y = radii.regress(np.array([0.4, 1.0, 2.0]), np.array([0.5, 7.0, 11.0]))
    order = [("rolling(left)", "rolling(right)").index(name) for name in radii.predicted]
    signs = np.sign(y)
    np.testing.assert_allclose(np.abs(y), 0.5)
    np.testing.assert_allclose(signs[:, None] * Y, np.array([[0.0, 7.0], [11.0, 0.0]])[order], atol=ROUNDING)
    one = WheelRegressor(reduced, unknown[2:])
    assert one.predicted == ("rolling(left)",)
    assert one.regress(np.zeros(3), np.array([0.5, 7.0, 11.0]))[1].shape == (1, 1)


def test_an_axle_is_one_whichever_wheel_is_named_first():
    """The centre of each wheel is its middle and half the track to its own side; the joint stands beside it."""
    left, right, off = (0.15, 0.35, 0.22), (0.1, -0.25, 0.2), (0.0, 0.07, 0.0)
    robot = two_wheeled_cart(pin.JointModelFreeFlyer(), left=left, right=right, off=off)
    centres = {"left": np.array([0.15, 0.42, 0.22]), "right": np.array([0.1, -0.25, 0.2])}
    track = np.linalg.norm(centres["left"] - centres["right"])
    for pair in (("left", "right"), ("right", "left")):
        axles = _axles(robot, 4, *pair)
        assert tuple(axles) == pair
        for wheel, axle in axles.items():
            assert (axle.column, axle.joint, axle.carrier) == (4, robot.joint_id(f"{wheel}_joint"), 1)
            np.testing.assert_allclose(axle.middle + track * axle.side, centres[wheel], atol=1e-15)
            np.testing.assert_allclose(axle.centre, [0.0, 0.07, 0.0] if wheel == "left" else np.zeros(3), atol=1e-15)
            assert np.linalg.norm(axle.side) == pytest.approx(0.5)


def assert_track(robot, wheels, exists, otherwise):
    """Both wheels have one axle, or are refused in these words."""
    if exists:
        assert set(_axles(robot, 0, *wheels)) == set(wheels)
        return
    with pytest.raises(rnc.ConfigurationError) as caught:
        _axles(robot, 0, *wheels)
    first, second = wheels
    assert str(caught.value) == f"unknown track: wheels '{first}' and '{second}' {otherwise}"


def test_wheels_at_one_place_or_off_their_axles_have_no_track():
    here, words = np.array([0.1, 0.3, 0.2]), "have the same position: the direction of their axle is undefined"
    for apart in (1e-6, 0.0):
        robot = two_wheeled_cart(left=here, right=here + np.array([0.0, 0.0, apart]))
        assert_track(robot, ("left", "right"), apart > 0, words)
    for aside in ((0.0, 0.4, 0.0), (0.01, 0.4, 0.0), (0.0, 0.0, -0.01)):
        words = "have no fixed track: frame 'left' is not on the axis of its joint"
        assert_track(two_wheeled_cart(off=aside), ("right", "left"), not any(aside[::2]), words)


@pytest.mark.parametrize("joint", [pin.JointModelSpherical(), pin.JointModelPlanar(), pin.JointModelPY()])
def test_a_wheel_that_does_more_than_turn_about_its_axle_has_no_fixed_track(joint):
    """On a ball it turns about all axes, in a plane it moves, on a rail it only slides."""
    model = two_wheeled_cart().model.copy()
    add_body(model, "ball", joint, 1.0, 1, at=TURNED, frame="loose")
    with pytest.raises(rnc.ConfigurationError, match="frame 'loose' is not on the axis of its joint"):
        _axles(rnc.Robot(model), 0, "left", "loose")


def test_two_wheels_of_one_joint_or_of_two_bodies_have_no_track():
    model = two_wheeled_cart().model.copy()
    add_frame(model, "outer", 2, (0.0, 0.1, 0.0))
    arm = model.addJoint(1, pin.JointModelRZ(), pin.SE3.Identity(), "arm")
    add_body(model, "far_joint", "RY", 1.0, arm, at=TURNED, frame="far")
    robot = rnc.Robot(model)
    for pair in (("left", "outer"), ("outer", "left"), ("left", "far"), ("far", "right")):
        assert_track(robot, pair, False, "do not turn on joints of their own on one body: they have no fixed track")


def test_unknown_wheels_say_which_rows_they_enter_and_no_others():
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    left, right = "left_wheel", "right_wheel"
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel(wheel, 0.1) for wheel in (left, right)])
    reduced = system.reduce()
    rolling = {left: f"rolling({left})", right: f"rolling({right})"}
    for unknown, names, rows in (
        ([UnknownRadius([left])], ("radius of left_wheel",), (rolling[left],)),
        ([UnknownRadius([right])], ("radius of right_wheel",), (rolling[right],)),
        ([UnknownTrack([left, right])], ("track of left_wheel, right_wheel",), tuple(rolling.values())),
        ([UnknownRadius([right]), UnknownTrack([left, right]), UnknownRadius([left])],
            ("radius of right_wheel", "track of left_wheel, right_wheel", "radius of left_wheel"),
            tuple(rolling.values())),
    ):  # fmt: skip
        regressor = WheelRegressor(reduced, unknown)
        assert (regressor.names, regressor.units) == (names, ("m",) * len(names))
        assert (regressor.predicted, regressor.predicted_units) == (rows, ("m/s",) * len(rows))
        q, v = robot.configuration({"root_joint": (0.3, 0.2, 0.7)}), reduced.at(robot.configuration(), [0.4, 0.9]).v
        assert regressor.regress(q, v)[1].shape == (len(rows), len(names))
    for unknown, words in (
        ([], "name at least one unknown radius or track"),
        ([UnknownTrack([left])], r"unknown track: expected two wheels, found \['left_wheel'\]"),
        ([UnknownTrack([left, right, left])], "unknown track: expected two wheels, found"),
        ([UnknownTrack([left, left])], "named twice"),
        ([UnknownTrack([left, right]), UnknownTrack([right, left])], "named twice"),
        ([UnknownTrack(left)], "unknown track: expected two wheels, found 'left_wheel'"),
        ([UnknownRadius([])], r"unknown radius: expected a list of wheels, found \[\]"),
        ([UnknownRadius([left, left])], "unknown radius: wheel 'left_wheel' is named twice"),
        ([UnknownRadius([left]), UnknownRadius([right, left])], "unknown radius: wheel 'left_wheel' is named twice"),
        ([UnknownRadius(["left_wheal"])], "unknown radius: no rolling wheel 'left_wheal'; did you mean 'left_wheel'"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=words):
            WheelRegressor(reduced, unknown)


@pytest.mark.parametrize("roller", [None, 0.7])
@pytest.mark.parametrize(("radii", "p"), [((), [0.6]), ((UnknownRadius(["left", "right"]),), [0.6, 0.2])])
def test_the_prediction_error_is_the_rate_of_the_rows_for_any_motion(roller, radii, p, generator):
    """Wheels that lean, with rollers or without: ``Y p - y = A v`` at the true radii and tracks."""
    robot = two_wheeled_cart(pin.JointModelFreeFlyer())
    wheels = [rnc.RollingWheel(name, 0.2, roller=roller) for name in ("left", "right")]
    reduced = rnc.NonholonomicSystem(robot, wheels).reduce()
    regressor = WheelRegressor(reduced, [UnknownTrack(["left", "right"]), *radii])
    np.testing.assert_allclose(regressor.values_of(rnc.NonholonomicSystem(robot, wheels)), p, atol=1e-15)
    places = [reduced.constraints.names.index(name) for name in regressor.predicted]
    for _ in range(4):
        q, v = robot.random_configuration(generator), generator.normal(size=robot.nv)
        y, Y = regressor.regress(q, v)
        rates = (reduced.constraints.jacobian(Kinematics(robot).position(q)) @ v)[places]
        np.testing.assert_allclose(Y @ p - y, rates, atol=1e-12)
