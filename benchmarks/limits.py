"""Limits and collisions of runs: replay through Pinocchio and coal.

    python -m benchmarks.limits                    all built-in scenarios
    python -m benchmarks.limits tiago runs/mine    scenarios by name or file, and folders of runs

Limits of position, velocity and effort are those of the robot's file. Meshes count as their convex hulls. Then come the
smallest distances to obstacles, and between links whose distance changes. The last
column lists overlaps at the start, which cannot be told from links that touch by design.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import joblib
from rich.console import Console
from rich.table import Table

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.saved_run import load_run
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.collision import Obstacle
from rnc_pin.errors import RncError
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import LimitReplay, Trajectory, replay_limits


def replayed(source: str, comparisons: bool = False) -> list[tuple[str, LimitReplay]]:
    """Replay of a run in a folder, or of a scenario that is run first, with its comparisons if they are asked for."""
    runs: dict[str, tuple[Robot, Trajectory]] = {}
    obstacles: Sequence[Obstacle] = ()
    if Path(source, "trajectory.npz").is_file():
        loaded = load_run(Path(source))
        runs[source] = loaded.reduced.robot, loaded.trajectory
    else:
        planned = Scenario.load(source, None if comparisons else {"comparisons": {}, "plots": {}}).build()
        result = execute(planned)
        robot, obstacles = planned.experiment.reduced.robot, planned.experiment.obstacles
        runs[source] = robot, result.trajectory
        runs |= {f"{source}: {label}": (robot, each) for label, each in result.comparisons.items()}
    return [(name, replay_limits(robot, run, obstacles, step=0.01)) for name, (robot, run) in runs.items()]


def described(source: str, comparisons: bool) -> list[list[str]]:
    """Rows of the table."""
    try:
        found = replayed(source, comparisons)
    except RncError as error:
        return [[source, "", "", "", f"fails: {str(error)[:80]}", "", ""]]
    rows = []
    for name, replay in found:
        cells = [name]
        for kind in ("position", "velocity", "effort"):
            worst = replay.worst(kind)
            cells.append("-" if worst is None else f"{100 * worst.excess:+.1f} % {worst.name} {worst.time:.2f} s")
        for obstacle in (True, False):
            nearest = replay.nearest(obstacle)
            cells.append(f"beyond {replay.within:g} m" if nearest is None else str(nearest))
        cells += ["; ".join(map(str, replay.omitted))]
        rows.append(cells)
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sources", nargs="*", help="scenarios, or folders of runs; all built-in scenarios by default")
    parser.add_argument("--comparisons", action="store_true", help="also the comparisons of each scenario")
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args()
    columns = ("run", "position", "velocity", "effort", "obstacles", "links", "touch at the start")
    table = Table(*columns)
    work = (
        joblib.delayed(described)(source, arguments.comparisons) for source in arguments.sources or built_in_names()
    )
    for rows in joblib.Parallel(n_jobs=arguments.jobs, return_as="generator")(work):
        for row in rows:
            table.add_row(*row)
    Console(width=200).print(table)


if __name__ == "__main__":
    main()
