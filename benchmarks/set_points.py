"""Set points: shares of random starts from which controllers arrive and stay, and what the verdicts say of the others.

``python -m benchmarks.set_points TASK [N] [SYSTEM ...] [--control plan|predictive|quadratic] [--jobs K] [--out FILE]``

With a file, each draw is written as it ends, and draws that the file has are not run again: a stopped run continues.

Tasks:

* ``starts``: drawn with a seed, within 3 m of the goal with any heading, joints within 0.3 rad of their goals. A run
  arrives if it ends at rest within 1 cm and 0.01 rad.
* ``noise``: the same with noise of 3.5 mm and 0.2 degrees, measurements one sample late, and masses 20 % wrong; within
  2 cm and 0.02 rad.
* ``obstacles``: the same as ``starts`` with three posts near the way, between which the robot fits. A run that touches
  one has not arrived.
* ``aside``: starts 10 cm, 1 cm and 1 mm (or rad) away in the direction that takes the most brackets. A run arrives
  within a tenth of that.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np

import rnc_pin as rnc
from benchmarks.planned_models import car, knife_edge, mobile_manipulator, tractor
from rnc_pin.lab.faults import FaultyPlant
from rnc_pin.motion.optimal import (
    BoundKind,
    DistanceBound,
    EffortCost,
    InputBound,
    OutputBound,
    OutputCost,
    PredictiveController,
    SetPoint,
    SetPointController,
    SetPointCost,
    VelocityBound,
    VelocityCost,
)
from rnc_pin.motion.planning.action_models import StateManifold

DT, WRONG = 0.05, 1.2
NOISE = np.radians(0.2)  # standard deviation [rad or m], and of velocities [rad/s or m/s]
AT_REST = 0.02  # [m/s or rad/s], mean over a second: noise moves a robot at rest by 0.0075 rms
STEERING, HITCH = 0.7, 1.2  # largest angles [rad]
POSTS, FREE, CLEARANCE = 3, 0.5, 0.05  # number of posts; their distance from start and goal, and of plans [m]


@dataclass(frozen=True)
class Case:
    """System with its goal.

    Attributes:
        build: makes the model.
        frame: its frame that goes to the origin with heading zero; None without one.
        joints: goals of joints.
        spread: of the first joint of a system without such a frame [rad].
        limits: largest angles of joints [rad].
        duration: of a plan [s].
        run: duration of a run [s].
        gap: between posts [m].
    """

    build: Callable[[], rnc.ReducedModel]
    frame: str | None
    joints: dict[str, float]
    spread: float = 0.3
    limits: dict[str, float] = field(default_factory=dict)
    duration: float = 10.0
    run: float = 30.0
    gap: float = 1.5

    def goal(self) -> dict[object, object]:
        """Goal by outputs."""
        joints = {rnc.JointPosition(name): value for name, value in self.joints.items()}
        if self.frame is None:
            return dict(joints)
        return {rnc.FramePosition(self.frame, "xy"): [0.0, 0.0], rnc.FrameYaw(self.frame): 0.0, **joints}

    def bounds(self) -> list[BoundKind]:
        """Accelerations, speeds and angles."""
        angles = [OutputBound(rnc.JointPosition(name), -limit, limit) for name, limit in self.limits.items()]
        return [InputBound(-2.0, 2.0), VelocityBound(-1.0, 1.0), *angles]

    def start(self, reduced: rnc.ReducedModel, seed: int) -> np.ndarray:
        """Drawn start (nq,)."""
        draw = np.random.default_rng(seed)
        place, angle, heading = 3.0 * np.sqrt(draw.uniform()), *draw.uniform(-np.pi, np.pi, 2)
        joints: dict[str, object] = {}
        for name, value in self.joints.items():
            joints[name] = value + draw.uniform(-self.spread, self.spread)
        if self.frame is not None:
            joints["root_joint"] = [place * np.cos(angle), place * np.sin(angle), heading]
        return np.array(reduced.robot.configuration(joints))


def edge() -> rnc.ReducedModel:
    return knife_edge([rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")])


def drive() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
    system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
    return system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base")])


def floating_arm() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    joints = ["joint_1", "joint_2", "joint_3"]
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], joints)
    return system.reduce([rnc.JointPosition(joint) for joint in joints])


def mecanum() -> rnc.ReducedModel:
    return rnc.Scenario.load("mecanum-crowd").reduced


_FRONT = {"front_steering": 0.0}
_STEERING = {"front_steering": STEERING}
_ONE = {"hitch_1": HITCH, **_STEERING}
_TWO = {"hitch_2": HITCH, **_ONE}
_LONG = {"duration": 20.0, "run": 60.0, "gap": 2.0}
_LONGER = {"duration": 30.0, "run": 90.0, "gap": 2.0}
_ARM = {"joint_1": 0.4, "joint_2": 0.8}
CASES = {
    "edge": Case(edge, "sleigh", {}),
    "drive": Case(drive, "base", {}),
    "car": Case(car, "rear_axle", _FRONT, limits=_STEERING),
    "tricycle": Case(partial(car, "front_axle"), "rear_axle", _FRONT, limits=_STEERING),
    "trailer": Case(partial(tractor, 1), "tractor", dict.fromkeys(_ONE, 0.0), limits=_ONE, **_LONG),
    "trailers": Case(partial(tractor, 2), "tractor", dict.fromkeys(_TWO, 0.0), limits=_TWO, **_LONGER),
    "mecanum": Case(mecanum, "base_link", {}),
    "mobile_manipulator": Case(mobile_manipulator, "base", _ARM),
    "floating_arm": Case(floating_arm, None, {"platform": 0.0, **_ARM, "joint_3": 0.5}),
}


class Result(NamedTuple):
    """Result of one run."""

    arrived: bool
    succeeded: bool
    error: float
    taken: float
    """Processor time of the run [s]."""


class Setting(NamedTuple):
    """Controller, and what makes its task harder."""

    control: str = "plan"
    noise: bool = False
    obstacles: bool = False
    aside: float | None = None

    @property
    def allowed(self) -> float:
        """Error within which a run arrives [m or rad]."""
        if self.aside is not None:
            return 0.1 * self.aside
        return 0.02 if self.noise else 0.01


def posts(case: Case, reduced: rnc.ReducedModel, start: np.ndarray, seed: int) -> rnc.collision.CollisionDistances:
    """Distances from posts drawn near the line to the goal, away from the start, from the goal and from each other.

    Raises:
        ValueError: there is no room for them.
    """
    draw, goal = np.random.default_rng([seed, 1]), SetPoint(reduced, case.goal()).q
    found: list[rnc.collision.Obstacle] = []
    for _ in range(2000):
        place, radius = draw.uniform() * start[:2] + draw.normal(size=2), draw.uniform(0.1, 0.3)
        near = min((float(np.linalg.norm(place - other.position[:2])) for other in found), default=np.inf)
        post = rnc.collision.Obstacle(coal.Cylinder(radius, 3.0), (*place, 0.5), name=f"post_{len(found) + 1}")
        alone = rnc.collision.CollisionDistances(reduced.robot, [post], rnc.collision.PairSelection(links=False))
        free = min(alone.at(q, within=2 * FREE).distance.min(initial=np.inf) for q in (start, goal))
        if near < case.gap + 0.6 or free < FREE:
            continue
        found.append(post)
        if len(found) == POSTS:
            return rnc.collision.CollisionDistances(reduced.robot, found, rnc.collision.PairSelection(links=False))
    raise ValueError(f"seed {seed}: no room for {POSTS} posts")


def controller_of(
    setting: Setting, case: Case, reduced: rnc.ReducedModel, bounds: Sequence[BoundKind]
) -> rnc.control.Controller:
    """Controller of a setting."""
    goal = case.goal()
    if setting.control == "plan":
        tolerance = 0.4 * setting.allowed
        options = {"form": "acceleration", "bounds": bounds, "limits": None, "tolerance": tolerance}
        return SetPointController(reduced, goal, case.duration, **options)
    costs = [SetPointCost(goal, weight=10.0, velocity_weight=0.1), EffortCost(0.01)]
    if setting.control == "quadratic":
        squares = [OutputCost(output, value, weight=10.0, phase="both") for output, value in goal.items()]
        costs = [*squares, VelocityCost(0.1, phase="both"), EffortCost(0.01)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rnc.ModelWarning)
        return PredictiveController(reduced, costs, 4.0, form="acceleration", bounds=bounds)


def displaced(point: SetPoint, aside: float) -> np.ndarray:
    """Configuration (nq,) beside a set point, along the coordinate of the largest weight."""
    linear = point.coordinates.linear
    direction = np.linalg.pinv(linear)[:, int(np.argmax(point.coordinates.weights))]
    manifold = StateManifold(point.reduced.robot.model)
    return np.array(manifold.integrate(point.q[None], aside * direction[None] / np.abs(direction).max())[0])


def faulty_plant(case: Case, seed: int) -> FaultyPlant:
    """Plant with wrong masses and noisy, late measurements."""
    wrong = case.build()
    for body in wrong.robot.model.inertias:
        body.mass *= WRONG
        body.inertia *= WRONG
    faults = rnc.Faults(position_noise=NOISE, velocity_noise=NOISE, delay=1)
    return FaultyPlant(rnc.ReducedPlant(wrong), faults, wrong, seed=seed)


def run(name: str, setting: Setting, seed: int) -> Result:
    """One run of a system from a drawn start."""
    case = CASES[name]
    reduced = case.build()
    point = SetPoint(reduced, case.goal())
    start = case.start(reduced, seed) if setting.aside is None else displaced(point, setting.aside)
    bounds, distances = case.bounds(), posts(case, reduced, start, seed) if setting.obstacles else None
    if distances is not None:
        bounds.append(DistanceBound(distances, CLEARANCE))
    plant = faulty_plant(case, seed) if setting.noise else None
    begin = time.process_time()
    controller = controller_of(setting, case, reduced, bounds)
    try:
        found = rnc.simulate(reduced, controller, start, case.run, DT, plant=plant)
    except rnc.RncError:  # the run diverged, or met a singular configuration: its error names it
        return Result(False, False, np.inf, time.process_time() - begin)
    taken = time.process_time() - begin
    error = max(point.errors(found.q[-1]).values())
    still = float(np.abs(found.v2[-round(1.0 / DT) :].mean(axis=0)).max()) < AT_REST
    arrived = found.outcome == "completed" and still and error < setting.allowed
    touched = distances is not None and any(distances.at(q, within=0.1).distance.min(initial=1.0) < 0 for q in found.q)
    return Result(arrived and not touched, found.verdict.succeeded, error, taken)


def row(name: str, results: Sequence[Result]) -> str:
    """Line of the table."""
    count = len(results)
    arrived = sum(each.arrived for each in results)
    false = sum(each.succeeded and not each.arrived for each in results)
    errors, times = ([getattr(each, key) for each in results] for key in ("error", "taken"))
    return (
        f"| {name} | {arrived} of {count} | {count - arrived - false} | {false} | {np.median(errors):.2g} | "
        f"{np.max(errors):.2g} | {np.median(times):.2g} |"
    )


def settings_of(task: str, control: str) -> dict[str, Setting]:
    """Settings of a task by what their rows add to the name of the system."""
    if task == "aside":
        return {f", {aside:g} aside": Setting(control, aside=aside) for aside in (0.1, 0.01, 0.001)}
    return {"": Setting(control, noise=task == "noise", obstacles=task == "obstacles")}


def drawn_before(file: Path | None, key: Sequence[str]) -> dict[int, Result]:
    """Results by seed that a file has of a task, a controller and a system."""
    lines = file.read_text(encoding="utf-8").splitlines() if file is not None and file.is_file() else []
    found = {}
    for *own, seed, arrived, succeeded, error, taken in map(json.loads, lines):
        if own == [*key]:
            found[int(seed)] = Result(bool(arrived), bool(succeeded), error, taken)
    return found


def main() -> None:
    """Print a row for each system."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("task", choices=("starts", "noise", "obstacles", "aside"))
    parser.add_argument("count", type=int, nargs="?", default=100)
    parser.add_argument("systems", nargs="*", choices=[*CASES, []], default=[])
    parser.add_argument("--control", choices=("plan", "predictive", "quadratic"), default="plan")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    print("| system | arrived | missed, named by the verdict | called succeeded | median error | largest | time [s] |")
    print("|---|---|---|---|---|---|---|")
    rows = settings_of(chosen.task, chosen.control).items()
    count = 1 if chosen.task == "aside" else chosen.count
    for name, (text, setting) in product(chosen.systems or CASES, rows):
        one = partial(run, name, setting)
        known = drawn_before(chosen.out, key := [chosen.task, chosen.control, name + text])
        missing = [seed for seed in range(count) if seed not in known]
        with ProcessPoolExecutor(chosen.jobs) as pool:
            found = map(one, missing) if chosen.jobs == 1 else pool.map(one, missing)
            for seed, result in zip(missing, found, strict=True):
                known[seed] = result
                if chosen.out is not None:
                    with chosen.out.open("a", encoding="utf-8") as file:
                        file.write(json.dumps([*key, seed, *map(float, result)]) + "\n")
        print(row(name + text, [known[seed] for seed in range(count)]), flush=True)


if __name__ == "__main__":
    main()
