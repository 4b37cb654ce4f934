"""Bodies on the ground: which they are, and where they look, held against outputs of the same frames."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import frame_placement
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.simulation.derived_quantities import ground_bodies
from systems import fire_truck, free_flying_panda, space_robot


def poses(reduced, q):
    bodies, at = ground_bodies(reduced), reduced.at(q).position
    return {body.name: body.poses(at) for body in bodies}


def test_a_steered_vehicle_is_its_chassis_not_its_forks():
    reduced = Scenario.load("snakeboard").experiment.reduced
    q = reduced.robot.configuration({"root_joint": [1.0, 2.0, 0.5], "front_steering": 0.4, "back_steering": -0.2})
    assert {name: pose.round(12).tolist() for name, pose in poses(reduced, q).items()} == {"board": [1.0, 2.0, 0.5]}


def test_a_trailer_stands_on_its_axle_even_if_that_is_steered():
    reduced = fire_truck()
    q = reduced.robot.configuration({"root_joint": [0.0, 0.0, 0.3], "rear_steering": 0.4})
    axle = frame_placement(reduced.robot, q, "rear_axle").translation
    np.testing.assert_allclose(poses(reduced, q)["trailer"][:2], axle[:2], atol=1e-12)


def test_a_wheel_by_itself_looks_where_it_rolls():
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", radius=0.3, axis="y")])
    reduced = system.reduce([rnc.FrameAngularVelocity("disk", axis) for axis in "xyz"])
    for spin in (0.0, 1.0, 2.5):
        turned = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, 0.0, 0.7) @ pin.rpy.rpyToMatrix(0.0, spin, 0.0))
        q = robot.configuration({"root_joint": [0.2, 0.1, 0.3, *turned.coeffs()]})
        (pose,) = poses(reduced, q).values()
        np.testing.assert_allclose(pose, [0.2, 0.1, 0.7], atol=1e-9)


def test_a_ball_has_no_heading():
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    system = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", radius=0.3)])
    reduced = system.reduce([rnc.FrameAngularVelocity("ball", axis) for axis in "xyz"])
    (pose,) = poses(reduced, robot.configuration({"root_joint": [1.0, 2.0, 0.3, 0, 0, 0, 1]})).values()
    np.testing.assert_allclose(pose[:2], [1.0, 2.0])
    assert np.isnan(pose[2])


@pytest.mark.parametrize("base", ["planar", "free"])
def test_a_base_on_two_wheels_is_midway_between_them(base):
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base=base)
    wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
    reduced = rnc.NonholonomicSystem(robot, wheels).reduce()
    q = robot.configuration({"left_wheel_joint": 0.7, "right_wheel_joint": -0.4})
    ((_, pose),) = poses(reduced, q).items()
    np.testing.assert_allclose(pose, [0.0, 0.0, 0.0], atol=1e-12)


def test_what_does_not_touch_the_ground_is_not_there():
    assert (ground_bodies(space_robot()), ground_bodies(free_flying_panda())) == ((), ())
