"""Tasks on ideal robots: errors decay at their gains, gradients are those of differences, levels keep to themselves."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import frame_placement
from driven import drive
from rnc_pin.control import ControlSample, VelocityQP, tasks
from rnc_pin.motion.planning import Hold, MinimumJerk
from rnc_pin.motion.whole_body.task_hierarchy import MotionMetric, TaskStack
from systems import free_flying_panda, mecanum, mobile_manipulator, random_states, spinning_space_robot, tiago

DT, GAIN, DURATION = 0.005, 2.0, 1.0


def decay(reduced, task, q0, error):
    """Error after a second over the error at the start."""
    run = drive(reduced, VelocityQP(reduced, [task], dt=DT), q0, DURATION, DT, substeps=2)
    return error(run.q[-1]) / error(run.q[0])


def frame_place(reduced, name):
    return lambda q: frame_placement(reduced.robot, q, name)


def posture_case():
    reduced = tiago()
    goal = {"arm_1_joint": 0.9, "arm_4_joint": 1.4, "head_1_joint": -0.3}
    places = [reduced.robot.model.joints[reduced.robot.joint_id(name)].idx_q for name in goal]
    q0 = reduced.robot.configuration({"arm_1_joint": 0.2, "arm_2_joint": -0.5, "arm_4_joint": 1.0})
    return reduced, tasks.PostureTask(goal, gain=GAIN), q0, lambda q: np.linalg.norm(q[places] - list(goal.values()))


def center_case():
    reduced = mobile_manipulator()
    q0 = reduced.robot.configuration({"root_joint": [0.0, 0.0, 0.2], "joint_1": 0.5, "joint_2": 1.0})
    model = reduced.robot.model
    goal = pin.centerOfMass(model, model.createData(), q0)[:2] + np.array([0.1, -0.15])
    task = tasks.CenterOfMassTask(Hold(goal), "xy", gain=GAIN)
    return reduced, task, q0, lambda q: np.linalg.norm(pin.centerOfMass(model, model.createData(), q)[:2] - goal)


def base_case():
    reduced = mecanum()
    frame = next(f.name for f in reduced.robot.model.frames if f.parentJoint == 1)
    place, goal = frame_place(reduced, frame), np.array([0.3, -0.4, 0.6])

    def error(q):
        here = place(q)
        yaw = np.arctan2(here.rotation[1, 0], here.rotation[0, 0])
        return np.linalg.norm([*(here.translation[:2] - goal[:2]), yaw - goal[2]])

    return reduced, tasks.BasePoseTask(frame, Hold(goal), gain=GAIN), reduced.robot.configuration(), error


def orientation_case():
    """A free-flying arm: the hand turns on SO(3) while momentum is conserved."""
    reduced = free_flying_panda()
    place = frame_place(reduced, "panda_hand")
    (q0, _), *_ = random_states(reduced, 1, seed=8)
    goal = pin.exp3(np.array([0.3, 0.2, -0.4])) @ place(q0).rotation
    task = tasks.OutputTask(rnc.FrameOrientation("panda_hand"), Hold(pin.log3(goal)), gain=GAIN)
    return reduced, task, q0, lambda q: np.linalg.norm(pin.log3(goal @ place(q).rotation.T))


@pytest.mark.parametrize("case", [posture_case, center_case, base_case, orientation_case])
def test_errors_decay_at_their_gain(case):
    np.testing.assert_allclose(decay(*case()), np.exp(-GAIN * DURATION), rtol=0.03)


def test_a_moving_reference_is_followed_without_lag():
    reduced = spinning_space_robot()  # an affine constraint: b is not zero
    robot = reduced.robot
    q0 = robot.configuration({"joint_1": 0.3, "joint_2": 1.3, "joint_3": -0.5})
    place = frame_place(reduced, "tip")
    start = place(q0).translation[:2].copy()
    reference = MinimumJerk(start, start + np.array([-0.1, 0.15]), 0.6)
    task = tasks.OutputTask(rnc.FramePosition("tip", "xy"), reference, gain=5.0)
    calm = tasks.DampingTask(joints=["joint_1", "joint_2", "joint_3"], priority=1)
    run = drive(reduced, VelocityQP(reduced, [task, calm], dt=DT), q0, 0.6, DT, v2=np.zeros(3))
    error = [place(q).translation[:2] - reference.at(t).position for t, q in zip(run.time, run.q, strict=True)]
    assert np.abs(error).max() < 2e-4  # a lag of one sample would be 0.0023, its speed times DT


def test_a_base_that_cannot_move_sideways_comes_back_to_its_line():
    reduced = tiago()
    line = MinimumJerk([0.0, 0.0, 0.0], [6.0, 0.0, 0.0], 6.0)
    q0 = reduced.robot.configuration({"root_joint": [0.0, 0.3, 0.0]})
    ends = []
    for lateral_gain in (0.0, 4.0):
        task = tasks.BasePoseTask("base_link", line, gain=[1.0, 1.0, 3.0], lateral_gain=lateral_gain)
        run = drive(reduced, VelocityQP(reduced, [task], dt=0.02), q0, 6.0, 0.02, substeps=1)
        ends.append(abs(run.q[-1][1]))
    assert ends[0] > 0.29
    assert ends[1] < 0.02


@pytest.mark.parametrize("system", [mobile_manipulator, tiago])
def test_away_from_singular_configurations_is_the_gradient_of_the_determinant(system):
    reduced, h = system(), 1e-5
    (q, v2), *_ = random_states(reduced, 1, seed=6)
    R, model = reduced.at(q).R, reduced.robot.model

    def height(step):
        return np.linalg.slogdet(reduced.at(pin.integrate(model, q, step)).E)[1]

    want = [0.4 * (height(h * column) - height(-h * column)) / (2 * h) for column in R.T]
    rows = tasks.SingularityTask(gain=0.4).bind(reduced).rows(ControlSample(reduced, 0.0, q, v2, 0.0))
    np.testing.assert_allclose(rows.jacobian @ R, np.eye(reduced.r), atol=1e-9)
    np.testing.assert_allclose(rows.rate, want, atol=1e-7 * (1 + np.abs(want).max()))


def test_a_posture_among_outputs_of_other_tasks_has_its_own_rows():
    reduced = tiago()
    (q, v2), *_ = random_states(reduced, 1, seed=4)
    goals = {"wheel_left_joint": 9.0, "arm_2_joint": -0.4}  # the wheel takes the shortest way
    posture = tasks.PostureTask(goals, gain=[2.0, 3.0], weight=0.1)
    path = MinimumJerk([0.0, 1.0], [2.0, 0.5], 1.0)
    point = tasks.OutputTask(rnc.FramePosition("arm_7_link", "xy"), path, gain=4.0)
    sample = ControlSample(reduced, 0.3, q, v2, 0.02)
    found = TaskStack([posture, point], reduced, 0, MotionMetric(reduced)).rows(sample)
    alone = zip(*(task.bind(reduced).rows(sample) for task in (posture, point)), strict=True)
    for (together,), own in zip(found, alone, strict=True):
        np.testing.assert_allclose(together, np.concatenate(own), atol=1e-12)


def test_a_lower_level_changes_nothing_above():
    reduced = tiago()
    reach = tasks.OutputTask(rnc.FramePosition("arm_7_link"), Hold([1.0, 0.5, 1.0]), gain=3.0)
    posture = tasks.PostureTask(dict.fromkeys(reduced.robot.joint_names[2:8], 0.4), weight=1e4, priority=3)
    rest = tasks.DampingTask(priority=7)
    for q, v2 in random_states(reduced, 4, seed=2):
        sample = ControlSample(reduced, 0.0, q, 0.1 * v2, 0.01)
        J = reach.bind(reduced).rows(sample)
        found = VelocityQP(reduced, [rest, posture, reach]).solve(sample).v2
        np.testing.assert_allclose(J.jacobian @ sample.end.R @ found, J.rate, atol=1e-9)
        alone = VelocityQP(reduced, [reach]).solve(sample).v2
        assert np.abs(found - alone).max() > 0.1
        # Without other tasks the motion is the smallest one.
        A = J.jacobian @ sample.end.R
        to_v2 = MotionMetric(reduced).basis(sample.end.R).to_v2
        np.testing.assert_allclose(alone, to_v2 @ np.linalg.pinv(A @ to_v2) @ J.rate, atol=1e-9)


def test_weights_share_a_conflict_by_the_normal_equations():
    reduced = tiago()
    one = tasks.PostureTask({"arm_1_joint": 1.0, "arm_2_joint": 0.5}, weight=[2.0, 0.5], gain=[1.0, 3.0])
    other = tasks.PostureTask({"arm_1_joint": 0.0, "arm_2_joint": 0.0}, weight=6.0)
    q = reduced.robot.configuration({"arm_1_joint": 0.2, "arm_2_joint": 0.1})
    found = VelocityQP(reduced, [one, other]).solve(ControlSample(reduced, 0.0, q, np.zeros(reduced.r), 0.01)).v2
    names = reduced.reducing.names
    np.testing.assert_allclose(found[names.index("arm_1_joint")], (2 * 0.8 - 6 * 0.2) / 8, atol=1e-12)
    np.testing.assert_allclose(found[names.index("arm_2_joint")], (0.5 * 3 * 0.4 - 6 * 0.1) / 6.5, atol=1e-12)


def test_damping_bounds_the_velocity_near_a_singular_configuration():
    """A goal along a stretched arm: least squares with the cost d^2 of a motion, solved beside it."""
    reduced = tiago()
    reach = tasks.OutputTask(rnc.FramePosition("arm_7_link"), Hold([5.0, 5.0, 5.0]), gain=3.0)
    (q, _), *_ = random_states(reduced, 1, seed=2)
    sample = ControlSample(reduced, 0.0, q, np.zeros(reduced.r), 1e-6)
    rows = reach.bind(reduced).rows(sample)
    A, of_v2 = rows.jacobian @ sample.end.R, MotionMetric(reduced).basis(sample.end.R).of_v2
    for d in (0.05, 1.0):
        found = VelocityQP(reduced, [reach], damping=d).solve(sample).v2
        expected = np.linalg.solve(A.T @ A + d**2 * of_v2.T @ of_v2, A.T @ rows.rate)
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("system", [mobile_manipulator, spinning_space_robot])
def test_the_end_is_where_the_commanded_velocity_leads(system):
    reduced, dt = system(), 0.01
    for q, v2 in random_states(reduced, 3, seed=2):
        sample = ControlSample(reduced, 1.5, q, v2, dt)
        v = reduced.at(q).R @ v2 + reduced.at(q).b
        np.testing.assert_allclose(sample.end.q, pin.integrate(reduced.robot.model, q, dt * v), atol=1e-12)
        np.testing.assert_allclose(sample.start.v, v, atol=1e-12)
        np.testing.assert_array_equal(sample.end.v2, v2)
        assert (sample.time, sample.dt) == (1.51, dt)
