"""Kinematics relative to a body: rates and gradients of rows that read them, and special carriers."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.constraints.relative_kinematics import RelativeKinematics
from rnc_pin.model.kinematics import OWN_AXES, Kinematics
from rolling import check_rates
from systems import free_bodies
from tolerances import ROUNDING

PLATE = rnc.GroundPlane(frame="plate")
TURNING = rnc.GroundPlane((0.2, -0.3, 1.0), (0.1, 0.2, 0.3), spin=-0.7, frame="plate")
EGG = rnc.Ellipsoid((0.4, 0.2, 0.1))
KINDS = {
    "ball": rnc.RollingBall("body", 0.2, ground=PLATE),
    "ball on a plate that turns": rnc.RollingBall("body", 0.2, ground=TURNING),
    "egg without pivoting": rnc.RollingBody("body", EGG, pivoting=False, ground=TURNING),
    "wheel": rnc.RollingWheel("body", 0.2, "y", ground=PLATE),
    "wheel on a plate that turns": rnc.RollingWheel("body", 0.2, "y", ground=TURNING),
    "wheel in a bowl": rnc.RollingWheel("body", 0.2, "y", ground=rnc.SphericalGround(2.0, (0, 0, 1.9), frame="plate")),
    "egg on an egg": rnc.RollingBody("body", EGG, ground=rnc.BodySurface(EGG, "plate", (0.1, 0.2, 0), (0.3, 0.2, 0))),
    "ball on a tyre": rnc.RollingBall("body", 0.2, ground=rnc.BodySurface(rnc.Torus(0.5, 0.1, "y"), "plate")),
    "caster": rnc.Caster("body", 0.2, ground=PLATE),
    "knife edge": rnc.NoSideSlip("body", "y", ground=PLATE),
    "knife edge beside its frame": rnc.NoSideSlip("body", "x", at=(0.1, -0.2, 0.3), ground=PLATE),
    "knife edge on a plate that turns": rnc.NoSideSlip("body", "z", ground=TURNING),
}  # fmt: skip


@pytest.fixture(scope="module")
def robot():
    return free_bodies("plate", "body")


def drawn(robot, seed):
    generator = np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.configuration(), 0.4 * generator.normal(size=robot.nv))
    q[:3], q[7:10] = (0.1, 0.2, -0.3), (0.3, 0.1, 0.4)
    return q, generator.normal(size=robot.nv)


@pytest.mark.parametrize("name", KINDS)
def test_rates_and_gradients_are_those_of_differences(name, robot):
    check_rates(KINDS[name].bind(robot), robot, *drawn(robot, 1))


def test_components_along_own_axes(robot):
    """The rate of a frame's relative velocity in its own axes, against the product rule of what world axes give."""
    q, v = drawn(robot, 2)
    at = RelativeKinematics(Kinematics(robot).position(q).with_velocity(v), robot.frame_id("plate"))
    frame = robot.frame_id("body")
    turn, velocity, acceleration = at.rotation(frame), at.velocity(frame), at.acceleration(frame)
    np.testing.assert_allclose(at.jacobian(frame, OWN_AXES)[3:] @ v, turn.T @ velocity[3:], atol=ROUNDING)
    own = turn.T @ (acceleration[:3] - np.cross(velocity[3:], velocity[:3]))
    np.testing.assert_allclose(at.acceleration(frame, OWN_AXES)[:3], own, atol=ROUNDING)
    np.testing.assert_allclose(at.acceleration(frame, OWN_AXES), at.jacobian_dot(frame, OWN_AXES) @ v, atol=ROUNDING)


def test_a_carrier_that_is_the_world_changes_nothing(robot):
    q, v = drawn(robot, 3)
    at = Kinematics(robot).position(q).with_velocity(v)
    for name in ("ball", "wheel on a plate that turns", "knife edge beside its frame"):
        kind = KINDS[name]
        ground = rnc.GroundPlane(kind.ground.normal, kind.ground.point, spin=kind.ground.spin)
        inner = type(kind)(**{**vars(kind), "ground": ground}).bind(robot)
        outer = type(kind)(**{**vars(kind), "ground": rnc.GroundPlane(**{**vars(ground), "frame": "universe"})}).bind(
            robot
        )
        for quantity in ("jacobian", "jacobian_dot", "bias_acceleration", "rate", "rate_dot", "residual"):
            np.testing.assert_allclose(getattr(outer, quantity)(at), getattr(inner, quantity)(at), atol=ROUNDING)
        for both, one in zip(outer.lines_of_action(at), inner.lines_of_action(at), strict=True):
            np.testing.assert_allclose(both, one, atol=ROUNDING)
