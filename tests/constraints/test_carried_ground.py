"""Ground that a body carries: the same motion from a model in which the carrier is the parent joint, and mistakes."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.model.kinematics import OWN_AXES, Kinematics
from rnc_pin.model.relative_rows import RelativeKinematics
from rolling import rigid_body
from row_kinds import CARRIED, drawn
from systems import free_bodies
from tolerances import KKT, ROUNDING

INERTIAS = pin.Inertia(3.0, np.array([0.1, 0.0, 0.02]), np.diag([0.3, 0.4, 0.5])), pin.Inertia.FromSphere(0.7, 0.2)
ACROSS = pin.SE3(pin.rpy.rpyToMatrix(0.2, -0.1, 0.4), np.array([0.1, 0.3, 0.2]))


def plate_and_ball(parent):
    """A plate on two hinges, and a ball with six free coordinates relative to the plate (1) or to the world (0)."""
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "first")
    second = add_body(model, "second", "RY", INERTIAS[0], first, at=ACROSS, frame="plate")
    add_body(model, "free", "FreeFlyer", INERTIAS[1], second * parent, frame="ball")
    return rnc.Robot(model)


@pytest.mark.parametrize("ground", [{}, {"spin": 0.8, "point": (0.1, 0.2, 0.0)}])
def test_a_ball_on_a_plate_moves_as_with_coordinates_relative_to_the_plate(ground, generator):
    """Rows of the second model are those of a ball alone, on ground at rest: they know no carrier."""
    plane = rnc.GroundPlane(**ground)
    carried = rnc.RollingBall("ball", 0.2, ground=rnc.GroundPlane(**ground, frame="plate"))
    alone = rigid_body(0.7, (1.0, 1.0, 1.0))
    rolls, kinematics = rnc.RollingBall("body", 0.2, ground=plane).bind(alone), Kinematics(alone)
    pad = np.zeros((3, 2))

    def at(q, v=None):
        position = kinematics.position(q[2:])
        return position if v is None else position.with_velocity(v[2:])

    relative = rnc.Pfaffian(
        lambda q: np.hstack([pad, rolls.jacobian(at(q))]),
        lambda q, v: np.hstack([pad, rolls.jacobian_dot(at(q, v))]),
        rate=lambda q: rolls.rate(at(q)),
        rate_dot=lambda q, v: rolls.rate_dot(at(q, v)),
    )
    outputs = [rnc.JointPosition("first"), rnc.JointPosition("second")]
    outputs += [rnc.FrameAngularVelocity("ball", axis) for axis in "xyz"]
    one, other = (
        rnc.NonholonomicSystem(plate_and_ball(parent), [kind], ["first", "second"]).reduce(outputs)
        for parent, kind in ((0, carried), (1, relative))
    )
    for _ in range(4):
        p = pin.integrate(other.robot.model, other.robot.configuration(), generator.normal(size=8))
        p[4] = 0.2
        data = other.robot.model.createData()
        pin.framesForwardKinematics(other.robot.model, data, p)
        q = p.copy()
        q[2:] = pin.SE3ToXYZQUAT(data.oMi[3])
        v2, T = generator.normal(size=5), generator.normal(size=2)
        expected = other.forward_dynamics(p, v2, T)
        rounding = KKT * np.abs(expected).max()
        np.testing.assert_allclose(one.forward_dynamics(q, v2, T), expected, rtol=KKT, atol=rounding)
        forces = one.multipliers(q, v2, T), other.multipliers(p, v2, T)  # both act along the axes of the plate
        np.testing.assert_allclose(*forces, atol=KKT * np.abs(forces[1]).max())


def test_mistakes_have_names():
    robot = plate_and_ball(0)
    with pytest.raises(rnc.ModelError, match="did you mean 'plate'"):
        rnc.RollingBall("ball", 0.2, ground=rnc.GroundPlane(frame="plat")).bind(robot)
    with pytest.raises(rnc.ConstraintError, match="'ball' carries its own ground"):
        rnc.RollingBall("ball", 0.2, ground=rnc.GroundPlane(frame="ball")).bind(robot)


@pytest.fixture(scope="module")
def robot():
    return free_bodies("plate", "body")


def test_other_axes_than_those_of_the_carrier_are_refused(robot):
    q, v = drawn(robot, 2)
    at = RelativeKinematics(Kinematics(robot).position(q).with_velocity(v), robot.frame_id("plate"))
    for method in (at.jacobian, at.jacobian_dot, at.acceleration):
        with pytest.raises(NotImplementedError, match="along the axes of the carrier only"):
            method(robot.frame_id("body"), OWN_AXES)


def test_a_carrier_that_is_the_world_changes_nothing(robot):
    q, v = drawn(robot, 3)
    at = Kinematics(robot).position(q).with_velocity(v)
    for name in ("ball on a plate", "wheel on a plate that turns", "knife edge beside its frame"):
        kind = CARRIED[name]
        ground = rnc.GroundPlane(kind.ground.normal, kind.ground.point, spin=kind.ground.spin)
        inner = type(kind)(**{**vars(kind), "ground": ground}).bind(robot)
        outside = rnc.GroundPlane(**{**vars(ground), "frame": "universe"})
        outer = type(kind)(**{**vars(kind), "ground": outside}).bind(robot)
        for quantity in ("jacobian", "jacobian_dot", "bias_acceleration", "rate", "rate_dot", "residual"):
            np.testing.assert_allclose(getattr(outer, quantity)(at), getattr(inner, quantity)(at), atol=ROUNDING)
        for both, one in zip(outer.lines_of_action(at), inner.lines_of_action(at), strict=True):
            np.testing.assert_allclose(both, one, atol=ROUNDING)
