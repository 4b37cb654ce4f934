"""Built-in scenarios in shorter time, with a fault of a drawn size: what a campaign runs.

Apart from its command, for its processes find by name what a run is made of.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rnc_pin.applications.scenario.files import with_options
from rnc_pin.applications.scenario.plant_builder import build_plant
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.applications.sweep.scenario_runs import arguments_of
from rnc_pin.errors import RncError
from rnc_pin.simulation import Trajectory, simulate_many
from rnc_pin.simulation.run_data import tracking_errors

SCENARIOS: dict[str, dict[str, Any]] = {
    "space-robot": {
        "reference.primary.minimum_jerk.duration": 2.5,
        "reference.vertical.minimum_jerk.duration": 2.5,
        "simulation": {"duration": 3.0, "dt": 0.02},
    },
    "mobile-manipulator": {
        "reference.primary.minimum_jerk.duration": 2.5,
        "simulation": {"duration": 3.0, "dt": 0.02},
    },
    "unicycle": {
        "reference.primary": {"harmonic": {"amplitude": [0.8, 0.4], "frequency": [0.1, 0.2], "ramp": 1}},
        "simulation": {"duration": 1.5, "dt": 0.005},
    },
    "mobile-manipulator-two-phase": {
        "initial.q.root_joint": [-0.8, 0.1, 0.1],
        "reference.primary.minimum_jerk.duration": 2,
        "controller.platform.begin": 1.0,
        "simulation": {"duration": 7.5, "dt": 0.02},
    },
}
"""Built-in scenarios made shorter, for many of them."""
LARGEST = {
    "position_noise": 1e-3,
    "velocity_noise": 0.02,
    "position_bias": 5e-3,
    "velocity_bias": 5e-3,
    "counts": 1e-4,
    "delay": 4,
    "jitter": 0.5,
    "dropped": 0.2,
    "garbage": 0.2,
    "effort": 0.5,
    "dead_zone": 0.05,
    "friction": 0.05,
    "masses": 0.5,
    "payload": 0.1,
    "slip_speed": 0.2,
    "stuck": 1.0,
}
"""Of each fault the largest size that is drawn: in its own unit; of inputs a share of the largest without a fault, of
payloads a share of the robot's mass; of encoders one over the counts; of joints that stick when, as a share of the
run."""


def spoilt(fault: str, size: float, clean: dict[str, Any]) -> dict[str, Any]:
    """Scenario settings of a fault of a given size."""
    if fault == "effort":
        return {fault: (1.0 - size) * clean["peak"]}
    if fault in ("dead_zone", "friction"):
        return {fault: size * clean["peak"]}
    if fault == "counts":
        return {fault: 1.0 / max(size, 1e-9)}
    if fault == "delay":
        return {fault: round(size)}
    if fault == "payload":
        return {fault: {"frame": clean["frame"], "mass": max(size, 1e-3) * clean["mass"], "time": 1.0}}
    if fault == "stuck":
        return {fault: {"joint": clean["joint"], "time": size * clean["duration"]}}
    return {fault: size, **({"slip_time": 1.0, "slip_duration": 0.1} if fault == "slip_speed" else {})}


@functools.cache
def prepared(scenario: str) -> Scenario:
    """Without a fault: its gains are the same in every run."""
    return Scenario.load(scenario, {"comparisons": {}, "preflight": "warn", **SCENARIOS[scenario]}).build()


def spoiled(clean: Scenario, options: dict[str, Any]) -> Scenario:
    """A plan of which no more is built anew than the plant."""
    scenario = validate(with_options(clean.raw, options), clean.name)
    before = clean.experiment
    plant = build_plant(scenario, before.reduced, before.q0)
    return clean.built_with(experiment=replace(before, scenario=scenario, plant=plant))


def final_error(run: Trajectory) -> float:
    """Largest final error, as a share of the way."""
    errors = {name: error[~np.isnan(error)] for name, error in tracking_errors(run).items()}
    ways = [np.ptp(getattr(run, kind), axis=0) for kind in ("x2", "x1")]
    names = [name for kind in ("x2", "x1") for name in run.info.outputs.of(kind).names]
    way = dict(zip(names, np.concatenate(ways), strict=True))
    return max(
        (float(abs(each[-1])) / max(way[name], 0.1) for name, each in errors.items() if len(each)), default=np.nan
    )


def reference(scenario: str) -> dict[str, Any]:
    """The run without a fault, and what sizes of faults are measured by."""
    made = prepared(scenario)
    run = simulate_many([arguments_of(spoiled(made, {}))])[0].trajectory
    robot = made.experiment.reduced.robot
    last = [name for name in robot.joint_names if name in made.experiment.reduced.actuation.names]
    return {
        "outcome": str(run.outcome), "error": final_error(run), "duration": float(run.time[-1]),
        "peak": float(np.abs(run.T).max()), "joint": (last or [robot.joint_names[-1]])[-1],
        "frame": robot.model.frames[-1].name, "mass": float(sum(each.mass for each in robot.model.inertias)),
    }  # fmt: skip


class Row(NamedTuple):
    """Result of a run."""

    scenario: str
    fault: str
    run: int
    size: float
    """Of the fault."""
    outcome: str
    error: float
    """Largest final one, as a share of the way."""
    broken: bool
    """Whether it holds NaN."""


def rows_of(scenario: str, fault: str, numbers: Sequence[int], clean: dict[str, Any]) -> list[Row]:
    """Runs whose sizes of a fault are drawn by their numbers. Those that fit together advance in lock-step."""
    rows, runs, arguments = {}, [], []
    for run in numbers:
        size = float(np.random.default_rng([run, *fault.encode()]).uniform(0.0, LARGEST[fault]))
        try:
            made = spoiled(prepared(scenario), {"seed": run, "faults": spoilt(fault, size, clean)})
            arguments.append(arguments_of(made))
            runs.append((run, size))
        except RncError as failure:
            rows[run] = Row(scenario, fault, run, size, f"refused: {failure}"[:80], np.nan, False)
    with np.errstate(over="ignore", invalid="ignore"):  # diverged values
        for (run, size), found in zip(runs, simulate_many(arguments), strict=True):
            if not found.started:
                rows[run] = Row(scenario, fault, run, size, f"refused: {found.error}"[:80], np.nan, False)
                continue
            motion, message = found.trajectory, str(found.error or "")
            outcome = str(found.outcome) + (f": {message.split(' at ')[0][:60]}" if message else "")
            broken = not all(np.isfinite(array).all() for array in (motion.q, motion.v, motion.T))
            rows[run] = Row(scenario, fault, run, size, outcome, final_error(motion), broken)
    return [rows[run] for run in numbers]
