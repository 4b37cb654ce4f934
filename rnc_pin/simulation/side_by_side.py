"""Runs with arguments of their own that advance in lock-step, each with the bits of a run alone."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np

from rnc_pin.control.controller import Controller
from rnc_pin.errors import RncError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants import Plant, ReducedPlant
from rnc_pin.simulation.ending import outcome_of
from rnc_pin.simulation.many_runs import advance_together, fits_lock_step
from rnc_pin.simulation.record import derive_together
from rnc_pin.simulation.run_info import Outcome
from rnc_pin.simulation.sampled_run import SampledRun
from rnc_pin.simulation.simulation_options import SimulationOptions
from rnc_pin.simulation.trajectory_batch import RunResult


class RunArguments(NamedTuple):
    """Arguments of ``simulate``."""

    reduced: ReducedModel
    controller: Controller
    q0: np.ndarray
    samples: int
    dt: float
    v2_0: np.ndarray | None
    plant: Plant | None
    options: SimulationOptions


def lock_step_key(run: RunArguments) -> Hashable | None:
    """Key that runs have in common if they can advance together; None for a run that has to be alone."""
    plant, options = run.plant, run.options
    if options.observer is not None or not fits_lock_step(run.reduced, plant, options):
        return None
    substeps, limits = (plant.substeps, plant.actuator_limits) if isinstance(plant, ReducedPlant) else (1, False)
    return id(run.reduced), type(run.controller), run.samples, run.dt, substeps, limits, options.stop


def simulate_side_by_side(runs: Sequence[RunArguments]) -> list[RunResult]:
    """Compute runs that have the same ``lock_step_key``, each on a plant of its own. An error ends only its run."""
    results: dict[int, RunResult] = {}
    started: dict[int, SampledRun] = {}
    for number, run in enumerate(runs):
        try:
            started[number] = _started(run)
        except RncError as error:
            results[number] = RunResult(outcome_of(error), error, None)
    if started:
        controllers = [runs[number].controller for number in started]
        found = advance_together(list(started.values()), controllers, runs[0].dt, runs[0].samples)
        results |= dict(zip(started, found, strict=True))
        pending = [k for k in started if results[k].pending and results[k].outcome is Outcome.COMPLETED]
        if pending:
            derive_together([started[k].record for k in pending])
    return [results[number] for number in range(len(runs))]


def _started(run: RunArguments) -> SampledRun:
    reduced, controller, q0, _, dt, v2_0, plant, options = run
    return SampledRun(reduced, controller, q0, dt, 1, v2_0=v2_0, plant=plant, options=options)
