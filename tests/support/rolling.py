"""One rigid body that rolls, and the checks that rows of every rolling constraint pass."""

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics
from tolerances import FINITE_DIFFERENCE, ROUNDING

STEP = 1e-4  # [s]; differences of the fourth order
GRAVITY = np.array([0.0, 0.0, -9.81])


def rigid_body(mass=2.0, moments=(0.02, 0.03, 0.04), lever=(0.0, 0.0, 0.0), turned=(0.0, 0.0, 0.0), gravity=GRAVITY):
    """One body on a free base."""
    model = pin.Model()
    model.name = "body"
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    R = pin.rpy.rpyToMatrix(np.array(turned))
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.array(lever), R @ np.diag(moments) @ R.T), pin.SE3.Identity())
    model.addFrame(pin.Frame("body", joint, pin.SE3.Identity(), pin.FrameType.BODY))
    model.gravity.linear = gravity
    return rnc.Robot(model)


def slope(model, function, q, v):
    """Rate of an array along v, by differences."""
    near, far = (
        (function(pin.integrate(model, q, h * v)) - function(pin.integrate(model, q, -h * v))) / (2 * h)
        for h in (STEP, 2 * STEP)
    )
    return (4 * near - far) / 3


def check_rates(rows, robot, q, v):
    """Rates, bias acceleration and its gradient are those of differences; many states are as one."""
    model, kinematics = robot.model, Kinematics(robot)
    at = kinematics.position(q).with_velocity(v)
    if any(rows.holonomic):
        rate = slope(model, lambda p: rows.residual(kinematics.position(p)), q, v)
        kept = np.array(rows.holonomic)
        moved = rows.jacobian(at) @ v - rows.rate(at)
        np.testing.assert_allclose(rate[kept], moved[kept], atol=FINITE_DIFFERENCE)
    J_dot = slope(model, lambda p: rows.jacobian(kinematics.position(p)), q, v)
    mu_dot = slope(model, lambda p: rows.rate(kinematics.position(p)), q, v)
    np.testing.assert_allclose(rows.jacobian_dot(at), J_dot, atol=FINITE_DIFFERENCE)
    np.testing.assert_allclose(rows.rate_dot(at), mu_dot, atol=FINITE_DIFFERENCE)
    bias = rows.jacobian_dot(at) @ v - rows.rate_dot(at)
    np.testing.assert_allclose(rows.bias_acceleration(at), bias, atol=10 * ROUNDING)

    def biased(p):
        there = kinematics.position(p).with_velocity(v)
        return rows.jacobian_dot(there) @ v - rows.rate_dot(there)

    gradient = np.transpose([slope(model, biased, q, each) for each in np.eye(robot.nv)])
    np.testing.assert_allclose(rows.bias_acceleration_gradient(at), gradient, atol=10 * FINITE_DIFFERENCE)
    many = kinematics.position(np.stack([q, q])).with_velocity(np.stack([v, v]))
    for each in (rows.jacobian, rows.jacobian_dot, rows.rate, rows.rate_dot, rows.bias_acceleration, rows.residual):
        np.testing.assert_allclose(each(many), np.stack([each(at)] * 2), atol=ROUNDING)
    for both, one in zip(rows.lines_of_action(many), rows.lines_of_action(at), strict=True):
        np.testing.assert_allclose(both, np.stack([one] * 2), atol=ROUNDING)
