"""Optimal control: processor time of an iteration, known optima, random problems, predictive control, and feedback.

Run it by ``python -m benchmarks.optimal iteration|optima|predictive|peers|updates``, or with a number of problems by
``python -m benchmarks.optimal parking|docking N``, or with numbers of problems and
of guesses by ``python -m benchmarks.optimal restarts|restarts-parking|restarts-docking|restarts-satellite N M``. All
run without a name.
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
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.row_stack import OutputStack
from rnc_pin.optimal import (
    EffortCost,
    InputBound,
    OutputBound,
    OutputCost,
    PredictiveController,
    SolverSettings,
    VelocityBound,
    VelocityCost,
)
from rnc_pin.optimal.bounds import GoalRows
from rnc_pin.optimal.guesses import along
from rnc_pin.optimal.planner import build_problem, initial_node
from rnc_pin.optimal.sequential_quadratic import SequentialQuadratic
from rnc_pin.planning.action_models import action_model
from rnc_pin.plants.mujoco import MuJoCoPlant

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
    solver, taken = SequentialQuadratic(problem, SolverSettings()), []
    for _ in range(ROUNDS):
        solver.restart()
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

    settings = SolverSettings(accuracy=1e-2)
    return rnc.optimal.plan(reduced, **problem, settings=settings, feedback=regulator, **options)


def problems(name: str, reduced: rnc.ReducedModel, draw: Draw, count: int) -> None:
    """Plan random problems; print statistics every ten problems."""
    generator = np.random.default_rng(0)
    taken: list[float] = []
    plans: list[rnc.optimal.MotionPlan] = []

    for number in range(1, count + 1):
        problem, begin = draw(generator), time.process_time()
        try:
            plans.append(planned(reduced, problem))
        except InfeasibleError as error:
            print(f"  {number}: {error}", flush=True)
        taken.append(time.process_time() - begin)
        if number % 10 == 0 or number == count:
            _print_statistics(name, number, taken, plans)


def _print_statistics(name: str, number: int, taken: list[float], plans: list[rnc.optimal.MotionPlan]) -> None:
    times = f"processor time median {np.median(taken):.2f} s, most {max(taken):.2f} s"
    print(f"{name}: {len(plans)} of {number} solved, {times}", flush=True)
    if plans:
        iterations = np.median([plan.info.iterations for plan in plans])
        print(f"  iterations median {iterations:g}; violation after verification [m or rad]:", flush=True)
        for kind in ("inputs", "feedback"):
            found = [getattr(plan.info.verification, kind).violation for plan in plans]
            print(f"    {kind}: median {np.median(found):.1e}, most {max(found):.1e}", flush=True)


def _parking() -> tuple[rnc.ReducedModel, Draw]:
    """Parking of the car: goals beside, behind and ahead of it, with limits of speed and steering."""
    reduced = car()
    bounds = [OutputBound(rnc.JointPosition("front_steering"), -0.6, 0.6), VelocityBound(-1.0, 1.0)]

    def draw(generator: np.random.Generator) -> Problem:
        x, y, heading = generator.uniform([-3.0, -2.0, -1.0], [3.0, 2.0, 1.0])
        goal = {rnc.FramePosition("rear_axle", "xy"): [x, y], rnc.FrameYaw("chassis"): heading}
        return {"q0": reduced.robot.configuration(), "goal": goal, "duration": 16.0, "bounds": bounds}

    return reduced, draw


def docking_problems() -> None:
    """Docking of a tractor with one and with two trailers; walls are not part of it."""
    for trailers in (1, 2):
        problems(f"docking, trailers {trailers}", *_docking(trailers), _count(40))


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


def predictive() -> None:
    """Model-predictive control at 20 Hz in MuJoCo, whose wheels slip and whose contacts are soft."""
    cases: dict[str, tuple[rnc.ReducedModel, list[object], list[float]]] = {
        "car": (car(), [rnc.FramePosition("rear_axle", "xy"), rnc.FrameYaw("chassis")], [2.5, 0.6, 0.0]),
        "mobile manipulator": (mobile_manipulator(), [rnc.FramePosition("tip", "xy")], [2.4, 0.3]),
    }
    print("model-predictive control at 20 Hz in MuJoCo, 20 nodes over 2.5 s, one iteration for each update")
    for name, (reduced, outputs, target) in cases.items():
        costs = [EffortCost(1e-3), VelocityCost(0.3, phase="both"), OutputCost(outputs, target, 10.0, "both")]
        controller = _Timed(reduced, costs, 2.5, form="acceleration", bounds=[VelocityBound(-1.0, 1.0)])
        start = reduced.robot.configuration()
        plant = MuJoCoPlant(reduced, q0=start)
        run = rnc.simulate(reduced, controller, start, 5.0, 0.01, plant=plant)
        kinematics = Kinematics(reduced.robot).position(run.q[-1])
        stack = OutputStack([each.bind(reduced.robot) for each in outputs])  # type: ignore[attr-defined]
        error = np.abs(stack.value(kinematics) - target).max()
        taken = 1e3 * np.array(controller.taken)
        late = np.mean(taken > 50.0)
        print(f"  {name:20s} update median {np.median(taken):.1f} ms, most {taken.max():.1f} ms of processor time, "
              f"{late:.0%} above 50 ms; largest error at the end {error:.1e} [m or rad]", flush=True)  # fmt: skip


class _Timed(PredictiveController):
    """Controller that records the processor time of its samples with an update."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.taken: list[float] = []

    def step(self, t: float, measurement: Any, state: Any) -> Any:
        begin = time.process_time()
        command, after = super().step(t, measurement, state)
        if after.next_update != state.next_update:
            self.taken.append(time.process_time() - begin)
        return command, after


PARTS: dict[str, Callable[[], None]] = {
    "iteration": iteration,
    "optima": optima,
    "parking": lambda: problems("parking", *_parking(), _count(100)),
    "docking": docking_problems,
    "restarts": known_costs,
    "restarts-parking": lambda: restarts("parking", *_parking()),
    "restarts-docking": lambda: restarts("docking, two trailers", *_docking(2)),
    "restarts-satellite": lambda: restarts("turns of a satellite", *_turning_satellite()),
    "predictive": predictive,
    "peers": peers,
    "updates": updates,
}

if __name__ == "__main__":
    for part in [sys.argv[1]] if len(sys.argv) > 1 else list(PARTS):
        PARTS[part]()
