"""Frames beside others, and actuators on frames and joints: beside the same written out, for one state and for many."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame
from plain_kinematics import ROBOTS, Plain, near, states
from rnc_pin.constraints.couplings import PointRows
from rnc_pin.model.frame_rows import OffsetFrame
from rnc_pin.model.generalized_forces import Actuation
from rnc_pin.model.kinematics import OWN_AXES, Kinematics


@pytest.mark.parametrize("moved", [True, False])
def test_a_frame_beside_another_moves_as_one_that_is_there(moved):
    """Beside a frame of the model's own at the same place, for one state and for many."""
    robot = ROBOTS["tree"]
    point, turn = np.array([0.25, -0.5, 2.0]) * moved, pin.rpy.rpyToMatrix(0.3 * moved, -0.4 * moved, 0.9 * moved)
    model = robot.model.copy()
    base = model.frames[model.getFrameId("on_slide")]
    there = add_frame(model, "there", base.parentJoint, base.placement * pin.SE3(turn, point))
    frame = OffsetFrame(robot, "on_slide", point, turn)
    assert frame.name == ("on_slide[0.25 -0.5 2]" if moved else "on_slide")
    assert (frame.index, frame.joint) == (robot.frame_id("on_slide"), base.parentJoint)
    q, v = states(robot)
    for i in ((0, 1), ...):
        at = Kinematics(robot).position(q[i]).with_velocity(v[i])
        expected = Kinematics(rnc.Robot(model)).position(q[i]).with_velocity(v[i])
        for found, place in zip(frame.placement(at), expected.placement(there), strict=True):
            near(found, place)
        rows = PointRows(frame)
        near(rows.jacobian(at), expected.jacobian(there)[..., :3, :])
        near(rows.jacobian_dot(at), expected.jacobian_dot(there)[..., :3, :])
        near(rows.bias_acceleration(at), expected.acceleration(there)[..., :3])
    at = Kinematics(robot).position(q[1, 1]).with_velocity(v[1, 1])
    expected = Kinematics(rnc.Robot(model)).position(q[1, 1]).with_velocity(v[1, 1]).frame_gradients(there)
    near(rows.bias_acceleration_gradient(at), expected[1, :3])


def test_actuators_pull_where_they_are():
    """Joints by entries of v, forces and torques by rows of the frame's own Jacobian; and their rates."""
    robot = ROBOTS["tree"]
    joints = robot.model.copy()
    joints.upperEffortLimit = np.linspace(-2.0, 9.0, robot.nv)
    robot = rnc.Robot(joints)
    kinds = [
        "slide", rnc.FrameForce("on_ball", "z", 4.0), rnc.FrameTorque("on_endless", "y"), "endless", "turn",
        rnc.FrameForce("on_universe", "x", limit=0.5),
    ]  # fmt: skip
    actuation = Actuation(kinds, robot)
    names = ("slide", "force(on_ball.z)", "torque(on_endless.y)", "endless", "turn", "force(on_universe.x)")
    assert (actuation.names, actuation.size, actuation.constant) == (names, 6, None)
    names = ("slide", "endless", "turn")
    slide, endless, turn = (float(joints.upperEffortLimit[robot.velocity_indices(name).start]) for name in names)
    np.testing.assert_array_equal(actuation.limits, [slide, 4.0, np.inf, endless, turn, 0.5])
    q, v = states(robot)
    for i in ((0, 2), (1, 0)):

        def matrix(p):
            expected = np.zeros((robot.nv, 6))
            for column, name in ((0, "slide"), (3, "endless"), (4, "turn")):
                expected[robot.velocity_indices(name).start, column] = 1.0
            for column, name, row in ((1, "on_ball", 2), (2, "on_endless", 4), (5, "on_universe", 0)):
                expected[:, column] = Plain(robot, p, None).jacobian(robot.frame_id(name), OWN_AXES)[row]
            return expected

        rate = Plain(robot, q[i], v[i]).along(matrix)
        for at, where in ((q[i], ()), (q, i)):
            speed = v[i] if at.ndim == 1 else v
            here = Kinematics(robot).position(at).with_velocity(speed)
            near(actuation.matrix(here)[where], matrix(q[i]))
            near(actuation.matrix_rate(here)[where], rate)
            only = Actuation(["turn", "slide"], robot)
            near(only.matrix(here)[where], matrix(q[i])[:, [4, 0]])
            assert only.matrix(here).shape == (*at.shape[:-1], robot.nv, 2)
            near(only.matrix_rate(here), np.zeros((*at.shape[:-1], robot.nv, 2)))
            mine = Actuation(lambda p: np.outer(np.arange(robot.nv), [p[0], p[-1], 1.0]), robot)
            near(mine.matrix(here)[where], np.outer(np.arange(robot.nv), [q[i][0], q[i][-1], 1.0]))
            assert mine.matrix_rate(here) is None
    assert (mine.names, mine.constant) == (("T[0]", "T[1]", "T[2]"), None)
    given = Actuation(np.ones((robot.nv, 2)), robot)
    assert given.constant.shape == (robot.nv, 2)
    assert given.limits.tolist() == mine.limits[:2].tolist() == [np.inf, np.inf]
    joints.upperEffortLimit = np.zeros(robot.nv)
    assert Actuation(["turn"], rnc.Robot(joints)).limits.tolist() == [np.inf]


def test_actuators_and_points_that_are_none_are_refused():
    robot = ROBOTS["tree"]
    for wrong, error, words in (
        (np.zeros(robot.nv), rnc.ConstraintError, r"actuation matrix has shape \(12,\), expected \(12, p\)$"),
        (np.zeros((2, 12)), rnc.ConstraintError, r"actuation matrix has shape \(2, 12\), expected \(12, p\)$"),
        (lambda q: np.zeros((3, 1)), rnc.ConstraintError, r"actuation matrix has shape \(3, 1\), expected \(12, p\)$"),
        (["turn", "ball"], rnc.ModelError, "actuator 'ball' is a joint of several degrees of freedom: use FrameForce"),
        (["turn", "slide", "turn"], rnc.ConstraintError, "duplicate actuator 'turn'$"),
        (["turn", 3], rnc.ConstraintError,
            "actuator 3 has the wrong type: expected a joint's name, FrameForce, FrameTorque or OpenDifferential$"),
        *(([rnc.OpenDifferential(joints)], rnc.ConstraintError, "a differential needs two joints or more, found")
            for joints in (["turn"], ["turn", "turn"], "slide")),
    ):  # fmt: skip
        with pytest.raises(error, match=words):
            Actuation(wrong, robot)
    sizes = iter([2, 3])
    changing = Actuation(lambda q: np.zeros((12, next(sizes))), robot)
    words = r"actuation matrix B\(q\) returned shape \(12, 3\), expected \(12, 2\)"
    with pytest.raises(rnc.InputError, match=words):
        changing.matrix(Kinematics(robot).position(robot.configuration()))
    for wrong in ([1.0, 2.0], [1.0, np.nan, 0.0], np.zeros((1, 3)), 1.0):
        with pytest.raises(rnc.ConfigurationError, match="expected three finite numbers"):
            OffsetFrame(robot, "on_ball", wrong)


def sliders(B):
    """Three of them, at right angles, that actuators push by the columns of B."""
    model = pin.Model()
    for axis in "xyz":
        add_body(model, axis, f"P{axis.upper()}", pin.Inertia.FromSphere(1.0, 0.1), model.njoints - 1)
    return rnc.NonholonomicSystem(rnc.Robot(model), [], B).reduce()


@pytest.mark.parametrize("unit", [1e-15, 1e12])
def test_units_of_actuators_make_them_no_less_independent(unit):
    B = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, -0.9]]) * [unit, 1.0, 1.0]
    T = sliders(B).allocate(np.zeros(3), B @ [1.0 / unit, 2.0, 3.0])
    np.testing.assert_allclose(T * [unit, 1.0, 1.0], [1.0, 2.0, 3.0], rtol=1e-12)


def test_later_changes_of_given_actuators_change_no_system(robot):
    names, matrix = ["joint_1", "joint_2"], np.eye(4)[:, 1:]
    by_name, by_matrix = (rnc.NonholonomicSystem(robot, [], each) for each in (names, matrix))
    names.append("nonsense")
    matrix *= 2.0
    assert by_name.with_constraints([]).actuation.names == ("joint_1", "joint_2")
    np.testing.assert_array_equal(by_matrix.reduce().at(robot.configuration()).B, np.eye(4)[:, 1:])
    matrix[:] = 0.0  # reading B has not made it read-only


def test_a_motor_on_an_open_differential_turns_at_the_mean_speed_of_its_joints():
    robot = ROBOTS["tree"]
    actuation = Actuation(["slide", rnc.OpenDifferential(["turn", "endless"], 7.0)], robot)
    assert (actuation.names[1], actuation.units[1], actuation.limits[1]) == ("differential(turn, endless)", "N m", 7.0)
    v = np.zeros(robot.nv)
    v[[robot.velocity_indices(name).start for name in ("turn", "endless", "slide")]] = 3.0, 5.0, 2.0
    np.testing.assert_array_equal(actuation.constant.T @ v, [2.0, 4.0])
