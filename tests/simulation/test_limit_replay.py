"""Replay against limits: excesses that are put into a run, and Pinocchio's own limits."""

from dataclasses import replace

import coal
import numpy as np
import pytest

import rnc_pin as rnc
from bodies import frame_placement
from rnc_pin.collision import Obstacle, ground_shape
from rnc_pin.simulation import obstacles_passed, replay_limits
from systems import driven_panda
from urdf_parts import joint, link, read, wheel


@pytest.fixture(scope="module")
def run_of_panda():
    reduced = driven_panda()
    q0 = reduced.robot.configuration({"panda_joint2": -0.4, "panda_joint4": -1.8, "panda_joint6": 1.5})
    rest = rnc.control.ReducingOutputController(reduced, rnc.planning.MinimumJerk(q0, q0 + 0.2, duration=0.5))
    return reduced.robot, rnc.simulate(reduced, rnc.control.ComputedTorque(reduced, rest), q0, duration=0.6)


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
    found = {(use.kind, use.name): use for use in replay_limits(robot, replace(run, q=q, v=v, T=T)).violations}
    assert set(found) == {("position", "panda_joint2"), ("velocity", "panda_joint3"), ("effort", "panda_joint4")}
    reach = model.upperPositionLimit[1] - model.lowerPositionLimit[1]
    assert found["position", "panda_joint2"].excess == pytest.approx(0.01 / reach)
    assert found["velocity", "panda_joint3"].excess == pytest.approx(0.25)
    assert found["effort", "panda_joint4"].excess == pytest.approx(1.0)
    assert found["velocity", "panda_joint3"].time == run.time[50]
    assert "25 %" in str(found["velocity", "panda_joint3"])


def test_collisions_with_obstacles_are_found(run_of_panda):
    robot, run = run_of_panda
    hand = frame_placement(robot, run.q[-1], "panda_hand").translation
    ball = Obstacle(coal.Sphere(0.05), position=hand, name="ball")
    replay = replay_limits(robot, run, [ball], step=0.02)
    worst = replay.collisions[0]
    assert worst.obstacle
    assert worst.names[1] == "ball"
    every = replay_limits(robot, run, [ball])
    assert replay.distances[:, 0].min() - 0.02 < worst.distance <= replay.distances[:, 0].min()
    assert worst.distance == pytest.approx(every.collisions[0].distance, abs=2 * replay.tolerance)
    assert replay.nearest(obstacle=True) is worst
    assert np.diff(replay.time).min() > 0.02 - 1e-9
    assert replay.time[-1] == run.time[-1]
    assert all(replay.distances[:, k].min() < replay.within for k in range(len(replay.clearances)))


WHEELS = ("wheel_left", "wheel_right")


def cart_with_arm(folder):
    """A cart on two wheels with an arm of two links that reaches below the floor."""
    turning, arm = {"kind": "revolute", "limits": (-3, 3)}, {"shape": '<box size="0.35 0.04 0.04"/>', "at": "0.2 0 0"}
    parts = [link("cart", shape='<box size="0.4 0.3 0.2"/>', at="0 0 0.25"), link("upper", **arm), link("lower", **arm)]
    parts += [wheel(name, "cart", (0, y, 0.1)) for name, y in zip(WHEELS, (0.2, -0.2), strict=True)]
    parts += [joint("shoulder", "cart", "upper", (0.25, 0, 0.3), **turning)]
    parts += [joint("elbow", "upper", "lower", (0.4, 0, 0), **turning)]
    return read(folder / "cart.urdf", *parts, base="planar")


def run_through(robot, *places):
    reduced = rnc.NonholonomicSystem(robot, []).reduce()
    run = rnc.free_motion(reduced, robot.configuration(), np.zeros(reduced.r), duration=1.0, dt=0.5)
    q = np.array([robot.configuration(dict(zip(("shoulder", "elbow"), each, strict=True))) for each in places])
    return replace(run, q=q, v=np.zeros_like(run.v))


def test_an_arm_that_reaches_through_the_floor(tmp_path):
    robot = cart_with_arm(tmp_path)
    run = run_through(robot, (0.0, 0.0), (0.8, 0.0), (0.0, 0.0))
    assert not replay_limits(robot, run).collisions
    floor = Obstacle(ground_shape(), name="floor", ignored_links=WHEELS)
    replay = replay_limits(robot, run, [floor], step=1.0)  # before and after the arm is below the floor
    assert replay.distances.min() > 0.0
    assert {each.names for each in replay.collisions} == {("lower", "floor")}
    # The box of the lower link ends at 0.775 m from the shoulder, which is at the height 0.3 m.
    depth = 0.775 * np.sin(0.8) + 0.02 * np.cos(0.8) - 0.3
    assert replay.collisions[0].distance == pytest.approx(-depth, abs=replay.tolerance)
    assert replay.collisions[0].time == pytest.approx(0.5, abs=0.01)
    everywhere = replay_limits(robot, run, [Obstacle(ground_shape(), name="floor")])
    assert {each.names[0] for each in everywhere.clearances} >= {*WHEELS, "lower"}


def test_pairs_of_links_whose_distance_is_constant_are_not_the_nearest(tmp_path):
    robot = cart_with_arm(tmp_path)
    still = run_through(robot, *((0.3, 0.2),) * 3)
    assert replay_limits(robot, still, within=0.5).nearest(obstacle=False) is None
    moving = replay_limits(robot, run_through(robot, (0.0, 0.0), (0.0, 2.0), (0.2, 2.6)), within=0.5)
    nearest = moving.nearest(obstacle=False)
    assert nearest is not None
    assert not nearest.constant
    constant = {each.names for each in moving.clearances if each.constant}
    assert ("wheel_left", "wheel_right") in constant
    assert nearest.distance == min(each.distance for each in moving.clearances if not each.constant)


def test_a_run_without_end_is_not_certain(tmp_path):
    robot = cart_with_arm(tmp_path)
    run = run_through(robot, (0.0, 0.0), (1e7, -1e7), (-1e9, 1e9))
    wall = Obstacle(coal.Box(0.1, 9.0, 9.0), position=(1.13, 0.0, 0.0), name="wall")
    assert any(each.uncertain for each in replay_limits(robot, run, [wall], within=0.3).clearances)


def test_other_robot_is_refused(run_of_panda):
    _, run = run_of_panda
    with pytest.raises(rnc.InputError, match="nq of the robot"):
        replay_limits(rnc.Robot.from_urdf("space_robot.urdf"), run)


def test_a_plan_through_a_thin_wall_between_two_samples_passes_it(tmp_path):
    robot = cart_with_arm(tmp_path)
    q = np.array([robot.configuration()] * 2)
    q[1, 0] = 4.0
    wall = Obstacle(coal.Box(0.005, 4.0, 2.0), position=(2.5, 0.0, 0.0), name="wall")
    floor = Obstacle(ground_shape(), name="floor", ignored_links=WHEELS)
    (passed,) = obstacles_passed(robot, np.array([0.0, 2.0]), q, [wall, floor])
    assert passed.names[1] == "wall"
    assert passed.distance < -0.1
    assert 0.5 < passed.time < 1.5
