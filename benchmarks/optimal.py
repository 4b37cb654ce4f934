"""Optimal control: processor time of an iteration, known optima, costs beside those of many guesses, and peers.

Run it by ``python -m benchmarks.optimal iteration|optima|peers|updates``, or with numbers of problems and of guesses by
``python -m benchmarks.optimal restarts|restarts-parking|restarts-docking|restarts-satellite N M``. All run without a
name.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

import rnc_pin as rnc
from benchmarks.plan_peers import peers, updates
from benchmarks.planned_models import car, docking, knife_edge, mobile_manipulator
from benchmarks.whole_body import model as tiago
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import InfeasibleError
from rnc_pin.motion.optimal import InputBound, OutputBound, SolverSettings, VelocityBound
from rnc_pin.motion.optimal.bounds import GoalRows
from rnc_pin.motion.optimal.guesses import along
from rnc_pin.motion.optimal.planner import build_problem, initial_node
from rnc_pin.motion.optimal.sequential_quadratic import SequentialQuadratic
from rnc_pin.motion.planning.action_models import action_model

NODES, ROUNDS = 40, 7
_RESTARTS = 100  # guesses among whose solutions the cheapest counts as the best known


def iteration_time(reduced: rnc.ReducedModel, goal: dict[object, object], limit: float) -> float:
    """Median processor time of an iteration of the dynamic form with bounded inputs [s]."""
    q0 = reduced.robot.configuration()
    model = action_model(reduced, "dynamic")
    start, end = initial_node(model, q0), GoalRows(model, goal, at_rest=True)
    problem = build_problem(model, start, end, 4.0, None, [InputBound(-limit, limit)], NODES)
    line = np.repeat(q0[None], NODES + 1, axis=0)
    guess = along(model, line, 4.0)
    taken = []
    for _ in range(ROUNDS):
        solver = SequentialQuadratic(problem, SolverSettings())
        begin = time.process_time()
        solver.iterate(guess)
        taken.append(time.process_time() - begin)
    return float(np.median(taken[1:]))


def iteration() -> None:
    cases = {
        "mobile manipulator": (mobile_manipulator(), {rnc.FramePosition("tip", "xy"): [2.4, 0.1]}, 4.0),
        "TIAGo": (tiago(), {rnc.FramePosition("arm_7_link"): [0.6, 0.1, 0.7]}, 400.0),
    }
    print(f"one iteration, {NODES} nodes, dynamic form [ms of processor time]")
    for name, (reduced, goal, limit) in cases.items():
        free, bound = (1e3 * iteration_time(reduced, goal, each) for each in (1e6, limit))
        print(f"  {name:20s} no active bound {free:6.1f}   bound {limit:g} on inputs {bound:6.1f}")


def optima() -> None:
    reduced = knife_edge()
    start = reduced.robot.configuration()
    print("known optima: found, exact")
    goal = {rnc.FramePosition("sleigh", "xy"): [1.0, 0.0], rnc.FrameYaw("sleigh"): 0.0}
    plan = rnc.optimal.plan(reduced, start, goal, 2.0)
    print(f"  least squared acceleration over 1 m in 2 s: {plan.info.cost:.5f} {0.75:.5f}")
    plan = rnc.optimal.plan(reduced, start, goal, (0.5, 10.0), time_weight=2.0)
    print(f"  free duration, effort against time: {plan.duration:.4f} {9.0**0.25:.4f}")
    print(f"  sideways motion of least velocity (Brockett): {_sideways(reduced, 1e-3):.6f} {2e-3 * np.pi:.6f}")


def _sideways(reduced: rnc.ReducedModel, y: float) -> float:
    """Cost of a motion aside by a small distance in one second, from a circle of the integrals of the velocities."""
    phase = np.linspace(0, 2 * np.pi, 61)
    x, yaw = np.sqrt(y / np.pi) * np.sin(phase), np.sqrt(y / np.pi) * (1 - np.cos(phase))
    side = -np.concatenate([[0.0], np.cumsum((yaw[1:] + yaw[:-1]) / 2 * np.diff(x))])
    guess = np.column_stack([x, -np.sign(side[-1]) * side, np.cos(yaw), np.sin(yaw)])
    goal = {rnc.FramePosition("sleigh", "xy"): [0.0, y], rnc.FrameYaw("sleigh"): 0.0}
    settings = SolverSettings(nodes=60, tolerance=1e-8)
    return rnc.optimal.plan(reduced, guess[0], goal, 1.0, form="kinematic", guess=guess, settings=settings).info.cost


Problem = dict[str, Any]
"""Arguments of a plan: start, goal and bounds."""


Draw = Callable[[np.random.Generator], Problem]


def planned(reduced: rnc.ReducedModel, problem: Problem, **options: Any) -> rnc.optimal.MotionPlan:
    """Plan of a random problem for a regulator that can reverse."""

    def regulator(plan: rnc.optimal.MotionPlan) -> np.ndarray:
        return rnc.tvlqr(reduced, plan, state_cost=20.0).K

    settings = SolverSettings(accuracy=1e-2, reserve=0.0)
    return rnc.optimal.plan(reduced, **problem, settings=settings, feedback=regulator, **options)


def _parking() -> tuple[rnc.ReducedModel, Draw]:
    """Parking of the car: goals beside, behind and ahead of it, with limits of speed and steering."""
    reduced = car()
    bounds = [OutputBound(rnc.JointPosition("front_steering"), -0.6, 0.6), VelocityBound(-1.0, 1.0)]

    def draw(generator: np.random.Generator) -> Problem:
        x, y, heading = generator.uniform([-3.0, -2.0, -1.0], [3.0, 2.0, 1.0])
        goal = {rnc.FramePosition("rear_axle", "xy"): [x, y], rnc.FrameYaw("chassis"): heading}
        return {"q0": reduced.robot.configuration(), "goal": goal, "duration": 16.0, "bounds": bounds}

    return reduced, draw


def _docking(trailers: int) -> tuple[rnc.ReducedModel, Draw]:
    """Docking from a random pose ahead."""
    reduced, goal, bounds = docking(trailers, most_bent=1.2)

    def draw(generator: np.random.Generator) -> Problem:
        pose = generator.uniform([2.0, -2.0, -0.6], [5.0, 2.0, 0.6])
        q0 = reduced.robot.configuration({"root_joint": pose})
        return {"q0": q0, "goal": goal, "duration": 16.0, "bounds": bounds}

    return reduced, draw


def _turning_satellite() -> tuple[rnc.ReducedModel, Draw]:
    """Turns of a satellite by its arm, which returns to its posture."""
    robot = rnc.Robot.from_urdf("space_robot.urdf", base="fixed")
    arm = [rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)]
    reduced = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")]).reduce(arm)

    def draw(generator: np.random.Generator) -> Problem:
        angles, turn = generator.uniform(-1.5, 1.5, 3).tolist(), generator.uniform(-2.0, 2.0)
        q0 = robot.configuration({each.joint: angle for each, angle in zip(arm, angles, strict=True)})
        goal = {rnc.JointPosition("platform"): turn, **dict(zip(arm, angles, strict=True))}
        return {"q0": q0, "goal": goal, "duration": 10.0, "bounds": []}

    return reduced, draw


def restarts(name: str, reduced: rnc.ReducedModel, draw: Draw) -> None:
    """Cost of drawn plans by usual settings over the least cost from many guesses."""
    generator, count, many = np.random.default_rng(0), _count(10), _many()
    ratios: list[float] = []
    for _ in range(count):
        problem = draw(generator)
        try:
            ours = planned(reduced, problem).info.cost
        except InfeasibleError:
            continue
        ratios.append(ours / min(ours, planned(reduced, problem, **many).info.cost))
        print(f"  {ratios[-1]:.4f}", end="", flush=True)
    share = np.mean(np.array(ratios) <= 1.05)
    spread = f"median {np.median(ratios):.3f}, most {max(ratios):.3f}, {share:.0%} within 5 %"
    print(f"\ndrawn {name}, cost over the least of {many['solutions']} guesses: {spread}, "
          f"{len(ratios)} of {count} planned", flush=True)  # fmt: skip


def known_costs() -> None:
    """Cost of the plans of scenarios over the least cost from many guesses."""
    many = _many()
    for name in ("parallel-parking", "docking", "space-robot-turn"):
        choices = {"plots": {}, "comparisons": {}}, {f"planner.{key}": value for key, value in many.items()}
        ours, best = (
            Scenario.load(name, {**choices[0], **each}).build().experiment.plan.info.cost for each in ({}, choices[1])
        )
        print(f"  {name}: {ours / min(ours, best):.3f} ({ours:.4g})", flush=True)


def _many() -> dict[str, int]:
    """Options of a plan from many guesses: the second number of the command line."""
    warnings.simplefilter("ignore", rnc.ModelWarning)  # fewer solutions than guesses
    return {"solutions": int(sys.argv[3]) if len(sys.argv) > 3 else _RESTARTS, "seeds": 0}


def _count(usual: int) -> int:
    return int(sys.argv[2]) if len(sys.argv) > 2 else usual


PARTS: dict[str, Callable[[], None]] = {
    "iteration": iteration,
    "optima": optima,
    "restarts": known_costs,
    "restarts-parking": lambda: restarts("parking", *_parking()),
    "restarts-docking": lambda: restarts("docking, two trailers", *_docking(2)),
    "restarts-satellite": lambda: restarts("turns of a satellite", *_turning_satellite()),
    "peers": peers,
    "updates": updates,
}

if __name__ == "__main__":
    for part in [sys.argv[1]] if len(sys.argv) > 1 else list(PARTS):
        PARTS[part]()
