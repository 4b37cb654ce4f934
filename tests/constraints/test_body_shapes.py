"""Cylinders on their sides: closed forms, and mistakes; the cone is in benchmarks/validation."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rolling import rigid_body
from tolerances import ROUNDING


def test_a_cylinder_rolls_down_a_slope():
    """``s'' = g sin a / (1 + I / m r^2)`` across its axis, wherever its frame is."""
    radius, slope = 0.2, 0.3
    lying = pin.rpy.rpyToMatrix(np.pi / 2, 0.0, 0.0)
    for about in (0.5, 1.0):  # solid, and a thin tube
        moments = np.array([0.05, about * 2.0 * radius**2, 0.05])
        robot = rigid_body(2.0, moments)
        ground = rnc.GroundPlane(normal=(np.sin(slope), 0.0, np.cos(slope)))
        roller = rnc.RollingBody("body", rnc.Cylinder(radius, 0.5), rpy=(np.pi / 2, 0, 0), ground=ground)
        reduced = rnc.NonholonomicSystem(robot, [roller]).reduce([rnc.FrameAngularVelocity("body", "y")])
        np.testing.assert_allclose(pin.rpy.rpyToMatrix(np.array(roller.rpy)), lying)
        q = reduced.assembled(robot.configuration())
        expected = 9.81 * np.sin(slope) / (1.0 + about) / radius
        np.testing.assert_allclose(reduced.forward_dynamics(q, [0.0], []), [expected], rtol=1e-9)


def test_a_cylinder_on_a_conveyor_lies_still_or_turns_in_place():
    robot = rigid_body()
    belt = rnc.GroundPlane(velocity=(0.6, 0.0, 0.0))
    roller = rnc.RollingBody("body", rnc.Cylinder(0.2, 0.5, "y"), ground=belt)
    reduced = rnc.NonholonomicSystem(robot, [roller]).reduce([rnc.FrameAngularVelocity("body", "y")])
    q = robot.configuration({"root_joint": (0, 0, 0.2, 0, 0, 0, 1)})
    np.testing.assert_allclose(reduced.at(q, [-3.0]).v, [0, 0, 0, 0, -3.0, 0], atol=ROUNDING)


def test_mistakes_have_names():
    for make, words in (
        (lambda: rnc.Cylinder(0.0, 1.0), "radius of a cylinder has to be positive"),
        (lambda: rnc.Cone(0.1, -1.0), "height of a cone has to be positive"),
        (lambda: rnc.Cone(0.1, 1.0, "w"), "axis 'w' is not known"),
    ):
        with pytest.raises(rnc.RncError, match=words):
            make()
    robot, bowl = rigid_body(), rnc.SphericalGround(2.0)
    with pytest.raises(rnc.ConstraintError, match="a Cone on its side touches planes only"):
        rnc.NonholonomicSystem(robot, [rnc.RollingBody("body", rnc.Cone(0.1, 0.2), ground=bowl)])
    with pytest.raises(rnc.ConstraintError, match="touches along a line"):
        rnc.RollingBody("body", rnc.Cone(0.1, 0.2)).bind(robot)  # of a contact that opens, name both ends
