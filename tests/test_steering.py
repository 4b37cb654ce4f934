"""Class 2s and the fire truck: flat path, slithering trailer, backstepping of the rear steering (section 4.3)."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.control import (
    ReducingOutputController,
    RedundancyController,
    SteeringController,
    VelocityGains,
    VelocityTracker,
)
from rnc_pin.planning import CarPath, Hold, Joined, MinimumJerk
from systems import fire_truck, random_states, space_robot
from test_analysis import turreted
from tolerances import FINITE_DIFFERENCE

START, GOAL = np.array([-8.0, 3.0, 0.0]), np.zeros(3)


def truck_task(**changes):
    reduced = fire_truck()
    path = CarPath(START, GOAL, duration=6.0, wheelbase=1.0)
    task = rnc.Task.of(reduced, ["tractor_speed_x", "front_steering"], ["rear_steering"], ["trailer_yaw"])
    q0 = reduced.robot.configuration({"root_joint": START})
    return reduced, path, task, SteeringController(reduced, task, path.reference, path.follower(1.0), **changes), q0


def axle_positions(reduced, configurations):
    robot = reduced.robot
    data, frame = robot.model.createData(), robot.frame_id("rear_axle")
    points = []
    for q in configurations:
        pin.framesForwardKinematics(robot.model, data, q)
        points.append(data.oMf[frame].translation[:2].copy())
    return np.array(points)


# ---------------------------------------------------------------------- path


@pytest.mark.parametrize(
    ("start", "goal"),
    [((-8, 3, 0), (0, 0, 0)), ((0, 0, 0.4), (6, 2, -0.3)), ((0, 0, 0), (-5, 1, 0.2)), ((1, 1, 0), (9, 1, 0))],
)
def test_a_car_that_drives_the_reference_arrives(start, goal):
    """Independent: integrate the kinematics of a car with the planned speed and steering angle."""
    path = CarPath(np.array(start, float), np.array(goal, float), 5.0, 1.3)
    x, y, heading = start
    steps = 4000
    h = 5.0 / steps

    def rate(pose, t):
        point = path.reference.at(t)
        u, steering = point.velocity[0], point.position[1]
        return np.array([u * np.cos(pose[2]), u * np.sin(pose[2]), u * np.tan(steering) / 1.3])

    pose = np.array([x, y, heading], float)
    for k in range(steps):
        t = k * h
        k1 = rate(pose, t)
        k2 = rate(pose + h / 2 * k1, t + h / 2)
        k3 = rate(pose + h / 2 * k2, t + h / 2)
        k4 = rate(pose + h * k3, t + h)
        pose = pose + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    np.testing.assert_allclose(pose, goal, atol=1e-4)


def test_follower_is_one_chord_behind_on_the_path():
    path = CarPath(START, GOAL, 6.0, 1.0)
    heading = path.follower(1.0)
    for t in (0.0, 1.5, 3.0, 4.5, 6.0):
        kingpin, angle = path.position.at(t).position, heading.at(t).position[0]
        axle = kingpin - np.array([np.cos(angle), np.sin(angle)])
        assert path.distance(axle[None])[0] < 1e-3  # the path is sampled


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [
        ((0, 0, 0), (0, 3, 0), "same x"),
        ((0, 0, 1.5), (5, 0, 0), "within 75 degrees"),
        ((0, 0, 0), (1, 9, 0), "turns past 75 degrees"),
    ],
)
def test_paths_that_cannot_be_driven_in_one_piece_are_refused(start, goal, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        CarPath(np.array(start, float), np.array(goal, float), 5.0, 1.0)


def test_a_trailer_does_not_slither_backwards():
    with pytest.raises(rnc.ConfigurationError, match="driven forwards"):
        CarPath(GOAL, START, 5.0, 1.0).follower(1.0)


# ---------------------------------------------------------------------- controller


def test_gradient_of_the_kinematics_is_exact():
    reduced = fire_truck()
    for q, _ in random_states(reduced, 4):
        gradient = reduced.kinematic_gradient(q, [1, 2])
        for column, output in enumerate((1, 2)):
            v = reduced.terms(q, np.eye(3)[output]).v
            h = 1e-4
            A = [
                reduced.terms(pin.integrate(reduced.robot.model, q, k * h * v), np.zeros(3)).A_star
                for k in (-2, -1, 1, 2)
            ]
            difference = (A[0] - 8 * A[1] + 8 * A[2] - A[3]) / (12 * h)
            np.testing.assert_allclose(
                gradient[..., column], difference, atol=FINITE_DIFFERENCE * (1 + np.abs(A[0]).max())
            )


def test_the_missing_rate_fades_at_k4():
    """Along the kinematics, w - A3 v21 decays as exp(-k4 t): the whole point of backstepping."""
    reduced, path, task, _, _ = truck_task()
    k4 = 6.0
    controller = SteeringController(reduced, task, path.reference, path.follower(1.0), k4=k4, damping=1e-6, fastest=1e3)
    q = reduced.robot.configuration(
        {"root_joint": [-4.5, 1.9, -0.5], "rear_steering": 0.2, "hitch": 0.15, "front_steering": 0.05}
    )
    t, h = 3.0, 1e-4
    v2 = np.array([*path.reference.at(t).velocity, 0.0])

    def missing(q, t, v2):
        m = reduced.measure(q, v2)
        x1d = controller.vertical.at(t)
        return x1d.velocity + 2.0 * (x1d.position - m.x1[[2]]) - m.v1[[2]]

    # Two targets a moment apart, each with the primary rates followed exactly.
    target, _ = controller.step(t, reduced.measure(q, v2), None)
    moving = np.array([*v2[:2], target.v2[2]])
    target, _ = controller.step(t, reduced.measure(q, moving), None)
    ahead = pin.integrate(reduced.robot.model, q, h * reduced.terms(q, moving).v)
    later = moving + h * np.array([*target.v2_dot[:2], 0.0])
    before, after = missing(q, t, moving), missing(ahead, t + h, later)
    np.testing.assert_allclose((after - before) / h, -k4 * before, rtol=0.01, atol=1e-3)


def test_the_trailer_slithers_and_the_tractor_arrives():
    reduced, path, _, steering, q0 = truck_task()
    locked = ReducingOutputController(reduced, Joined([path.reference, Hold([0.0])]))
    strayed = {}
    for name, kinematic in {"steered": steering, "locked": locked}.items():
        _, region = rnc.kinematic_rollout(reduced, kinematic, q0, 6.0, 0.1)
        tracker = VelocityTracker(kinematic, VelocityGains.scaled(reduced, region, 0.002))
        run = rnc.simulate(reduced, tracker, q0, 7.0, 0.002)
        strayed[name] = path.distance(axle_positions(reduced, run.q[::20])).max()
        assert np.abs(run.x1[-1, :2]).max() < 0.02
        assert np.abs(run.q[-1, 2] - 1.0) < 1e-3  # cosine of the tractor's heading
    assert strayed["steered"] < 0.1 * strayed["locked"]


def test_steering_refuses_a_system_that_class_1_fits():
    reduced = space_robot()
    q0 = reduced.robot.configuration({"joint_2": 1.8, "joint_3": -1.1})
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    controller = SteeringController(reduced, task, Hold(np.zeros(2)), Hold(np.zeros(1)))
    with pytest.raises(rnc.ConfigurationError, match="A4 is not zero"):
        controller.initial_state(reduced.measure(q0, np.zeros(3)))


# ---------------------------------------------------------------------- class 2


def test_class_2_is_the_class_1_law_on_the_outputs_that_can_be_tracked():
    """(13): a turret on a unicycle keeps pointing while the base drives an arc."""
    reduced = turreted()
    task = rnc.Task.of(reduced, ["body_speed_x", "body_yaw"], ["turret"], ["gun_yaw"])
    arc = MinimumJerk([0.0, 0.0], [2.0, 1.5], 3.0)
    kinematic = RedundancyController(task, arc, MinimumJerk([0.0], [-0.5], 3.0), 2.0, 2.0)
    q0 = reduced.robot.configuration()
    _, region = rnc.kinematic_rollout(reduced, kinematic, q0, 3.0, 0.1)
    tracker = VelocityTracker(kinematic, VelocityGains.scaled(reduced, region, 0.002))
    run = rnc.simulate(reduced, tracker, q0, 4.0, 0.002)
    errors = rnc.summarize(run)["final_error"]
    assert errors["gun_yaw"] < 1e-3
    assert errors["body_yaw"] < 1e-3
    assert np.ptp(run.x1[:, 1]) > 0.5
