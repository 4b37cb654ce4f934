"""Cylinders and cones on their sides: closed forms, and mistakes."""

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


def test_a_cone_rolls_about_its_apex():
    """Landau and Lifshitz, section 32: ``T = 3/40 m h^2 rate^2 (1 + 5 cos^2 a)`` for a homogeneous cone."""
    angle, height, mass, rate = 0.4, 0.3, 1.0, 1.7
    radius = height * np.tan(angle)
    across = 3 / 20 * mass * (radius**2 + height**2 / 4)
    robot = rigid_body(mass, (across, across, 3 / 10 * mass * radius**2))
    # The frame is the centre of mass, a quarter of the height above the base.
    cone = rnc.RollingBody("body", rnc.Cone(radius, height), at=(0.0, 0.0, -height / 4))
    reduced = rnc.NonholonomicSystem(robot, [cone]).reduce()
    assert reduced.r == 1
    side = pin.SE3(pin.rpy.rpyToMatrix(0.0, np.pi / 2 + angle, 0.0), np.array([0.0, 0.0, 0.1]))
    q = reduced.assembled(robot.configuration({"root_joint": pin.SE3ToXYZQUAT(side)}))
    state = reduced.at(q, [1.0])
    turning = pin.XYZQUATToSE3(q).rotation @ state.v[3:]  # along the line of contact, rate cot(a)
    assert turning[2] == pytest.approx(0.0, abs=ROUNDING)
    scale = rate / np.tan(angle) / np.linalg.norm(turning)
    kinetic = 0.5 * float(state.H[0, 0]) * scale**2
    assert kinetic == pytest.approx(3 / 40 * mass * height**2 * rate**2 * (1 + 5 * np.cos(angle) ** 2), rel=1e-9)


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
