"""Iterations of sequential quadratic programming."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.motion.optimal import EffortCost, InputBound, PostureCost, SolverSettings, VelocityCost, action_model
from rnc_pin.motion.optimal.bounds import DistanceRows
from rnc_pin.motion.optimal.guesses import along
from rnc_pin.motion.optimal.interior_point import InteriorPointSolver
from rnc_pin.motion.optimal.planner import build_problem, initial_node
from rnc_pin.motion.optimal.sequential_quadratic import SequentialQuadratic, solve_bounded
from rnc_pin.motion.optimal.transcription import Transcription
from systems import driven_panda


def count_calls(monkeypatch, owner, name):
    """Results of a method."""
    found, method = [], getattr(owner, name)

    def noted(*arguments):
        found.append(method(*arguments))
        return found[-1]

    monkeypatch.setattr(owner, name, noted)
    return found


def test_whole_steps_are_linearized_at_once_and_links_that_stay_apart_take_no_part(monkeypatch):
    reduced = driven_panda()
    start, goal = np.array([[0.0, -0.6, 0.0, -2.0, 0.0, 1.5, 0.7], [0.6, 0.1, 0.2, -1.4, 0.1, 1.8, 0.9]])
    posture = [PostureCost(goal, 0.1), PostureCost(goal, 10.0, phase="terminal")]
    costs = [EffortCost(1e-4), VelocityCost(0.01), VelocityCost(1.0, phase="terminal"), *posture]
    model = action_model(reduced, "dynamic")
    problem = build_problem(model, initial_node(model, start), None, 1.0, costs, [InputBound(-25.0, 25.0)], 40)
    guess = along(model, np.linspace(start, goal, 41), 1.0)
    once = count_calls(monkeypatch, InteriorPointSolver, "solve"), count_calls(monkeypatch, Transcription, "values")
    found = SequentialQuadratic(problem, SolverSettings()).solve(guess)
    assert sum(each.iterations for each in once[0]) <= 5.0 * found.iterations  # 6.4 from each subproblem alone
    assert len(once[1]) == 1  # the other whole steps are linearized at once
    exact = SequentialQuadratic(problem, SolverSettings(cost_tolerance=1e-12)).solve(guess)
    assert (found.outcome, found.cost) == ("solved", pytest.approx(exact.cost, rel=1e-7))
    links = rnc.optimal.DistanceBound(rnc.collision.CollisionDistances(reduced.robot))
    seen = count_calls(monkeypatch, DistanceRows, "measured")
    within = build_problem(model, initial_node(model, start), None, 1.0, costs, [InputBound(-25.0, 25.0), links], 40)
    assert solve_bounded(within, SolverSettings(), guess).cost == found.cost
    assert len(seen) == 2  # at the solution: links that stay apart take no part in the iterations
