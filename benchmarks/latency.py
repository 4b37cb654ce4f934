"""Latency of the control loop.

A run of each built-in scenario with a controller gives the measurements (q, v) of its ticks. ``ControlLoop.step`` then
gets them again and again, without the plant, up to N ticks (50,000 by default); each repetition starts with a new state
of the loop. Of runs with phases it is the first phase.

* median, 99 %, worst: wall time of a tick as a share of 2 ms, without the first tick of each repetition;
* own median, own 99 %, own worst: the same by the processor time of this thread, without what other processes take;
* first: the longest first tick, in which the controller makes its state;
* collections: runs of the garbage collector within ticks, for each 1,000 ticks, and their longest pause;
* kept: blocks of memory that remain allocated, for each tick.

``--markdown`` prints the rows of a Markdown table.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from rnc_pin.applications.scenario.builder import Experiment
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control.loop import ControlLoop, VelocityInputLoop
from rnc_pin.errors import RncError
from rnc_pin.plants.plant import takes_velocities
from rnc_pin.simulation.sampled_run import assembled_start

TICKS, PERIOD = 50_000, 0.002
WALL = ("median", "99 %", "worst")
COLUMNS = (*WALL, *(f"own {each}" for each in WALL), "first", "collections", "pause [us]", "kept")


class Tick(NamedTuple):
    """Measurement of one tick, the inputs that follow, and those that the plant applied."""

    time: float
    q: np.ndarray
    v: np.ndarray
    T: np.ndarray
    applied: np.ndarray


@dataclass(frozen=True)
class Latency:
    """Latency of a scenario.

    Attributes:
        scenario: its name.
        wall: wall times (N,) of ticks [s].
        processor: processor times (N,) of ticks [s].
        first: wall times (repetitions,) of first ticks [s].
        collections: runs of the garbage collector within ticks.
        pause: the longest of them [s].
        kept: blocks that remain allocated after all ticks.
    """

    scenario: str
    wall: np.ndarray
    processor: np.ndarray
    first: np.ndarray
    collections: int
    pause: float
    kept: int

    def cells(self) -> list[str]:
        """Cells of a row of the table."""
        ticks = len(self.wall)
        of_both = (np.percentile(times, (50, 99, 100)) for times in (self.wall, self.processor))
        shares = [*np.concatenate([*of_both]), self.first.max()]
        return [
            self.scenario,
            *(f"{share / PERIOD:.3f}" for share in shares),
            f"{1e3 * self.collections / ticks:.1f}",
            f"{1e6 * self.pause:.0f}",
            f"{self.kept / ticks:.3f}",
        ]


class _Collections:
    """Counter of the garbage collector's runs within ticks."""

    def __init__(self) -> None:
        self.count, self.pause, self.within, self._start = 0, 0.0, False, 0.0

    def __call__(self, phase: str, info: dict[str, int]) -> None:
        if not self.within:
            return
        if phase == "start":
            self._start = time.perf_counter()
        else:
            self.count += 1
            self.pause = max(self.pause, time.perf_counter() - self._start)


def loop_of(experiment: Experiment) -> ControlLoop:
    """Control loop of a scenario."""
    options: dict[str, Any] = {"fallback": "raise", "limits": False, **experiment.loop}
    kind = VelocityInputLoop if takes_velocities(experiment.plant) else ControlLoop
    return kind(experiment.reduced, experiment.controller, experiment.simulation.dt, **options)


def recorded(experiment: Experiment, most: int) -> list[Tick]:
    """Ticks of a run in closed loop, at most ``most``."""
    plant, dt = experiment.plant, experiment.simulation.dt
    first = experiment.phases[0] if experiment.phases else None
    duration = getattr(first, "duration", experiment.simulation.duration)
    reduced, loop = experiment.reduced, loop_of(experiment)
    start = reduced.at(assembled_start(reduced, experiment.q0), experiment.v2_0, t=0.0)
    plant.reset(start.q.copy(), start.v.copy())
    ticks = []
    for k in range(min(most, round(duration / dt))):
        q, v = plant.read()
        T = loop.step(k * dt, q, v)
        plant.apply(T)
        applied = T if takes_velocities(plant) else np.array(getattr(plant, "applied", T))
        if not takes_velocities(plant):
            loop.report_applied_input(applied)
        ticks.append(Tick(k * dt, q, v, T, applied))
        plant.advance(dt)
    return ticks


def latency(scenario: str, experiment: Experiment, run: list[Tick], ticks: int) -> Latency:
    """Measure the ticks of a run, repeated.

    Raises:
        RuntimeError: a repetition gave other inputs than the run.
    """
    loop, reports = loop_of(experiment), not takes_velocities(experiment.plant)
    wall, processor, first = np.empty(ticks), np.empty(ticks), np.empty(ticks // max(len(run) - 1, 1) + 1)
    wall.fill(0.0), processor.fill(0.0), first.fill(0.0)
    clock, own_clock, watch = time.perf_counter, time.thread_time, _Collections()
    gc.collect()
    gc.callbacks.append(watch)
    blocks = sys.getallocatedblocks()
    done = repetition = 0
    try:
        while done < ticks:
            loop.reset()
            for k, tick in enumerate(run[: ticks - done + 1]):
                watch.within = True
                own, begin = own_clock(), clock()
                T = loop.step(tick.time, tick.q, tick.v)
                end, own_end = clock(), own_clock()
                watch.within = False
                if not np.array_equal(T, tick.T):
                    raise RuntimeError(f"{scenario}: inputs at {tick.time:g} s differ from those of the run")
                if reports:
                    loop.report_applied_input(tick.applied)
                if k:
                    wall[done], processor[done] = end - begin, own_end - own
                    done += 1
                else:
                    first[repetition] = end - begin
            repetition += 1
    finally:
        gc.callbacks.remove(watch)
    gc.collect()
    kept = sys.getallocatedblocks() - blocks
    return Latency(scenario, wall, processor, first[:repetition], watch.count, watch.pause, kept)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Latency of the control loop.")
    parser.add_argument("--ticks", type=int, default=TICKS)
    parser.add_argument("--scenarios", nargs="*", default=list(built_in_names()))
    parser.add_argument("--markdown", action="store_true")
    given = parser.parse_args()
    table = Table("scenario", *COLUMNS)
    for name in given.scenarios:
        try:
            experiment = Scenario.load(name, {"comparisons": {}}).experiment
            if not experiment.reduced.p:
                continue  # nothing to control
            cells = latency(name, experiment, recorded(experiment, given.ticks + 1), given.ticks).cells()
        except RncError as error:
            cells = [name, str(error)[:60], *[""] * (len(COLUMNS) - 1)]
        table.add_row(*cells)
        if given.markdown:
            print(f"| {' | '.join(cells)} |", flush=True)
    if not given.markdown:
        Console(width=140).print(table)
    print(f"{given.ticks} ticks, load {os.getloadavg()[0]:.1f}, Python {sys.version.split()[0]}")


if __name__ == "__main__":
    main()
