"""Verdicts of runs beside an independent replay, as a confusion matrix.

Drawn runs are those of three built-in scenarios with drawn durations, boxes near their paths, tighter limits of joints,
stuck joints, and stated friction. Half of the space robots have a whole-body program with limits of acceleration, and
other masses than its model. The oracle interpolates the recorded configurations at 1 ms with Pinocchio and measures
each pair with coal. It reads limits, accelerations and goals from the arrays. The friction that a unicycle needs is the
rate of its momentum by Pinocchio. Built-in scenarios are judged as they are.

``python -m benchmarks.verdicts cost`` prints the processor time of each verdict of a built-in scenario beside that of
its run.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

import coal
import joblib
import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.simulated_run import judged_summary, run_summary
from rnc_pin.collision import CollisionDistances, Obstacle
from rnc_pin.motion.whole_body.limits import CollisionAvoidance
from rnc_pin.simulation import Trajectory
from rnc_pin.verdict import FindingKind

KINDS = (
    FindingKind.POSITION, FindingKind.VELOCITY, FindingKind.EFFORT, FindingKind.ACCELERATION, FindingKind.SLIP,
    FindingKind.COLLISION, FindingKind.CLEARANCE, FindingKind.GOAL,
)  # fmt: skip
STEP = 1e-3  # of the replay [s]
UNDECIDED = 1e-3  # depth or shortfall of a distance that may be judged either way [m]
ROUNDING = 1e-9
SOLVED = 1e-5  # excess over an active limit that is the accuracy of a program, as a share of it
CLOSE = 0.02  # share of a limit of acceleration or friction within which a run may be judged either way
DRAWN = ("space-robot", "mobile-manipulator", "unicycle")
SHORT = {"comparisons": {}, "plots": {}, "preflight": "warn"}


class Case(NamedTuple):
    """Truth and judgement of a kind of finding; None where the truth is within the tolerance of the judgement."""

    true: bool | None
    found: bool


# ---------------------------------------------------------------------- the oracle


def dense(run: Trajectory, model: pin.Model, step: float) -> Iterator[tuple[float, np.ndarray]]:
    """Times and configurations of a run, interpolated between its samples."""
    for k in range(len(run.time) - 1):
        count = max(1, round((run.time[k + 1] - run.time[k]) / step))
        for part in range(count):
            share = part / count
            t = (1 - share) * run.time[k] + share * run.time[k + 1]
            yield float(t), pin.interpolate(model, run.q[k], run.q[k + 1], share)
    yield float(run.time[-1]), run.q[-1]


def smallest_distances(
    robot: rnc.Robot, obstacles: tuple[Obstacle, ...], run: Trajectory, step: float
) -> Mapping[bool, float]:
    """Smallest distance of links from obstacles (True) and from each other (False), by coal at dense times [m].

    Only the list of pairs is that of the package: those that touch at the start are left out by design.
    """
    pairs = CollisionDistances(robot, obstacles, q0=run.q[0])
    links = len(pairs.shapes) - len(obstacles)
    model, data = robot.model, robot.model.createData()
    objects = robot.collision_model.geometryObjects
    for shape in pairs.shapes:
        shape.computeLocalAABB()
    radii = [float(np.linalg.norm(shape.aabb_radius)) for shape in pairs.shapes]
    centers = [np.array(shape.aabb_center) for shape in pairs.shapes]
    smallest = {True: np.inf, False: np.inf}
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    for t, q in dense(run, model, step):
        pin.forwardKinematics(model, data, q)
        poses = [data.oMi[objects[k].parentJoint] * objects[k].placement for k in range(links)]
        poses += [each.placement(t) for each in obstacles]
        middles = [pose.act(center) for pose, center in zip(poses, centers, strict=True)]
        for first, second, _ in pairs.pairs:
            obstacle = second >= links
            apart = float(np.linalg.norm(middles[first] - middles[second])) - radii[first] - radii[second]
            if apart < min(smallest[obstacle], 1.0):
                one, other = (coal.Transform3s(poses[k].rotation, poses[k].translation) for k in (first, second))
                result.clear()
                found = coal.distance(pairs.shapes[first], one, pairs.shapes[second], other, request, result)
                smallest[obstacle] = min(smallest[obstacle], found)
    return smallest


def exceeds(run: Trajectory, robot: rnc.Robot) -> dict[FindingKind, bool]:
    """True for kinds of limits that the arrays of a run exceed."""
    model = robot.model
    scalar = [joint for joint in list(model.joints)[1:] if joint.nq == joint.nv == 1]
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    beyond = [
        max((run.q[:, j.idx_q] - high[j.idx_q]).max(), (low[j.idx_q] - run.q[:, j.idx_q]).max())
        > ROUNDING * (high[j.idx_q] - low[j.idx_q])
        for j in scalar
        if -1e6 < low[j.idx_q] < high[j.idx_q] < 1e6
    ]
    fastest = np.abs(run.v).max(axis=0)
    limits = model.upperVelocityLimit
    speeds = [fastest[k] > limits[k] * (1 + ROUNDING) for k in range(model.nv) if 0 < limits[k] < 1e6]
    efforts = []
    for column, name in enumerate(run.info.outputs.T.names):
        if name in robot.joint_names:
            limit = float(model.upperEffortLimit[robot.velocity_indices(name).start])
            if 0 < limit < 1e6:
                efforts.append(np.abs(run.T[:, column]).max() > limit * (1 + ROUNDING))
    found = {FindingKind.POSITION: beyond, FindingKind.VELOCITY: speeds, FindingKind.EFFORT: efforts}
    return {kind: any(each) for kind, each in found.items()}


def acceleration(made: Scenario, run: Trajectory) -> bool | None:
    """True if a joint of a whole-body program accelerates more than its limit; None if it nearly does."""
    limits = getattr(made.experiment.scenario.controller, "limits", None)
    limit = None if limits is None else limits.acceleration
    if limit is None:
        return False
    columns = [made.experiment.reduced.robot.velocity_indices(name).start for name in limit.joints]
    largest = max(abs(float(b - a)) / float(t) for t, a, b in changes(run, columns)) / limit.limit
    return None if 1.0 + SOLVED < largest < 1.0 + CLOSE else largest > 1.0 + SOLVED


def changes(run: Trajectory, columns: list[int]) -> Iterator[tuple[float, float, float]]:
    """Time between two samples [s], and a velocity at both."""
    for k, t in enumerate(np.diff(run.time)):
        for column in columns:
            yield t, run.v[k, column], run.v[k + 1, column]


def slip(made: Scenario, run: Trajectory) -> bool | None:
    """True if the one wheel of a unicycle needs more than the stated friction; None if it nearly does.

    Along the ground the wheel alone pushes the robot: its force is the rate of the momentum, its load is the weight.
    A joint that locks stops the robot at once, which no finite force does: such a run is not decided.
    """
    stated, faults, reduced = made.experiment.scenario.grip, made.experiment.scenario.faults, made.experiment.reduced
    if stated is None:
        return False
    if faults is not None and faults.stuck is not None:
        return None
    model, data = reduced.robot.model, reduced.robot.model.createData()
    available = stated.friction * pin.computeTotalMass(model) * 9.81
    needed = 0.0
    for k, t in enumerate(np.diff(run.time)):
        pin.computeCentroidalMomentumTimeVariation(model, data, run.q[k], run.v[k], (run.v[k + 1] - run.v[k]) / t)
        needed = max(needed, float(np.linalg.norm(data.dhg.linear[:2])) / available)
    return None if abs(needed - 1.0) < CLOSE else needed > 1.0


def truths(made: Scenario, run: Trajectory, step: float) -> dict[FindingKind, bool | None]:
    """Truth of each kind except goals; None where it is within the tolerance."""
    robot, obstacles = made.experiment.reduced.robot, made.experiment.obstacles
    true: dict[FindingKind, bool | None] = dict(exceeds(run, robot))
    true |= {FindingKind.ACCELERATION: acceleration(made, run), FindingKind.SLIP: slip(made, run)}
    geometry = robot.collision_model
    smallest = smallest_distances(robot, obstacles, run, step) if geometry and len(geometry.geometryObjects) else {}
    nearest = min(smallest.values(), default=np.inf)
    true[FindingKind.COLLISION] = None if -UNDECIDED < nearest < UNDECIDED else nearest < 0
    planner, program = made.experiment.scenario.planner, made.experiment.controller
    asked, accuracy = (None, 1e-4) if planner is None else (planner.clearance, planner.accuracy)
    for each in getattr(program, "limits", ()):
        asked = each.clearance if isinstance(each, CollisionAvoidance) else asked
    if asked is None or not obstacles or smallest[True] < UNDECIDED:
        true[FindingKind.CLEARANCE] = False if asked is None or not obstacles else None
    else:
        short = asked - accuracy - smallest[True]
        true[FindingKind.CLEARANCE] = None if abs(short) < UNDECIDED else short > 0
    return true


# ---------------------------------------------------------------------- drawn runs


def drawn_plan(number: int, seed: int) -> Scenario:
    """Run with drawn duration, obstacles, limits and faults."""
    generator = np.random.default_rng([seed, number])
    name = DRAWN[number % len(DRAWN)]
    options: dict[str, Any] = {**SHORT, "simulation.duration": float(generator.uniform(2.0, 7.0)), "seed": number}
    options |= stated_limits(name, number, seed)
    nominal = Scenario.load(name, options).build()
    robot = nominal.experiment.reduced.robot
    run = execute(nominal).trajectory
    boxes = []
    for place in range(int(generator.integers(0, 3))):
        q = run.q[generator.integers(len(run.q))]
        data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, q)
        shapes = robot.collision_model.geometryObjects
        shape = shapes[int(generator.integers(len(shapes)))]
        at = data.oMf[shape.parentFrame].translation + generator.normal(scale=0.25, size=3)
        size = generator.uniform(0.005, 0.25, 3)
        boxes.append({"box": {"name": f"box {place}", "size": size.tolist(), "position": at.tolist()}})
    options["obstacles"] = boxes
    driven = [each for each in nominal.experiment.scenario.actuators if isinstance(each, str)]
    if driven and generator.random() < 0.3:
        stuck = {"joint": str(generator.choice(driven)), "time": float(generator.uniform(0.1, 1.0))}
        options["faults"] = {**options.get("faults", {}), "stuck": stuck}
    made = Scenario.load(name, options).build()
    tighten(made.experiment.reduced.robot, run, generator)
    return made


def stated_limits(name: str, number: int, seed: int) -> dict[str, Any]:
    """Options with a drawn limit that no robot file has: accelerations of a space robot, or friction of a unicycle."""
    generator = np.random.default_rng([seed, number, 1])
    if name == "unicycle":
        return {"grip": {"friction": float(0.15 * np.exp(generator.normal()))}}
    if name != "space-robot" or number % 2 == 0:
        return {}
    near = {"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1}  # the elbow stays bent: stretched, it is singular
    goal = {name: start + float(generator.uniform(-0.8, 0.8)) for name, start in near.items()}
    limit = {"limit": float(generator.uniform(0.5, 4.0)), "joints": list(goal)}
    limits = {"acceleration": limit, "joint_position": None, "joint_velocity": None}  # they would exclude each other
    tasks = [{"posture": {"joints": goal, "gain": float(generator.uniform(1.0, 4.0))}}]
    return {
        "task": {},
        "reference": {},
        "controller": {"type": "inverse_dynamics", "tasks": tasks, "limits": limits},
        "faults": {"masses": float(generator.choice([0.0, 0.3]))},
    }


def tighten(robot: rnc.Robot, run: Trajectory, generator: np.random.Generator) -> None:
    """Draw limits of joints near what the nominal run uses, so that about half of the runs exceed one."""
    model = robot.model
    for joint in list(model.joints)[1:]:
        if joint.nv != 1 or generator.random() < 0.5:
            continue
        q, v, share = joint.idx_q, joint.idx_v, generator.uniform(0.7, 2.0, 3)
        if joint.nq == 1:
            low, high = float(run.q[:, q].min()), float(run.q[:, q].max())
            middle, half = 0.5 * (low + high), 0.5 * (high - low) + 0.05
            model.lowerPositionLimit[q] = middle - share[0] * half
            model.upperPositionLimit[q] = middle + share[0] * half
        model.upperVelocityLimit[v] = share[1] * (float(np.abs(run.v[:, v]).max()) + 0.01)
    for column, name in enumerate(run.info.outputs.T.names):
        if name in robot.joint_names and generator.random() < 0.5:
            place = robot.velocity_indices(name).start
            model.upperEffortLimit[place] = generator.uniform(0.7, 2.0) * (float(np.abs(run.T[:, column]).max()) + 0.01)


def missed(made: Scenario, run: Trajectory) -> bool:
    """True if an output ended away from its desired value."""
    tolerance = made.experiment.scenario.goal_tolerance
    errors = []
    for kind in ("x1", "x2"):
        desired = getattr(run, f"{kind}_desired")[-1]
        difference = run.coordinates(kind).difference(desired, getattr(run, kind)[-1])
        columns = run.info.outputs.of(kind).names
        errors += [abs(e) for e, name in zip(difference, columns, strict=True) if name in run.info.goals]
    return any(each > tolerance for each in errors)


def judged(made: Scenario, step: float) -> dict[FindingKind, Case]:
    """Truth and judgement of a run by kind."""
    run = execute(made).trajectory
    true = truths(made, run, step)
    whole_body = made.experiment.program is not None
    true[FindingKind.GOAL] = None if whole_body or run.outcome is not rnc.Outcome.COMPLETED else missed(made, run)
    found = {each.kind for each in run.verdict.findings if str(each.severity) == "fails"}
    return {kind: Case(true[kind], kind in found) for kind in KINDS}


def drawn_case(seed: int, number: int) -> dict[FindingKind, Case]:
    """Truth and judgement of a drawn run by kind."""
    with warnings.catch_warnings(action="ignore"), np.errstate(all="ignore"):
        return judged(drawn_plan(number, seed), STEP)


def built_in_case(name: str) -> dict[FindingKind, Case]:
    """Truth and judgement of a built-in scenario by kind; at 4 ms, because of its meshes."""
    with warnings.catch_warnings(action="ignore"), np.errstate(all="ignore"):
        return judged(Scenario.load(name, SHORT).build(), 4 * STEP)


def cost(name: str, repeats: int = 3) -> str:
    """Row of a table: processor times of the run and of its verdict [s], and their ratio. Hulls of meshes exist."""
    with warnings.catch_warnings(action="ignore"), np.errstate(all="ignore"):
        made = Scenario.load(name, SHORT).build()
        execute(made)
        start = time.process_time()
        run = execute(made).trajectory
        whole = time.process_time() - start
        times = []
        for _ in range(repeats):
            start = time.process_time()
            run_summary(made.experiment, run)
            middle = time.process_time()
            judged_summary(made.experiment, run)
            times.append((time.process_time() - middle) - (middle - start))
    spent, verdict = whole - min(times), min(times)
    return f"| `{name}` | {spent:.2f} | {verdict:.3f} | {100 * verdict / spent:.1f} % |"


def matrix(cases: list[dict[FindingKind, Case]]) -> str:
    """Confusion matrix as rows of a table."""
    lines = ["| finding | true and found | missed | invented | neither | within the tolerance |", f"|{'---|' * 6}"]
    for kind in KINDS:
        counts = Counter((case[kind].true, case[kind].found) for case in cases)
        undecided = counts[None, True] + counts[None, False]
        row = (counts[True, True], counts[True, False], counts[False, True], counts[False, False], undecided)
        lines.append(f"| {kind} | {' | '.join(map(str, row))} |")
    return "\n".join(lines)


def main() -> None:
    """Print both matrices, or the cost of verdicts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="?", choices=("matrices", "cost"), default="matrices")
    parser.add_argument("--runs", type=int, default=200, help="drawn runs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    if given.what == "cost":
        print("| scenario | run [s] | verdict [s] | share |\n|---|---|---|---|")
        for name in built_in_names():
            print(cost(name), flush=True)
        return
    start = time.perf_counter()
    pool = joblib.Parallel(n_jobs=given.jobs)
    cases = pool(joblib.delayed(partial(drawn_case, given.seed))(number) for number in range(given.runs))
    print(f"{given.runs} drawn runs, seed {given.seed}\n\n{matrix(cases)}\n", flush=True)
    names = built_in_names()
    cases = pool(joblib.delayed(built_in_case)(name) for name in names)
    print(f"{len(names)} built-in scenarios\n\n{matrix(cases)}\n")
    for name, case in zip(names, cases, strict=True):
        wrong = [str(kind) for kind in KINDS if case[kind].true is not None and case[kind].true != case[kind].found]
        if wrong:
            print(f"{name}: {', '.join(wrong)}")
    print(f"{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
