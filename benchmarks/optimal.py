"""Optimal control: processor time of an iteration, known optima, and random parking problems.

Run it by ``python -m benchmarks.optimal [iteration] [optima] [parking] [predictive]``. Without a name all run.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import rnc_pin as rnc
from benchmarks.whole_body import model as tiago
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
from rnc_pin.optimal.guesses import along
from rnc_pin.optimal.planner import build_problem
from rnc_pin.optimal.sequential_quadratic import SequentialQuadratic
from rnc_pin.plants.mujoco import MuJoCoPlant

NODES, ROUNDS, PROBLEMS = 40, 7, 100


def knife_edge() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
    return system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])


def car() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("car.urdf", base="planar")
    rows = [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("rear_axle")]
    system = rnc.NonholonomicSystem(robot, rows, [rnc.FrameForce("rear_axle", "x"), "front_steering"])
    return system.reduce([rnc.FrameSpeed("rear_axle"), rnc.JointPosition("front_steering")])


def mobile_manipulator() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    inputs = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"]
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")], inputs)
    joints = [rnc.JointPosition("joint_1"), rnc.JointPosition("joint_2")]
    return system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base"), *joints])


def iteration_time(reduced: rnc.ReducedModel, goal: dict[object, object], limit: float) -> float:
    """Median processor time of an iteration of the dynamic form with bounded inputs [s]."""
    q0 = reduced.robot.configuration()
    problem = build_problem(reduced, q0, goal, 4.0, "dynamic", None, [InputBound(-limit, limit)], NODES)
    line = np.repeat(q0[None], NODES + 1, axis=0)
    start = along(problem.model, line, 4.0)
    solver, taken = SequentialQuadratic(problem, SolverSettings()), []
    for _ in range(ROUNDS):
        solver.restart()
        begin = time.process_time()
        solver.iterate(start)
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


def problems(count: int, refinements: int = 1) -> None:
    """Random parking of the car: goals beside, behind and ahead of it, with limits of speed and steering."""
    reduced, generator = car(), np.random.default_rng(0)
    bounds = [OutputBound(rnc.JointPosition("front_steering"), -0.6, 0.6), VelocityBound(-1.0, 1.0)]
    settings = SolverSettings(refinements=refinements)
    taken: list[float] = []
    plans: list[rnc.optimal.MotionPlan] = []
    for number in range(1, count + 1):
        x, y, heading = generator.uniform([-3.0, -2.0, -1.0], [3.0, 2.0, 1.0])
        goal = {rnc.FramePosition("rear_axle", "xy"): [x, y], rnc.FrameYaw("chassis"): heading}
        begin = time.process_time()
        try:
            q0 = reduced.robot.configuration()
            plans.append(rnc.optimal.plan(reduced, q0, goal, 16.0, bounds=bounds, settings=settings))
        except InfeasibleError as error:
            print(f"  {number}: ({x:.2f}, {y:.2f}, {heading:.2f}): {error}", flush=True)
        taken.append(time.process_time() - begin)
        if number % 10 == 0 or number == count:
            _print_statistics(number, taken, plans)


def _print_statistics(number: int, taken: list[float], plans: list[rnc.optimal.MotionPlan]) -> None:
    times = f"processor time median {np.median(taken):.2f} s, most {max(taken):.2f} s"
    print(f"parking: {len(plans)} of {number} solved, {times}")
    iterations = np.median([plan.info.iterations for plan in plans])
    violations = [plan.info.verification.violation for plan in plans]
    print(
        f"  iterations median {iterations:g}; violation after verification median {np.median(violations):.1e}, "
        f"most {max(violations):.1e} [m or rad]",
        flush=True,
    )


def parking() -> None:
    """Statistics of random parking problems, printed every ten problems."""
    problems(int(sys.argv[2]) if len(sys.argv) > 2 else PROBLEMS)


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
    "parking": parking,
    "predictive": predictive,
}

if __name__ == "__main__":
    for part in [sys.argv[1]] if len(sys.argv) > 1 else list(PARTS):
        PARTS[part]()
