"""Guesses: loops whose phase leads to the goal and plans from them, near the best known; paths of a car."""

from itertools import islice

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from benchmarks.planned_models import car
from rnc_pin.motion.optimal.bounds import GoalRows
from rnc_pin.motion.optimal.guesses import guesses
from rnc_pin.motion.optimal.planner import build_problem, initial_node
from rnc_pin.motion.planning.action_models import action_model

BEST = 1.93506  # of 40 solutions from random guesses
ARM = {"joint_1": -0.4, "joint_2": 1.2, "joint_3": -0.8}


def space_robot(*constraints):
    robot = rnc.Robot.from_urdf("space_robot.urdf", base="fixed")
    joints = [rnc.JointPosition(name) for name in ("platform", *ARM)[0 if not constraints else 1 :]]
    return rnc.NonholonomicSystem(robot, constraints).reduce(joints)


def tried(reduced, goal, count=6):
    model = action_model(reduced, "acceleration")
    start = initial_node(model, reduced.robot.configuration(ARM))
    problem = build_problem(model, start, GoalRows(model, goal, True), 10.0, None, [], 40, None)
    return start.q[0], list(islice(guesses(problem, goal, None, count, 0), count))


def turned(angle):
    return {rnc.JointPosition(name): value for name, value in {"platform": angle, **ARM}.items()}


@pytest.mark.parametrize("angle", [0.4, -1.2])
def test_loops_turn_the_platform_by_their_phase_and_return_the_arm(angle):
    reduced = space_robot(rnc.MomentumConservation("platform"))
    q0, found = tried(reduced, turned(angle))
    loops = [each for name, each in found if name.startswith("loop")]
    assert len(loops) == 4
    platform, *arm = (reduced.robot.velocity_indices(name) for name in ("platform", *ARM))
    arm = np.r_[tuple(arm)]
    for each in loops:
        driven = 0.0  # of the platform, by momentum alone along the path of the arm
        for before, after in zip(each.q[:-1], each.q[1:], strict=True):
            R = reduced.at(pin.interpolate(reduced.robot.model, before, after, 0.5)).R
            moved = pin.difference(reduced.robot.model, before, after)[arm]
            driven += (R[platform] @ np.linalg.solve(R[arm], moved)).item()
        assert driven == pytest.approx(angle, rel=0.05)
        np.testing.assert_allclose(pin.difference(reduced.robot.model, q0, each.q[-1])[arm], 0.0, atol=1e-9)


def test_rows_that_follow_the_straight_line_need_no_loop():
    _, found = tried(space_robot(), turned(0.4))
    assert not any(name.startswith("loop") for name, _ in found)


def test_paths_of_a_car_differ_in_direction_and_reversals_and_take_turns_with_random_motions():
    reduced = car()
    model = action_model(reduced, "acceleration")
    start = initial_node(model, reduced.robot.configuration())
    goal = {rnc.FramePosition("rear_axle", "xy"): [-2.9, 1.25], rnc.FrameYaw("chassis"): 0.83}
    problem = build_problem(model, start, GoalRows(model, goal, True), 16.0, None, [], 200, None)
    found = list(guesses(problem, goal, None, 10, 0))
    assert [name.split()[0] == "random" for name, _ in found[1:7]] == [False, True] * 3
    paths = {name: each for name, each in found[1:] if "reversal" in name}
    assert len(paths) >= 3
    for name, each in paths.items():
        direction, count = name.split(", ")
        pairs = zip(each.q[:-1], each.q[1:], strict=True)
        steps = np.array([pin.difference(reduced.robot.model, *two) for two in pairs])
        driven = np.sign(steps[np.abs(steps[:, 0]) > 1e-3, 0])  # of the rear axle, in its own direction
        assert (driven[0] > 0.0) == (direction == "forwards")
        assert (np.diff(driven) != 0).sum() == int(count.split()[0])
        np.testing.assert_allclose(steps[:, 1], 0.0, atol=1e-3)  # no slip across a step but that of a corner
        np.testing.assert_allclose(each.q[-1, :2], [-2.9, 1.25], atol=1e-5)


def test_the_first_loop_is_near_the_best_plan_of_many():
    reduced = space_robot(rnc.MomentumConservation("platform"))
    plan = rnc.optimal.plan(reduced, reduced.robot.configuration(ARM), turned(np.pi / 2), 10.0)
    assert plan.info.guess.startswith("loop")
    assert plan.info.cost < 1.02 * BEST
