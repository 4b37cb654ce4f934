"""Velocity commands of actuators: closed forms of wheels, limits that scale a motion, and motions that drift."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.control.actuator_velocity import admissible_scale, driven_joints, velocity_from_actuators, velocity_limits
from rnc_pin.control.controller import VelocityTarget
from simple_controllers import Counting
from systems import random_states, spinning_space_robot
from textbook_systems import sliders

STATES = random_states(spinning_space_robot(), 4, seed=4)


def wanted(v2):
    """Kinematic controller of one constant v2d."""
    return Counting(lambda *_: VelocityTarget(v2, 0 * v2, x1=v2 + 1, x2=v2 + 2))


@pytest.mark.parametrize("part", [0.25, 1.5])
@pytest.mark.parametrize("index", range(len(STATES)))
def test_only_what_is_commanded_is_scaled(part, index):
    """With angular momentum, bodies turn at v2d = 0 too: a limit leaves the motion of a joint the rest of its room."""
    reduced, (q, v2) = spinning_space_robot(), STATES[index]
    at = reduced.at(q, v2)
    along, offset = at.R @ v2, at.b
    joint = int(np.argmax(np.abs(offset)))
    side, limits = np.sign(along[joint]), np.full(reduced.n, np.inf)
    limits[joint] = side * offset[joint] + part * abs(along[joint])
    if limits[joint] <= 0:  # the drift alone is towards the other side
        along, v2, side = -along, -v2, -side
        limits[joint] = side * offset[joint] + part * abs(along[joint])
    command, _ = rnc.control.ActuatorVelocityController(reduced, wanted(v2), limits).step(0.0, at.measure(), 5)
    scale = min(part, 1.0)
    np.testing.assert_allclose(command.v2_desired, scale * v2, rtol=1e-10)
    np.testing.assert_allclose(command.T, at.B.T @ (scale * along + offset), rtol=1e-10)
    np.testing.assert_allclose(velocity_from_actuators(reduced.at(q), command.T), scale * along + offset, atol=1e-9)


def test_the_scale_is_the_largest_that_keeps_every_limit():
    along, offset, limits = np.array([[2.0, -3.0, 0.0]]), np.array([[0.5, 1.0, 9.0]]), np.array([2.0, 2.0, 1.0])
    # 0.5 + 2 s <= 2 and 1 - 3 s >= -2: s = 0.75; what does not move with s counts for nothing.
    np.testing.assert_allclose(admissible_scale(along, offset, limits), [[0.75]])
    np.testing.assert_allclose(admissible_scale(-along, offset, limits), [[1 / 3]])  # 1 + 3 s <= 2
    np.testing.assert_allclose(admissible_scale(along, np.array([[2.5, 0.0, 0.0]]), limits), [[0.0]])
    np.testing.assert_allclose(admissible_scale(along, 0 * along, limits), [[2 / 3]])
    np.testing.assert_allclose(admissible_scale(0.1 * along, 0 * along, limits), [[1.0]])
    assert admissible_scale(np.zeros((4, 3)), 0 * along, limits).shape == (4, 1)


def test_limits_are_those_of_the_file_where_it_has_any():
    robot = sliders()
    robot.model.upperVelocityLimit = np.array([0.7, 0.0, np.inf])
    reduced = rnc.NonholonomicSystem(robot, [], ["a", "b", "c"]).reduce()
    np.testing.assert_array_equal(velocity_limits(reduced, True), [0.7, np.inf, np.inf])
    np.testing.assert_array_equal(velocity_limits(reduced, False), np.full(3, np.inf))
    described = rnc.control.ActuatorVelocityController(reduced, wanted(np.ones(3))).describe()
    assert described["limits"] == {"a": 0.7}
    for wrong in ([1.0, 2.0], [1.0, 0.0, 1.0], [1.0, -1.0, 1.0], "fast", 3.0):
        with pytest.raises(rnc.ConfigurationError, match="3 positive numbers"):
            velocity_limits(reduced, wrong)


def test_actuators_that_leave_a_motion_open_are_counted():
    robot = sliders()
    for names, words in ((["a", "c"], r"\(a, c\) determine 2 of 3"), ([], r"\(none\) determine 0 of 3")):
        reduced = rnc.NonholonomicSystem(robot, [], names).reduce()
        with pytest.raises(rnc.ConfigurationError, match=words):
            rnc.control.ActuatorVelocityController(reduced, wanted(np.ones(3)))


def test_without_constraints_actuators_move_their_own_joints():
    """One slide, and the sum of two others: they share it evenly."""
    reduced = rnc.NonholonomicSystem(sliders(), [], np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])).reduce()
    np.testing.assert_allclose(velocity_from_actuators(reduced.at(np.zeros(3)), np.array([0.4, 3.0])), [0.4, 1.5, 1.5])
    assert driven_joints(reduced) == ("a", "b", "c")


def test_targets_that_are_none_are_refused():
    reduced = systems.differential_drive()
    measurement = reduced.at(reduced.robot.configuration(), np.zeros(2)).measure(np.zeros(2))
    for v2, error, words in (
        ([1.0, 2.0, 3.0], rnc.InputError, r"shape \(3,\), expected \(..., 2\)"),
        ([1.0, np.nan], rnc.DivergenceError, "not finite"),
    ):
        with pytest.raises(error, match=words):
            rnc.control.ActuatorVelocityController(reduced, wanted(np.array(v2))).step(0.0, measurement, 5)
