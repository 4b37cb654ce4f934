"""Constraint rows at complex configurations: those of the model on the real line, and analytic beside it."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.analysis.complex_motion import ComplexRows, has_complex_rows
from systems import rolling_base
from textbook_systems import unicycle_with_trailers


def ball_with_rudder():
    """A rolling ball whose hub carries a knife edge on a hinge, and a slider that is locked."""
    model = rolling_base({}, 0.2, "free")
    base = model.getJointId("root_joint")
    hinge = model.addJoint(base, pin.JointModelRevoluteUnaligned(np.array([0.0, 0.6, 0.8])), pin.SE3.Random(), "hinge")
    slide = model.addJoint(hinge, pin.JointModelPX(), pin.SE3.Random(), "slide")
    turn = model.addJoint(slide, pin.JointModelRUBY(), pin.SE3.Random(), "turn")
    for joint in (hinge, slide, turn):
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    for name, joint in (("hub", base), ("rudder", turn)):
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    kinds = [rnc.RollingBall("hub", 0.2), rnc.NoSideSlip("rudder", at=(0.1, 0.2, -0.3))]
    return rnc.NonholonomicSystem(rnc.Robot(model), kinds).reduce()


@pytest.fixture(scope="module")
def rows():
    pin.seed(3)
    reduced = ball_with_rudder()
    q = reduced.assembled(pin.integrate(reduced.robot.model, reduced.robot.configuration(), 0.3 * np.arange(9) - 1.0))
    assert has_complex_rows(reduced)
    return reduced, q, ComplexRows(reduced, q, np.linalg.qr(reduced.at(q).R)[0])


def test_rows_and_fields_are_those_of_the_model(rows):
    reduced, q, found = rows
    step = np.linspace(-0.5, 0.7, reduced.n)
    states = reduced.at(np.tile(pin.integrate(reduced.robot.model, q, step), (9, 1)), v=np.eye(9))
    A, gradient = found._matrix(found.moved(found.start[None], step[None]))
    np.testing.assert_allclose(A[0], states.A[0], atol=1e-13)
    np.testing.assert_allclose(np.moveaxis(gradient[0], -1, 0), states.A_dot, atol=1e-13)
    fields, _ = found.fields(found.moved(found.start[None], step[None]))
    np.testing.assert_allclose(states.A[0] @ fields[0], 0.0, atol=1e-13)


def test_derivatives_are_those_of_an_analytic_function(rows):
    """A step of 1e-20 along the imaginary axis gives the derivative to all digits, if conjugation occurs nowhere."""
    reduced, _, found = rows
    at = found.moved(found.start[None], np.linspace(-0.4, 0.6, reduced.n)[None])
    fields, gradient = found.fields(at)
    for k, e in enumerate(np.eye(reduced.n)):
        stepped = found.generators(found.moved(at, 1e-20j * e[None]))
        np.testing.assert_allclose(stepped.imag / 1e-20, gradient[..., k], atol=1e-12)
        np.testing.assert_allclose(stepped.real, fields, atol=1e-13)


def test_other_rows_have_none():
    robot = unicycle_with_trailers(1).robot
    own = rnc.Pfaffian(lambda q: np.eye(4)[:1], lambda q, v: np.zeros((1, 4)), names=["own"])
    assert not has_complex_rows(rnc.NonholonomicSystem(robot, [own]).reduce())


def test_rows_relative_to_a_body_that_moves_have_none():
    """They depend on two frames; the values at complex configurations are those of one."""
    robot = rnc.Robot.from_urdf("ball_on_plate.urdf")
    for frame, expected in (("plate", False), (None, True)):
        rolls = rnc.RollingBall("ball", 0.05, ground=rnc.GroundPlane(frame=frame))
        assert has_complex_rows(rnc.NonholonomicSystem(robot, [rolls], ["roll", "pitch"]).reduce()) is expected
