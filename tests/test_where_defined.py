"""How near to where something has no meaning it still has one, and that it is right there."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics


def tilted(angle):
    """A body whose own x axis stands up, but for an angle."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "body")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("top", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    q = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, angle - np.pi / 2, 0.7)).coeffs()
    return rnc.Robot(model), q


def apart(distance):
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("end", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return rnc.Robot(model), np.array([distance])


KINDS = {
    "yaw": (rnc.FrameYaw("top"), tilted, 1e-6, "a yaw is not defined for a vertical axis"),
    "tilt": (rnc.FrameTilt("top", "x"), tilted, 1e-6, "the tilt of a vertical axis has no rate"),
    "wheel": (rnc.RollingWheel("top", 0.1, axis="x"), tilted, 1e-6, "a wheel lies flat on the ground"),
    "distance": (rnc.Distance("universe", "end"), apart, 1e-9, "a distance has no rate where it is zero"),
}


@pytest.mark.parametrize(("kind", "robot_at", "limit", "words"), KINDS.values(), ids=KINDS)
def test_rates_are_right_down_to_a_limit(kind, robot_at, limit, words):
    """Beside differences of the value where there is one; below the limit they are refused, with its share."""
    robot, q = robot_at(10 * limit)
    rows = kind.bind(robot)
    found = rows.jacobian(Kinematics(robot).position(q))
    if hasattr(rows, "value"):
        for axis, column in zip(np.eye(robot.nv), found.T, strict=True):
            step = limit * axis
            ahead, behind = (
                rows.value(Kinematics(robot).position(pin.integrate(robot.model, q, sign * step))) for sign in (1, -1)
            )
            np.testing.assert_allclose((ahead - behind) / (2 * limit), column, rtol=0.02, atol=1e-3)
    robot, q = robot_at(0.2 * limit)
    with pytest.raises(rnc.SingularityError, match=words) as told:
        kind.bind(robot).jacobian(Kinematics(robot).position(q))
    assert told.value.condition == pytest.approx(5.0 / limit, rel=1e-3)
    np.testing.assert_array_equal(told.value.q, q)
