"""Throughput of batches.

Runs of a scenario from starts close to its own, at once and one after the other. All is processor time of one process,
with the start of the runs; both leave forces and energies of a run to its first use or, alone, to its end. Every batch
is compared with runs alone, to the bit.
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import ComputedTorque, ReducingOutputController
from rnc_pin.planning import Hold
from rnc_pin.simulation.sampled_run import SampledRun
from rnc_pin.simulation.simulation_options import RunArguments
from rnc_pin.simulation.stop import Progress

SIZES = (1, 16, 64, 256)
DT = 0.002
SINGLES = 8  # runs alone in each round
NAMES = ("space-robot", "mobile-manipulator", "fire-truck", "mobile-manipulator-two-phase", "parallel-parking",
         "space-robot-uncertain", "computed torque", "friction", "damping")  # fmt: skip


def prepared(name: str) -> tuple[rnc.ReducedModel, Any, np.ndarray, dict[str, Any]]:
    """Model, controller and start of a scenario, and options of its plant; others are those of the manipulator."""
    experiment = Scenario.load(name if name in built_in_names() else "mobile-manipulator").experiment
    reduced, controller = experiment.reduced, experiment.controller
    options: dict[str, Any] = {}
    if name == "computed torque":
        _, x2 = reduced.at(experiment.q0).outputs()
        controller = ComputedTorque(reduced, ReducingOutputController(reduced, Hold(x2)))
    if name in ("friction", "damping"):
        joints = np.arange(reduced.n) >= reduced.n - 2
        robot = reduced.robot.model
        robot.upperDryFrictionLimit[joints], robot.damping[joints] = 0.2, 0.5
        options = {f"joint_{name}": True}
    return reduced, controller, experiment.q0, options


def starts(reduced: rnc.ReducedModel, q0: np.ndarray, count: int) -> np.ndarray:
    """Configurations (count, nq) close to one."""
    drawn = 0.01 * np.random.default_rng(0).standard_normal((count, reduced.n))
    return np.array([reduced.assembled(pin.integrate(reduced.robot.model, q0, each)) for each in drawn])


def seconds(function: Callable[[], object]) -> float:
    """Processor time of a call [s]."""
    start = time.process_time()
    function()
    return time.process_time() - start


def bare(plant: rnc.ReducedPlant, controller: Any, q0: np.ndarray, samples: int) -> float:
    """Processor time of a run alone without its derived quantities, which a batch defers [s]."""

    def run() -> None:
        one = SampledRun(RunArguments(plant.reduced, controller, q0, DT, samples, plant=plant.twin()))
        progress = Progress()
        for sample in range(samples):
            one.sample(progress)
            if sample + 1 < samples:
                one.advance()

    return seconds(run)


def same(run: rnc.Trajectory, other: rnc.Trajectory) -> bool:
    """True if all arrays of two runs have the same bits."""
    names = [each.name for each in fields(run) if each.name != "info"]
    return all(np.array_equal(getattr(run, name), getattr(other, name), equal_nan=True) for name in names)


def rows(name: str, samples: int) -> list[str]:
    """Rows of the table of one scenario."""
    reduced, controller, q0, options = prepared(name)
    plant = rnc.ReducedPlant(reduced, **options)
    q = starts(reduced, q0, max(SIZES))
    duration = (samples - 1) * DT
    run = partial(rnc.simulate, reduced, controller, dt=DT, plant=plant)
    run(q[:2], duration=5 * DT)  # imports, tables
    found = []
    for size in SIZES:
        few = q[0] if size == 1 else q[:size]
        alone = [bare(plant, controller, each, samples) for each in q[:SINGLES]]
        taken = seconds(lambda few=few: run(few, duration=duration))
        alone += [bare(plant, controller, each, samples) for each in q[:SINGLES]]
        single = float(np.median(alone))
        if size == 1:
            taken = single
        found.append((size, size * samples / taken, size * single / taken))
    tracemalloc.start()
    runs = run(q[:64], duration=duration)
    memory = tracemalloc.get_traced_memory()[1] / 64 / samples
    tracemalloc.stop()
    whole = run(q[3], duration=duration)
    bits = "same" if same(runs[3], whole) else "other"
    return [f"| {name} | {n} | {rate:,.0f} | {ratio:.1f} | {memory:,.0f} | {bits} |" for n, rate, ratio in found]


def main() -> None:
    """Print the table."""
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    assert all(a < b for a, b in pairwise(SIZES))
    print("| scenario | runs | samples/s | ratio to runs alone | bytes a sample (64 runs) | bits |")
    print("|---|---|---|---|---|---|")
    for name in sys.argv[2:] or NAMES:
        print("\n".join(rows(name, samples)), flush=True)


if __name__ == "__main__":
    main()
