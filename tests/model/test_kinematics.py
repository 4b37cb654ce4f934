"""Pinocchio's terms, beside a workspace of its own for each question, and differences along the motion."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from plain_kinematics import ROBOTS, Plain, near, states
from rnc_pin.model.kinematics import ALL, OWN_AXES, WORLD_AXES, Kinematics, over_states


def frames(robot):
    return [k for k, frame in enumerate(robot.model.frames) if frame.name.startswith("on_")]


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
@pytest.mark.parametrize("single", [True, False])
def test_states_are_what_pinocchio_says_of_each_alone(robot, single):
    q, v = states(robot)
    kinematics = Kinematics(robot)
    many = kinematics.position(q).with_velocity(v)
    for i in np.ndindex(2, 3):
        here, at = (kinematics.position(q[i]).with_velocity(v[i]), ()) if single else (many, i)
        plain = Plain(robot, q[i], v[i])
        for name in ("M", "C", "bias"):
            near(getattr(here, name)[at], getattr(plain, name)(), name)
        for joint in range(robot.model.njoints):
            place, expected = here.joint_placement(joint), plain.joint_placement(joint)
            near(place.rotation[at], expected.rotation)
            near(place.translation[at], expected.translation)
        for frame in frames(robot):
            place, expected = here.placement(frame), plain.placement(frame)
            near(place.rotation[at], expected.rotation)
            near(place.translation[at], expected.translation)
            near(here.velocity(frame)[at], plain.jacobian(frame, WORLD_AXES) @ v[i])
            for axes in (WORLD_AXES, OWN_AXES):
                jacobian, rate = plain.jacobian(frame, axes), plain.jacobian_dot(frame, axes)
                near(here.jacobian_dot(frame, axes)[at], rate, axes)
                for rows in (ALL, slice(1, 2), slice(4, 6), slice(2, 5), [0, 4, 2], [5]):
                    near(here.jacobian(frame, axes, rows)[at], jacobian[rows], rows)
                    near(here.acceleration(frame, axes, rows)[at], (rate @ v[i])[rows], rows)
            near(here.jacobian(frame)[at], plain.jacobian(frame, WORLD_AXES))
            if not single:  # derivatives of one state are compared with differences below
                one = kinematics.position(q[i]).with_velocity(v[i])
                for axes in (WORLD_AXES, OWN_AXES):
                    near(here.frame_gradients(frame, axes)[at], one.frame_gradients(frame, axes))
            near(here.acceleration(frame)[at], plain.jacobian_dot(frame, WORLD_AXES) @ v[i])


QUESTIONS = {
    "placement": lambda at, frame: np.column_stack(at.placement(frame)),
    "joint_placement": lambda at, frame: np.column_stack(at.joint_placement(2)),
    "jacobian": lambda at, frame: at.jacobian(frame),
    "velocity": lambda at, frame: at.velocity(frame),
    "acceleration": lambda at, frame: at.acceleration(frame),
    "jacobian_dot": lambda at, frame: at.jacobian_dot(frame),
    "own_gradients": lambda at, frame: at.frame_gradients(frame, OWN_AXES),
    "frame_gradients": lambda at, frame: at.frame_gradients(frame),
    "C": lambda at, frame: at.C,
}


@pytest.mark.parametrize("first", QUESTIONS)
def test_a_question_is_answered_as_before_whatever_was_asked_of_other_states_between(first):
    """Of another configuration, of the same with another velocity, and of many."""
    robot = ROBOTS["tree"]
    q, v = states(robot)
    frame, kinematics = frames(robot)[2], Kinematics(robot)
    place = q[0, 0]
    here = kinematics.position(place).with_velocity(v[0, 0])
    expected = QUESTIONS[first](Kinematics(robot).position(place).with_velocity(v[0, 0]), frame).copy()
    other = kinematics.position(q[1, 1]).with_velocity(v[1, 1])
    faster = kinematics.position(place).with_velocity(v[1, 2])
    for (second, ask), between in product(QUESTIONS.items(), (other, faster)):
        near(QUESTIONS[first](here, frame), expected, second)
        ask(between, frame)
        near(QUESTIONS[first](here, frame), expected, second)
        ask(here, frame)
        near(QUESTIONS[first](here, frame), expected, second)
    for ask in (
        lambda: kinematics.position(q),
        lambda: kinematics.position(q).with_velocity(v),
        lambda: kinematics.position(q).joint_placement(3),
        lambda: kinematics.position(q).with_velocity(v).velocity(3),
        lambda: kinematics.position(q).with_velocity(v).C,
        lambda: kinematics.over_states(pin.computePotentialEnergy, (), q),
        lambda: kinematics.position(q[1, 0]),
        lambda: kinematics.position(place).with_velocity(v[1, 0]),
    ):
        ask()
        near(QUESTIONS[first](here, frame), expected)


@pytest.mark.parametrize("states_at", [(1, 2), slice(None)], ids=["one", "many"])
def test_kinematics_are_computed_once_and_cannot_be_changed(states_at):
    robot = ROBOTS["tree"]
    q, v = (each[states_at] for each in states(robot))
    position = Kinematics(robot).position(q)
    motion = position.with_velocity(v)
    for first, second in (
        (position.joint_placement(4).rotation, motion.joint_placement(4).rotation),
        (position.jacobian(3), motion.jacobian(3)),
        (motion.velocity(3), motion.velocity(3)),
        (motion.acceleration(3), motion.acceleration(3)),
        (motion.M, position.M),
        (motion.C, motion.C),
    ):
        assert np.shares_memory(first, second)
        with pytest.raises(ValueError, match="read-only"):
            first[...] = 0.0


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_gradients_are_differences_along_the_tangent_space(robot):
    q, v = states(robot)
    for i in ((0, 0), (1, 2)):
        at, plain = Kinematics(robot).position(q[i]).with_velocity(v[i]), Plain(robot, q[i], v[i])

        def gradient(of, plain=plain):
            return np.stack([plain.along(of, axis) for axis in np.eye(robot.nv)], axis=-1)

        for frame in frames(robot):

            def motion(of, axes, frame=frame, i=i):
                def there(p):
                    data = robot.model.createData()
                    pin.forwardKinematics(robot.model, data, p, v[i], np.zeros(robot.nv))
                    return getattr(pin, f"getFrame{of}")(robot.model, data, frame, axes).vector

                return there

            near(at.frame_gradients(frame, OWN_AXES)[1], gradient(motion("Acceleration", OWN_AXES)), "own")
            velocity, acceleration = (gradient(motion(of, WORLD_AXES)) for of in ("Velocity", "ClassicalAcceleration"))
            near(at.frame_gradients(frame), np.stack([velocity, acceleration]))


def test_a_function_of_single_states_is_asked_of_each():
    a, b = np.arange(12.0).reshape(2, 3, 2), np.arange(18.0).reshape(2, 3, 3)
    found = over_states(lambda x, y: [[x.sum(), y[0], y[2]]], (1, 3), a, b)
    np.testing.assert_array_equal(found[..., 0, 0], a.sum(axis=-1))
    np.testing.assert_array_equal(found[..., 0, 1:], b[..., [0, 2]])
    one = over_states(lambda x: [1, 2], (2,), a[0, 0])
    assert (one.dtype, one.tolist()) == (np.float64, [1.0, 2.0])
    assert over_states(lambda x: x, (2,), a[:, :0]).shape == (2, 0, 2)
