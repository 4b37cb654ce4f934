"""Charts and integrators: against series, closed forms and step halving."""

from math import factorial

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.simulation.chart import Chart

JOINTS = {
    "planar": (pin.JointModelPlanar, slice(2, 3)),
    "spherical": (pin.JointModelSpherical, slice(0, 3)),
    "free": (pin.JointModelFreeFlyer, slice(3, 6)),
}


def one_joint(kind):
    model = pin.Model()
    joint = model.addJoint(0, JOINTS[kind][0](), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.array([0.1, 0.2, 0.3]), np.diag([1.0, 1.5, 2.0])), pin.SE3.Identity())
    return rnc.Robot(model)


@pytest.mark.parametrize("kind", JOINTS)
@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-4, 1e-3, 1e-2, 0.3, 0.999, 1.001, 2.5])
def test_charts_move_by_the_right_jacobian_of_the_exponential(kind, angle):
    """Against its series, sum of (-ad)^k / (k + 1)!; Pinocchio's own loses nine digits at 1e-4 rad."""
    robot = one_joint(kind)
    generator = np.random.default_rng(1)
    u, v = generator.normal(size=(2, robot.nv))
    turning = JOINTS[kind][1]
    u[turning] *= angle / np.linalg.norm(u[turning])
    ad = np.stack([bracket(kind, u, e) for e in np.eye(robot.nv)], axis=-1)
    jacobian = sum(np.linalg.matrix_power(-ad, k) / factorial(k + 1) for k in range(45))
    rate = Chart(robot).rate(robot.configuration(), u, v)
    np.testing.assert_allclose(jacobian @ rate, v, atol=1e-14)


def bracket(kind, x, y):
    if kind == "spherical":
        return np.cross(x, y)
    if kind == "free":
        return pin.Motion(x).cross(pin.Motion(y)).vector
    lift = lambda z: pin.Motion(np.array([z[0], z[1], 0]), np.array([0, 0, z[2]]))  # noqa: E731
    return lift(x).cross(lift(y)).vector[[0, 1, 5]]
