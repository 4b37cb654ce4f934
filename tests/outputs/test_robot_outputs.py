"""The centre of mass beside Pinocchio's own, and differences."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics
from tolerances import ROUNDING

ROBOTS = {
    "floating arm": lambda: rnc.Robot.from_urdf("floating_arm.urdf", base="free", gravity=(0, 0, 0)),
    "bicycle": lambda: rnc.Robot.from_urdf("bicycle.urdf", base="free"),
    "truck": lambda: rnc.Robot.from_urdf("fire_truck.urdf", base="planar"),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_the_centre_of_mass_is_pinocchios(name):
    robot = ROBOTS[name]()
    rows, kinematics = rnc.CenterOfMass().bind(robot), Kinematics(robot)
    assert rows.names == ("center_of_mass_x", "center_of_mass_y", "center_of_mass_z")
    generator, data = np.random.default_rng(5), robot.model.createData()
    for _ in range(3):
        q, v = robot.random_configuration(generator), generator.normal(size=robot.nv)
        at = kinematics.position(q).with_velocity(v)
        pin.centerOfMass(robot.model, data, q, v, np.zeros(robot.nv))
        np.testing.assert_allclose(rows.value(at), data.com[0], atol=ROUNDING)
        np.testing.assert_allclose(rows.jacobian(at) @ v, data.vcom[0], atol=ROUNDING)
        np.testing.assert_allclose(rows.bias_acceleration(at), data.acom[0], atol=100 * ROUNDING)
        np.testing.assert_allclose(rows.jacobian(at), pin.jacobianCenterOfMass(robot.model, data, q), atol=ROUNDING)


def test_a_free_robot_moves_its_centre_of_mass_as_gravity_says():
    """As a reducing output it obeys Newton's law: no torque of a joint moves it."""
    model = rnc.Robot.from_urdf("floating_arm.urdf", base="free").model.copy()
    model.gravity.linear = np.array([0.0, 0.0, -1.6])
    robot = rnc.Robot(model)
    others = [*(rnc.FrameAngularVelocity("satellite", axis) for axis in "xyz"), rnc.JointPosition("shoulder")]
    system = rnc.NonholonomicSystem(robot, [], ["shoulder", "elbow"])
    reduced = system.reduce([rnc.CenterOfMass(), *others, rnc.JointPosition("elbow")])
    generator = np.random.default_rng(0)
    q, v2 = robot.random_configuration(generator), generator.normal(size=8)
    found = reduced.forward_dynamics(q, v2, [3.0, -2.0])
    np.testing.assert_allclose(found[:3], [0.0, 0.0, -1.6], atol=1e-10)
    np.testing.assert_allclose(rnc.state_derivatives(reduced, q, v2, [3.0, -2.0]).v2_dot_q[:3], 0, atol=1e-8)


def test_axes_of_a_centre_of_mass():
    robot = ROBOTS["truck"]()
    assert rnc.CenterOfMass("yx").bind(robot).names == ("center_of_mass_y", "center_of_mass_x")
    words = "axes 'xx' of the centre of mass: name each of x, y, z at most once"
    with pytest.raises(rnc.ConfigurationError, match=words):
        rnc.CenterOfMass("xx").bind(robot)
