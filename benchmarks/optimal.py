"""Optimal control: processor time of an iteration, known optima, random problems, and model-predictive control.

Run it by ``python -m benchmarks.optimal iteration|optima|predictive``, or with a number of problems by
``python -m benchmarks.optimal parking|docking|dubins|reeds-shepp N``. Without a name all run.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import rnc_pin as rnc
from benchmarks.shortest_paths import LEFT, RIGHT, STRAIGHT, drive, dubins_length, reeds_shepp_length
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
from rnc_pin.robots.vehicles import tractor_trailers_urdf

NODES, ROUNDS = 40, 7
LIMIT = (0.01, 0.001, 0.0001)
"""Weights of the effort that tend to the shortest path."""
SHORTEST = {"dubins": (0.0, dubins_length, (0.1, *LIMIT)), "reeds-shepp": (-1.0, reeds_shepp_length, LIMIT)}
"""Smallest speed, length in closed form, and weights of the effort. A large first weight removes cusps."""
STEERING = {0.0: 20.0, -1.0: 200.0}
"""Largest rate of the steering [rad/s] by smallest speed. The closed forms have no limit, and turn at once at cusps."""
CANDIDATES = 3
"""Local optima of the first weight that become guesses for the next."""


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


Problem = dict[str, Any]
"""Arguments of a plan: start, goal and bounds."""


def problems(name: str, reduced: rnc.ReducedModel, draw: Callable[[np.random.Generator], Problem], count: int) -> None:
    """Plan random problems with one refinement; print statistics every ten problems."""
    generator, settings = np.random.default_rng(0), SolverSettings(refinements=1)
    taken: list[float] = []
    plans: list[rnc.optimal.MotionPlan] = []
    for number in range(1, count + 1):
        problem, begin = draw(generator), time.process_time()
        try:
            plans.append(rnc.optimal.plan(reduced, **problem, settings=settings))
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
        violations = [plan.info.verification.violation for plan in plans]
        print(
            f"  iterations median {iterations:g}; violation after verification median {np.median(violations):.1e}, "
            f"most {max(violations):.1e} [m or rad]",
            flush=True,
        )


def parking() -> None:
    """Parking of the car: goals beside, behind and ahead of it, with limits of speed and steering."""
    reduced = car()
    bounds = [OutputBound(rnc.JointPosition("front_steering"), -0.6, 0.6), VelocityBound(-1.0, 1.0)]

    def draw(generator: np.random.Generator) -> Problem:
        x, y, heading = generator.uniform([-3.0, -2.0, -1.0], [3.0, 2.0, 1.0])
        goal = {rnc.FramePosition("rear_axle", "xy"): [x, y], rnc.FrameYaw("chassis"): heading}
        return {"q0": reduced.robot.configuration(), "goal": goal, "duration": 16.0, "bounds": bounds}

    problems("parking", reduced, draw, _count(100))


def tractor(trailers: int) -> rnc.ReducedModel:
    """Tractor with trailers, each hitched on the axle before."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "tractor.urdf"
        file.write_text(tractor_trailers_urdf(trailers))
        robot = rnc.Robot.from_urdf(file, base="planar")
    axles = ["front_axle", "tractor_axle", *(f"axle_{k}" for k in range(1, trailers + 1))]
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip(axle) for axle in axles])
    return system.reduce([rnc.FrameSpeed("tractor"), rnc.JointPosition("front_steering")])


def docking() -> None:
    """Docking of a tractor with one and with two trailers, from a random pose ahead; walls are not part of it."""
    for trailers in (1, 2):
        dock(trailers, _count(40))


def dock(trailers: int, count: int) -> None:
    """Docking: the vehicle ends straight at the origin, with limits of speed, steering angle and hitch angles."""
    reduced = tractor(trailers)
    hitches = [rnc.JointPosition(joint) for joint in reduced.robot.joint_names if joint.startswith("hitch")]
    steering = OutputBound(rnc.JointPosition("front_steering"), -0.8, 0.8)
    bounds = [steering, VelocityBound(-1.0, 1.0), OutputBound(hitches, -1.2, 1.2)]
    goal = {rnc.FramePosition("tractor", "xy"): [0.0, 0.0], rnc.FrameYaw("tractor"): 0.0, **dict.fromkeys(hitches, 0.0)}

    def draw(generator: np.random.Generator) -> Problem:
        pose = generator.uniform([2.0, -2.0, -0.6], [5.0, 2.0, 0.6])
        q0 = reduced.robot.configuration({"root_joint": pose})
        return {"q0": q0, "goal": goal, "duration": 16.0, "bounds": bounds}

    problems(f"docking, trailers {trailers}", reduced, draw, count)


def _count(usual: int) -> int:
    return int(sys.argv[2]) if len(sys.argv) > 2 else usual


def shortest_plan(
    reduced: rnc.ReducedModel,
    pose: tuple[float, float, float],
    slowest: float,
    starts: int,
    weights: Sequence[float] = LIMIT,
) -> rnc.optimal.MotionPlan:
    """Plan of least duration of the car with turning radius 1 and speed up to 1: the limit of a small effort weight.

    The first weight is for all guesses, random drives with constant steering in a few segments. The cheapest plans
    become guesses for the other weights.

    Args:
        reduced: the car, with a wheelbase of 1 m.
        pose: x, y and heading at the end.
        slowest: 0 for forward motion only, -1 for both directions.
        starts: number of guesses.
        weights: of the effort, in falling order.

    Raises:
        InfeasibleError: no guess leads to the pose.
    """
    goal = {rnc.FramePosition("rear_axle", "xy"): pose[:2], rnc.FrameYaw("chassis"): pose[2]}
    steering = OutputBound(rnc.JointPosition("front_steering"), -np.pi / 4, np.pi / 4)
    rate = STEERING[slowest]
    bounds = [InputBound([slowest, -rate], [1.0, rate]), steering]
    start = reduced.robot.configuration()
    shortest = max(0.5, float(np.hypot(*pose[:2])))  # the straight line keeps guesses from a vanishing duration
    found = random_drives(reduced, pose, slowest, starts)
    for weight in weights:
        finer = 3 if weight == LIMIT[-1] else 0  # with accuracy 0 the intervals are always halved
        settings = SolverSettings(iterations=60, tolerance=1e-4, substeps=4, refinements=finer, accuracy=0.0)
        costs, plans = [EffortCost([0.1 * weight, weight])], []
        for guess in found:
            with suppress(InfeasibleError):
                plans.append(
                    rnc.optimal.plan(
                        reduced, start, goal, (shortest, 15.0), form="kinematic", costs=costs, bounds=bounds,
                        time_weight=1.0, settings=settings, guess=guess, seeds=0,
                    )
                )  # fmt: skip
        found = sorted(plans, key=lambda each: each.duration)[:CANDIDATES] or (found if weight < weights[0] else [])
    if not found:
        raise InfeasibleError(f"none of {starts} guesses leads to the pose")
    return found[0]


def random_drives(reduced: rnc.ReducedModel, pose: tuple[float, float, float], slowest: float, count: int) -> list[Any]:
    """Configurations along random drives: of many, those that end nearest to a pose, each with another order of turns.

    Args:
        reduced: the car, with turning radius 1 at the bounds of the steering.
        pose: x, y and heading at the end.
        slowest: 0 for forward motion only, -1 for both directions.
        count: number of drives.
    """
    generator, drawn = np.random.default_rng(0), []
    for _ in range(5000):
        turns = generator.choice([LEFT, STRAIGHT, RIGHT], size=generator.integers(3, 5 if slowest < 0 else 4))
        ways = generator.choice([-1, 1], size=len(turns)) if slowest < 0 else np.ones(len(turns), int)
        lengths = ways * generator.uniform(0.1, np.where(turns == STRAIGHT, 5.0, 2.0 if slowest < 0 else 5.0))
        word = [(int(turn), float(length)) for turn, length in zip(turns, lengths, strict=True)]
        x, y, heading = drive(word)
        missed = np.hypot(x - pose[0], y - pose[1]) + 1 - np.cos(heading - pose[2])
        drawn.append((missed + 0.1 * np.abs(lengths).sum(), (*turns, *ways), word))
    kept: dict[Any, list[Any]] = {}
    for _, kind, word in sorted(drawn, key=lambda each: each[0]):
        kept.setdefault(kind, word)
    return [_configurations(reduced, word) for word in list(kept.values())[:count]]


def _configurations(reduced: rnc.ReducedModel, word: list[tuple[int, float]]) -> np.ndarray:
    """Configurations at equal distances along a drive."""
    ends = np.cumsum([0.0, *(abs(length) for _, length in word)])
    found = []
    for s in np.linspace(0.0, ends[-1], NODES + 1):
        here = max(0, int(np.searchsorted(ends, s)) - 1)
        begun = [*word[:here], (word[here][0], np.sign(word[here][1]) * (s - ends[here]))]
        steering = np.pi / 4 * word[here][0] * (s > 0)
        found.append(reduced.robot.configuration({"root_joint": drive(begun), "front_steering": steering}))
    return np.array(found)


def driven_length(plan: rnc.optimal.MotionPlan) -> float:
    """Length of the path of the car, both directions positive [m]."""
    return float(np.abs(plan.u[:, 0]).mean() * plan.duration)


def shortest(kind: str, count: int, starts: int = 12) -> None:
    """Lengths of planned paths beside closed forms, for random poses within 4 turning radii."""
    reduced, generator = car(), np.random.default_rng(0)
    slowest, exact, weights = SHORTEST[kind]
    ratios, taken = [], []
    for number in range(1, count + 1):
        x, y, heading = generator.uniform([-4.0, -4.0, -np.pi], [4.0, 4.0, np.pi]).tolist()
        begin = time.process_time()
        try:
            found = driven_length(shortest_plan(reduced, (x, y, heading), slowest, starts, weights))
        except InfeasibleError as error:
            print(f"  {number}: ({x:.2f}, {y:.2f}, {heading:.2f}): {error}", flush=True)
            found = np.inf
        taken.append(time.process_time() - begin)
        ratios.append(found / exact(x, y, heading))
        if number % 5 == 0 or number == count:
            near = np.array(ratios) < 1.01
            print(f"{kind}: {near.sum()} of {number} within 1 % of the closed form, {starts} guesses; error median "
                  f"{np.median(ratios) - 1:.2%}, largest {max(ratios) - 1:.0%}; processor time median "
                  f"{np.median(taken):.1f} s", flush=True)  # fmt: skip


def dubins() -> None:
    """Shortest paths of a car that drives forwards only."""
    shortest("dubins", _count(10))


def reeds_shepp() -> None:
    """Shortest paths of a car that drives in both directions."""
    shortest("reeds-shepp", _count(10), starts=24)


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
    "docking": docking,
    "dubins": dubins,
    "reeds-shepp": reeds_shepp,
    "predictive": predictive,
}

if __name__ == "__main__":
    for part in [sys.argv[1]] if len(sys.argv) > 1 else list(PARTS):
        PARTS[part]()
