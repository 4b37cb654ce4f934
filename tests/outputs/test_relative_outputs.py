"""Angles and angular velocities of a frame relative to another, beside rotation matrices and differences."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics
from row_kinds import PAIRS
from systems import bicycle
from tolerances import FINITE_DIFFERENCE, ROUNDING

STEP = 1e-4  # [s]; differences of the fourth order


@pytest.fixture(scope="module")
def arm():
    return bicycle().robot  # wheels that turn and steer: their relative rotation is about all axes


@pytest.fixture(scope="module")
def states(arm):
    generator = np.random.default_rng(4)
    return [(arm.random_configuration(generator), generator.uniform(-1, 1, arm.nv)) for _ in range(4)]


def rotations(robot, q, *frames):
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return [data.oMf[robot.frame_id(frame)].rotation.copy() for frame in frames]


def rate(robot, function, q, v):
    """Rate of an array along v, by differences."""
    near, far = (
        (function(pin.integrate(robot.model, q, h * v)) - function(pin.integrate(robot.model, q, -h * v))) / (2 * h)
        for h in (STEP, 2 * STEP)
    )
    return (4 * near - far) / 3


@pytest.mark.parametrize(("frame", "reference"), PAIRS)
@pytest.mark.parametrize(("axis", "about"), [("x", "z"), ("y", "z"), ("z", "x"), ("x", "y"), ("y", "y")])
def test_an_angle_is_that_of_a_rotation_matrix(frame, reference, axis, about, arm, states):
    rows = rnc.RelativeAngle(frame, reference, axis, about).bind(arm)
    assert rows.angular == (True,)
    last = "xyz".index(about)
    first, second = (last + 1) % 3, (last + 2) % 3
    for q, _ in states:
        turned, other = rotations(arm, q, frame, reference)
        column = other.T @ turned[:, "xyz".index(axis)]
        at = Kinematics(arm).position(q)
        assert rows.value(at) == pytest.approx(np.arctan2(column[second], column[first]), abs=ROUNDING)


@pytest.mark.parametrize(("frame", "reference"), [*PAIRS, ("universe", "front")])
@pytest.mark.parametrize("axis", "xyz")
def test_a_relative_angular_velocity_is_that_of_a_rotation_matrix(frame, reference, axis, arm, states):
    rows = rnc.RelativeAngularVelocity(frame, reference, axis).bind(arm)
    assert rows.quasi
    for q, v in states:
        # The rotation of the reference in the axes of the frame has the opposite rate.
        def back(p):
            turned, other = rotations(arm, p, frame, reference)
            return other.T @ turned

        spin = back(q).T @ rate(arm, back, q, v)
        expected = {"x": spin[2, 1], "y": spin[0, 2], "z": spin[1, 0]}[axis]
        assert rows.jacobian(Kinematics(arm).position(q)) @ v == pytest.approx(expected, abs=FINITE_DIFFERENCE)


def test_the_angle_in_the_world_is_the_yaw(arm, states):
    relative, yaw = rnc.RelativeAngle("front", "universe").bind(arm), rnc.FrameYaw("front").bind(arm)
    for q, _ in states:
        at = Kinematics(arm).position(q)
        np.testing.assert_allclose(relative.value(at), yaw.value(at), atol=ROUNDING)
        np.testing.assert_allclose(relative.jacobian(at), yaw.jacobian(at), atol=ROUNDING)


def test_an_angle_along_the_axis_is_singular_and_one_to_itself_is_refused(arm):
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    rows = rnc.RelativeAngle("tip", "platform_body", "z").bind(robot)
    with pytest.raises(rnc.SingularityError, match="not defined for a direction along it"):
        rows.jacobian(Kinematics(robot).position(robot.configuration()))
    with pytest.raises(rnc.ConfigurationError, match="angle of frame 'front' relative to itself"):
        rnc.RelativeAngle("front", "front").bind(arm)
    with pytest.raises(rnc.ModelError, match=r"no frame 'frnt'.*did you mean 'front'"):
        rnc.RelativeAngularVelocity("front", "frnt").bind(arm)
