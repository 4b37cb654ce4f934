"""Regressors of unknown wheels and masses, and estimators over them: refusals in full, thresholds from both sides."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame
from rnc_pin.control import UnknownRadius, UnknownTrack, WheelRegressor
from rnc_pin.control.wheel_regressor import _axles
from rnc_pin.model.kinematics import Kinematics
from textbook_systems import reduced_cart, two_wheeled_cart
from tolerances import ROUNDING

# ---------------------------------------------------------------------- wheels

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
    robot = two_wheeled_cart(
        pin.JointModelFreeFlyer(), left=(0.15, 0.35, 0.22), right=(0.1, -0.25, 0.2), off=(0.0, 0.07, 0.0)
    )
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
def test_the_prediction_error_is_the_rate_of_the_rows_for_any_motion(roller, radii, p):
    """Wheels that lean, with rollers or without: ``Y p - y = A v`` at the true radii and tracks."""
    robot = two_wheeled_cart(pin.JointModelFreeFlyer())
    wheels = [rnc.RollingWheel(name, 0.2, roller=roller) for name in ("left", "right")]
    reduced = rnc.NonholonomicSystem(robot, wheels).reduce()
    regressor = WheelRegressor(reduced, [UnknownTrack(["left", "right"]), *radii])
    np.testing.assert_allclose(regressor.values_of(rnc.NonholonomicSystem(robot, wheels)), p, atol=1e-15)
    places = [reduced.constraints.names.index(name) for name in regressor.predicted]
    generator = np.random.default_rng(0)
    for _ in range(4):
        q, v = robot.random_configuration(generator), generator.normal(size=robot.nv)
        y, Y = regressor.regress(q, v)
        rates = (reduced.constraints.jacobian(Kinematics(robot).position(q)) @ v)[places]
        np.testing.assert_allclose(Y @ p - y, rates, atol=1e-12)
