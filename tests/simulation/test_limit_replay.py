"""Replay against limits: excesses that are put into a run, and Pinocchio's own limits."""

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.collision import Obstacle
from rnc_pin.simulation import replay_limits


@pytest.fixture(scope="module")
def run_of_panda():
    robot = rnc.Robot.from_example("panda", lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0})
    joints = list(robot.joint_names)
    reduced = rnc.NonholonomicSystem(robot, [], joints).reduce([rnc.JointPosition(name) for name in joints])
    q0 = robot.configuration({"panda_joint2": -0.4, "panda_joint4": -1.8, "panda_joint6": 1.5})
    rest = rnc.control.ReducingOutputController(reduced, rnc.planning.MinimumJerk(q0, q0 + 0.2, duration=0.5))
    return robot, rnc.simulate(reduced, rnc.control.ComputedTorque(reduced, rest), q0, duration=0.6)


def test_clean_run_has_no_violations(run_of_panda):
    robot, run = run_of_panda
    replay = replay_limits(robot, run)
    assert not replay.violations
    assert not replay.collisions
    assert len(replay.uses) == 3 * 7
    effort = replay.worst("effort")
    shares = np.abs(run.T) / robot.model.upperEffortLimit - 1.0
    assert effort.excess == pytest.approx(shares.max())


def test_excesses_are_found_with_time_and_share(run_of_panda):
    robot, run = run_of_panda
    model = robot.model
    q, v, T = run.q.copy(), run.v.copy(), run.T.copy()
    q[40, 1] = model.upperPositionLimit[1] + 0.01
    v[50, 2] = -1.25 * model.upperVelocityLimit[2]
    T[60, 3] = 2.0 * model.upperEffortLimit[3]
    replay = replay_limits(robot, replace(run, q=q, v=v, T=T))
    found = {(use.kind, use.name): use for use in replay.violations}
    assert set(found) == {("position", "panda_joint2"), ("velocity", "panda_joint3"), ("effort", "panda_joint4")}
    reach = model.upperPositionLimit[1] - model.lowerPositionLimit[1]
    assert found["position", "panda_joint2"].excess == pytest.approx(0.01 / reach)
    assert found["velocity", "panda_joint3"].excess == pytest.approx(0.25)
    assert found["effort", "panda_joint4"].excess == pytest.approx(1.0)
    assert found["velocity", "panda_joint3"].time == run.time[50]
    assert "25 %" in str(found["velocity", "panda_joint3"])


def test_collisions_with_obstacles_are_found(run_of_panda):
    robot, run = run_of_panda
    start = robot.model.createData()
    pin.framesForwardKinematics(robot.model, start, run.q[-1])
    hand = start.oMf[robot.frame_id("panda_hand")].translation
    ball = Obstacle(coal.Sphere(0.05), position=hand, name="ball")
    replay = replay_limits(robot, run, [ball], step=0.02)
    worst = replay.collisions[0]
    assert worst.obstacle
    assert worst.names[1] == "ball"
    assert worst.distance == replay.distances[:, 0].min()
    assert replay.time[replay.distances[:, 0].argmin()] == worst.time
    assert np.diff(replay.time).min() > 0.02 - 1e-9
    assert replay.time[-1] == run.time[-1]
    assert all(replay.distances[:, k].min() < replay.within for k in range(len(replay.clearances)))


def test_other_robot_is_refused(run_of_panda):
    _, run = run_of_panda
    with pytest.raises(rnc.InputError, match="nq of the robot"):
        replay_limits(rnc.Robot.from_urdf("space_robot.urdf"), run)
