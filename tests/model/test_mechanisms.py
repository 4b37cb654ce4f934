"""Mechanisms and phrases: simulators, drawings and texts read them, so that a new kind needs no change there."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.applications.command_line.commands.inspect import sentences
from rnc_pin.model.kinematics import OWN_AXES
from rnc_pin.model.rows import FrameAnchor, GroundContact, JointCoupler, Phrases, Rows
from rnc_pin.simulation.ground_bodies import ground_bodies

DRIFT = 0.2  # angle between the heading of the runner and the direction in which it glides [rad]


class DriftingRunner:
    """A kind of a user: a runner that glides at an angle to its frame's x axis."""

    def bind(self, robot):
        return _DriftingRow(robot)


class _DriftingRow(Rows):
    names, units = ("drift(sleigh)",), ("m/s",)
    across = np.array([-np.sin(DRIFT), np.cos(DRIFT), 0.0])

    def __init__(self, robot):
        self.frame = robot.frame_id("sleigh")

    def jacobian(self, at):
        return self.across[None] @ at.jacobian(self.frame, OWN_AXES)[..., :3, :]

    def jacobian_dot(self, at):
        return self.across[None] @ at.jacobian_dot(self.frame, OWN_AXES)[..., :3, :]

    def bias_acceleration(self, at):
        return at.acceleration(self.frame, OWN_AXES)[..., :3] @ self.across[:, None]

    def mechanisms(self):
        return (GroundContact("sleigh", axle=self.across, friction="lateral"),)

    def phrases(self):
        return Phrases("drifting runner", prevents="leave the direction of", where="sleigh")


def sleigh():
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    return rnc.NonholonomicSystem(robot, [DriftingRunner()]).reduce()


def test_a_kind_of_a_user_has_a_body_on_the_ground_and_words():
    reduced = sleigh()
    (body,) = ground_bodies(reduced)
    np.testing.assert_allclose(body.left, _DriftingRow.across, atol=1e-15)
    first, _, last = sentences(reduced, rnc.analyze(reduced, samples=4))
    assert "a vehicle on 1 drifting runner" in first
    assert "It cannot leave the direction of sleigh;" in last


def test_a_kind_of_a_user_glides_along_its_own_heading_in_mujoco():
    pytest.importorskip("mujoco")
    from rnc_pin.plants.mujoco import MuJoCoPlant

    reduced = sleigh()
    plant = MuJoCoPlant(reduced)
    q = reduced.robot.configuration()
    plant.reset(q, reduced.at(q, np.array([1.0, 0.0])).v)
    plant.advance(0.2)
    _, v = plant.read()
    assert abs(_DriftingRow.across[:2] @ v[:2]) < 0.02
    assert v[0] > 0.9


def test_built_in_kinds_say_which_mechanism_enforces_them():
    """Those of the ground, of joints and of loops; a user's rows and a momentum have none."""
    arm = rnc.Robot.from_urdf("space_robot.urdf")
    rows = rnc.Pfaffian(lambda q: np.eye(4)[:1], lambda q, v: np.zeros((1, 4))).bind(arm)
    assert rows.mechanisms() == ()
    assert rows.phrases().prevents == "break the rows of your own"
    assert rnc.MomentumConservation("platform").bind(arm).mechanisms() == ()
    (coupler,) = rnc.JointCoupling("joint_2", "joint_1", ratio=-0.5).bind(arm).mechanisms()
    assert coupler == JointCoupler("joint_2", "joint_1", -0.5)
    (anchor,) = rnc.LoopClosure("platform_body", "tip", "point", offset_b=(0.1, 0.0, 0.0)).bind(arm).mechanisms()
    assert isinstance(anchor, FrameAnchor)
    assert anchor.frames == ("platform_body", "tip")
    assert anchor.point
    np.testing.assert_array_equal(anchor.placements[1].translation, [0.1, 0.0, 0.0])


@pytest.mark.parametrize(
    ("options", "friction", "prevents"),
    [
        ({}, "all", "slip at"),
        ({"lateral": False}, "longitudinal", "roll without turning"),
        ({"roller": 0.0}, "longitudinal", "roll without turning"),
        ({"roller": 0.7854}, "oblique", "roll without turning"),
    ],
)
def test_a_wheel_has_friction_along_its_rows(options, friction, prevents):
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    rows = rnc.RollingWheel("left_wheel", 0.1, **options).bind(robot)
    (contact,) = rows.mechanisms()
    assert (contact.frame, contact.radius, contact.friction) == ("left_wheel", 0.1, friction)
    assert rows.phrases() == Phrases("rolling wheel", prevents=prevents, where="left_wheel")
