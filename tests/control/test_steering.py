"""Class 2s: backstepping of the fire truck's rear steering (section 4.3); class 2."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from controlled_tasks import truck_task
from rnc_pin.control import (
    RedundancyController,
    SteeringController,
    VelocityGains,
    VelocityTracker,
)
from rnc_pin.planning import Hold, MinimumJerk
from systems import fire_truck, random_states, space_robot
from textbook_systems import turreted
from tolerances import FINITE_DIFFERENCE

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
    k4 = 6.0
    reduced, path, _, controller, _ = truck_task(k4=k4, damping=1e-6, max_rate=1e3)
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
    here = path.reference.at(t).position
    integrals = np.array([here[0], 0.0, 0.0])
    target, _ = controller.step(t, reduced.measure(q, v2, integrals), None)
    moving = np.array([*v2[:2], target.v2[2]])
    target, _ = controller.step(t, reduced.measure(q, moving, integrals), None)
    ahead = pin.integrate(reduced.robot.model, q, h * reduced.terms(q, moving).v)
    later = moving + h * np.array([*target.v2_dot[:2], 0.0])
    before, after = missing(q, t, moving), missing(ahead, t + h, later)
    np.testing.assert_allclose((after - before) / h, -k4 * before, rtol=0.01, atol=1e-3)


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
