"""Wheels: closed forms, and rows against the motion of the material point that touches the ground."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rolling import rigid_body
from systems import random_states
from textbook_systems import differential_drive

RADIUS, MASS = 0.2, 3.0


def test_a_caster_follows_its_trail():
    """Closed form: on an upright fork with trail d, ``d (w + deltadot) = w L cos(delta) - u sin(delta)``."""
    model = pin.Model()
    length, trail, radius = 0.8, 0.07, 0.05
    joint = add_body(model, "root_joint", "Planar", 5.0, frame="axle")
    fork = add_body(model, "fork", "RUBZ", 0.5, joint, moments=0.01, at=(length, 0, 0.1))
    below = pin.SE3(np.eye(3), np.array([-trail, 0, -0.05]))
    add_body(model, "caster", "RY", 0.2, fork, moments=0.001, at=below, frame="caster")
    rows, inputs = [rnc.NoSideSlip("axle")], [rnc.FrameForce("axle", "x"), rnc.FrameTorque("axle", "z")]
    system = rnc.NonholonomicSystem(rnc.Robot(model), [*rows, rnc.RollingWheel("caster", radius)], inputs)
    assert [row.name for row in system.dropped_rows] == ["vertical(caster)"]
    reduced = system.reduce([rnc.FrameSpeed("axle"), rnc.FrameYaw("axle")])
    for q, v2 in random_states(reduced, 6):
        delta, (u, w) = np.arctan2(q[5], q[4]), v2
        delta_dot = (-u * np.sin(delta) + w * length * np.cos(delta)) / trail - w
        rolling = (u * np.cos(delta) + w * length * np.sin(delta)) / radius
        np.testing.assert_allclose(reduced.at(q, v2).v, [u, 0, w, delta_dot, rolling], atol=1e-10)


def test_a_wheel_on_a_joint_that_slides():
    model = differential_drive().model
    add_body(model, "slide", "PX", 0.1, 1, moments=0.01, frame="skid")
    with pytest.raises(rnc.ConstraintError, match="joint of wheel 'skid' is not revolute: give the axle"):
        rnc.NonholonomicSystem(rnc.Robot(model), [rnc.RollingWheel("skid", 0.1)])


def test_a_wheel_rolls_at_the_bottom_of_a_drum_as_a_pendulum():
    """Upright disk whose axle is parallel to the drum: (1 + I / (m r^2)) (R - r) angle'' = -g sin(angle)."""
    mass, radius, spin, drum = 1.5, 0.2, 0.05, rnc.CylindricalGround(1.0, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    robot = rigid_body(mass, (30.0, spin, 30.0))
    wheel = rnc.RollingWheel("body", radius, "y", ground=drum)
    reduced = rnc.NonholonomicSystem(robot, [wheel]).reduce([rnc.FrameAngularVelocity("body", axis) for axis in "xyz"])
    length = 1.0 - radius
    for angle, turn in ((0.4, 0.0), (-1.1, 3.0)):
        out, ahead = np.array([np.sin(angle), 0.0, -np.cos(angle)]), np.array([np.cos(angle), 0.0, np.sin(angle)])
        q = robot.configuration({"root_joint": [*(length * out + [0, 0, 1.0]), 0, np.sin(0.35), 0, np.cos(0.35)]})
        state = reduced.at(q, np.array([0.0, turn, 0.0]))
        R, v, v_dot = pin.XYZQUATToSE3(q).rotation, state.v, state.v_dot(state.v2_dot([]))
        assert abs((R @ v[:3]) @ ahead) == pytest.approx(abs(turn) * radius, abs=1e-12)
        fall = -9.81 * np.sin(angle) / (1.0 + spin / (mass * radius**2))
        own = R @ (v_dot[:3] + np.cross(v[3:], v[:3]))
        np.testing.assert_allclose(own, fall * ahead - (turn * radius) ** 2 / length * out, atol=1e-10)
    for changes in ({"lateral": False}, {"vertical": False}, {"roller": 0.5}):
        with pytest.raises(rnc.ConfigurationError, match="wheel 'body' on curved ground: takes no roller"):
            replace(wheel, **changes).bind(robot)
