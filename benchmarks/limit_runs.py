"""Many runs with drawn starts, goals and obstacles: limits and collisions, replayed through Pinocchio and coal.

    python -m benchmarks.limit_runs --runs 1000 --jobs 2 --out limit_runs.csv

Runs take turns among the scenarios. What is in the file already is not run again, so that the runs can be interrupted
and continued.

The replay reads only the recorded configurations, velocities and inputs, and the robot's file. Positions, velocities,
differences of positions and inputs are compared with the limits of the model, differences of velocities with those of
the controller. coal tests the original shapes for
contact, meshes included, and the distance of their hulls. A run succeeds if it ends within 0.02 m or rad of its goals.
A goal that preflight says is missed is reported as infeasible.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import coal
import joblib
import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table

from benchmarks.drawn_scenes import DRAWS, FILES, GOALS, drawn_options
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.control.controller import LimitedAcceleration, limited_accelerations
from rnc_pin.control.whole_body.limits import CollisionAvoidance
from rnc_pin.errors import InfeasibleError, RncError
from rnc_pin.robots.joint_values import NO_LIMIT
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import Trajectory

TOLERANCE = 1e-6  # excess over a limit as a share of its range
SHORTFALL = 1e-4  # [m] of a clearance, as verdicts of runs count
REACHED = 0.02  # [m, rad]
NEAR = 0.1  # [m]; distance up to which distances of hulls are exact
TOUCHING = 1e-3  # [m] between hulls, below which the original shapes are tested


class Row(NamedTuple):
    """Result of one run. Excesses are shares of the range of a limit; negative while the limit is kept."""

    scenario: str
    run: int
    outcome: str
    reported: str
    """Complaint of preflight, distances that gave way, goals that the run missed; empty if there are none."""
    error: float
    """Largest error of a goal at the end [m, rad]."""
    position: float
    velocity: float
    effort: float
    acceleration: float
    """Of the limits of the controller, which are shares of the limit."""
    distance: float
    """Smallest distance of the hulls of any checked pair [m]; at most ``NEAR``."""
    contacts: str
    """Pairs of original shapes that touch."""
    shortfall: float
    """Largest shortfall of the controller's clearance from obstacles [m]; negative while it is kept."""
    succeeded: bool
    """Verdict of the run."""
    braked: int
    """Samples that executed a verified braking motion."""
    unverified: int
    """Samples without a verified braking motion."""
    cpu_time: float
    """[s]; of drawing, building, running and replaying."""

    @property
    def violated(self) -> bool:
        """True if a limit of position, velocity, effort or acceleration was exceeded, or a clearance not kept."""
        used = max(self.position, self.velocity, self.effort, self.acceleration)
        return used > TOLERANCE or self.shortfall > SHORTFALL

    @property
    def collided(self) -> bool:
        """True if two bodies touched."""
        return bool(self.contacts) or self.distance < 0


def one(scenario: str, run: int) -> Row:
    """Run a scenario with drawn options, and replay it."""
    start = time.process_time()
    try:
        prepared = Scenario.load(FILES.get(scenario, scenario), drawn_options(scenario, run)).build()
    except InfeasibleError as error:
        return _not_run(scenario, run, "refused", str(error), time.process_time() - start)
    experiment = prepared.experiment
    try:
        result = execute(prepared)
    except RncError as error:
        return _not_run(scenario, run, str(error), "", time.process_time() - start)
    trajectory, robot = result.trajectory, experiment.reduced.robot
    excesses = joint_excesses(robot, trajectory, experiment.simulation.dt)
    accelerations = acceleration_excess(trajectory, limited_accelerations(experiment.controller))
    distance, contacts = replayed_contacts(robot, trajectory, experiment.obstacles)
    program, used = experiment.program, trajectory.info.braking
    kept = [each.clearance for each in program.limits if isinstance(each, CollisionAvoidance) and each.obstacles]
    error = max((result.summary["final_error"].get(name, np.inf) for name in GOALS[scenario]), default=np.inf)
    outcome = str(trajectory.outcome) if result.error is None else str(result.error)
    gave_way = [f"{name} gave way" for name in result.summary.get("limits_gave_way", ()) if name.endswith(" distance")]
    missed = [f"{name} was not reached" for name in result.summary.get("goals_missed", ())]
    reported = "; ".join([*experiment.warnings, *gave_way, *missed])
    shortfall = max(kept) - distance_to(robot, trajectory, experiment.obstacles) if kept else -1.0
    verdict, counts = trajectory.verdict, (0, 0) if used is None else (used.samples, used.unverified)
    numbers = *excesses, accelerations, distance
    found = contacts, shortfall, verdict is not None and verdict.succeeded, *counts
    return Row(scenario, run, outcome, reported, float(error), *numbers, *found, time.process_time() - start)


def _not_run(scenario: str, run: int, outcome: str, reported: str, seconds: float) -> Row:
    return Row(scenario, run, outcome, reported, np.inf, -1.0, -1.0, -1.0, -1.0, NEAR, "", -1.0, False, 0, 0, seconds)


def acceleration_excess(run: Trajectory, limits: Sequence[LimitedAcceleration]) -> float:
    """Largest excess of the change of a velocity from sample to sample, over the time; -1 without such limits."""
    found = [-1.0]
    for name, quantity, column, lower, upper, *_ in limits:
        assert lower == -upper, name
        rates = np.diff(getattr(run, quantity)[:, column]) / np.diff(run.time)
        found.append(float(np.abs(rates).max(initial=0.0) / upper - 1.0))
    return max(found)


def distance_to(robot: Robot, run: Trajectory, obstacles: Sequence[Obstacle]) -> float:
    """Smallest distance from obstacles at every sample [m]; at most 1 m."""
    checked = CollisionDistances(robot, obstacles, PairSelection(links=False))
    return min(
        float(checked.smallest(q, t, 1.0).min(initial=1.0)) for t, q in zip(run.time.tolist(), run.q, strict=True)
    )


def joint_excesses(robot: Robot, run: Trajectory, dt: float) -> tuple[float, float, float]:
    """Largest excess over limits of position, velocity and effort; -1 without such limits.

    The mean velocity between two samples is a difference of positions, which has the same limit.
    """
    model, excesses = robot.model, {"position": [-1.0], "velocity": [-1.0], "effort": [-1.0]}
    means = np.array([pin.difference(model, q, after) / dt for q, after in zip(run.q[:-1], run.q[1:], strict=True)])
    driven = {name: column for column, name in enumerate(run.info.outputs.T)}
    for name, joint in zip(robot.joint_names, list(model.joints)[1:], strict=True):
        if joint.nv != 1:
            continue
        v, q = joint.idx_v, joint.idx_q
        low, high = model.lowerPositionLimit[q], model.upperPositionLimit[q]
        if joint.nq == 1 and -NO_LIMIT < low < high < NO_LIMIT:
            beyond = np.maximum(run.q[:, q] - high, low - run.q[:, q]).max()
            excesses["position"].append(float(beyond / (high - low)))
        fastest, strongest = model.upperVelocityLimit[v], model.upperEffortLimit[v]
        if 0 < fastest < NO_LIMIT:
            used = max(np.abs(run.v[:, v]).max(), np.abs(means[:, v]).max(initial=0.0))
            excesses["velocity"].append(float(used / fastest - 1.0))
        if name in driven and 0 < strongest < NO_LIMIT:
            used = np.nanmax(np.abs(run.T[:, driven[name]]), initial=0.0)
            excesses["effort"].append(float(used / strongest - 1.0))
    position, velocity, effort = (max(each) for each in excesses.values())
    return position, velocity, effort


def replayed_contacts(robot: Robot, run: Trajectory, obstacles: Sequence[Obstacle]) -> tuple[float, str]:
    """Smallest distance of hulls [m] at every sample, and the pairs of original shapes that touch.

    A hull contains its mesh: where hulls are apart, the original shapes do not touch. Pairs whose hulls overlap at the
    start are not checked, as in ``CollisionDistances``.
    """
    hulls, least, touching = CollisionDistances(robot, obstacles, q0=run.q[0]), NEAR, set[str]()
    geometry, data = robot.collision_model.copy(), robot.model.createData()
    links = len(geometry.geometryObjects)
    for obstacle in obstacles:
        geometry.addGeometryObject(pin.GeometryObject(obstacle.name, 0, obstacle.placement(0.0), obstacle.shape))
    shapes, placed, request = geometry.geometryObjects, geometry.createData(), coal.CollisionRequest()
    for t, q in zip(run.time.tolist(), run.q, strict=True):
        apart = hulls.smallest(q, t, NEAR)
        least = min(least, float(apart.min(initial=NEAR)))
        near = np.flatnonzero(apart < TOUCHING)
        if not len(near):
            continue
        for k, obstacle in enumerate(obstacles):
            shapes[links + k].placement = obstacle.placement(t)
        pin.updateGeometryPlacements(robot.model, data, geometry, placed, q)
        for pair in (hulls.pairs[k] for k in near.tolist()):
            sides = [
                (shapes[k].geometry, coal.Transform3s(placed.oMg[k].rotation, placed.oMg[k].translation))
                for k in (pair.first, pair.second)
            ]
            result = coal.CollisionResult()
            coal.collide(*sides[0], *sides[1], request, result)
            if result.isCollision():
                touching.add(pair.label)
    return least, "; ".join(sorted(touching))


class KeptRows:
    """Rows in a file, by scenario and run."""

    def __init__(self, path: Path | None) -> None:
        self.rows: dict[tuple[str, int], Row] = {}
        self._path = path
        if path is not None and path.exists():
            with path.open(newline="") as file:
                for cells in csv.reader(file):
                    numbers, counts = [float(each) for each in cells[4:10]], (int(cells[13]), int(cells[14]))
                    found = cells[10], float(cells[11]), cells[12] == "True", *counts, float(cells[15])
                    row = Row(cells[0], int(cells[1]), cells[2], cells[3], *numbers, *found)
                    self.rows[row[:2]] = row

    def add(self, row: Row) -> None:
        """Keep a row, and append it to the file."""
        self.rows[row[:2]] = row
        if self._path is not None:
            with self._path.open("a", newline="") as file:
                csv.writer(file).writerow(row)


def cells_of(scenario: str, rows: Sequence[Row]) -> list[str]:
    """Line of the table for the runs of a scenario."""
    reached = [row for row in rows if row.outcome == "completed" and row.error < REACHED]
    told = [row for row in rows if row.reported and row not in reached]

    def worst(name: str) -> str:
        value = max((getattr(row, name) for row in rows), default=-1.0)
        return "-" if value <= -1.0 else f"{100 * value:+.2g} %"

    return [
        scenario,
        str(len(rows)),
        str(len(reached)),
        str(len(told)),
        str(len(rows) - len(reached) - len(told)),
        str(sum(row.succeeded for row in rows)),
        str(sum(row.violated and row.succeeded for row in rows)),
        str(sum(row.violated for row in rows)),
        *(worst(name) for name in ("position", "velocity", "effort", "acceleration")),
        str(sum(row.collided for row in rows)),
        f"{1e3 * min((row.distance for row in rows), default=NEAR):.1f} mm",
        str(sum(row.braked > 0 for row in rows)),
        str(sum(row.unverified > 0 for row in rows)),
    ]


def main() -> int:
    """Run what is missing and print the table; the exit status is 1 if a run that succeeded violated or touched."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1000, help="of all scenarios together")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, help="CSV file that rows are added to")
    parser.add_argument("--scenarios", nargs="*", choices=list(DRAWS), default=list(DRAWS))
    parser.add_argument("--minutes", type=float, default=np.inf, help="no run starts later than this")
    given = parser.parse_args()
    kept, names, last = KeptRows(given.out), given.scenarios, time.monotonic() + 60 * given.minutes
    keys = [(names[k % len(names)], k // len(names)) for k in range(given.runs)]

    def calls() -> Iterator[object]:
        for key in keys:
            if key not in kept.rows and time.monotonic() < last:
                yield joblib.delayed(one)(*key)

    for row in joblib.Parallel(given.jobs, return_as="generator_unordered", pre_dispatch="n_jobs")(calls()):
        kept.add(row)
        print(*row[:10], row.contacts, *row[11:15], f"{row.cpu_time:.1f} s", file=sys.stderr, flush=True)
    table = Table(
        "scenario", "runs", "at the goal", "infeasible, reported", "missed", "succeeded", "violations of these",
        "violations", "position", "velocity", "effort", "acceleration", "collisions", "nearest", "braked", "unverified",
    )  # fmt: skip
    for name in names:
        table.add_row(*cells_of(name, [kept.rows[key] for key in keys if key[0] == name and key in kept.rows]))
    Console(width=240).print(table)
    return int(any(row.succeeded and (row.violated or row.collided) for row in kept.rows.values()))


if __name__ == "__main__":
    sys.exit(main())
