"""Simulation of many runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import Controller
from rnc_pin.errors import ConfigurationError, InputError, RncError
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.model.input_validation import numbers_of
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants import Plant, ReducedPlant
from rnc_pin.simulation.ending import Progress, complete_run, outcome_of
from rnc_pin.simulation.lock_step import LockStep
from rnc_pin.simulation.run_info import Outcome
from rnc_pin.simulation.sampled_run import SampledRun
from rnc_pin.simulation.simulation_options import SimulationOptions
from rnc_pin.simulation.trajectory import Trajectory
from rnc_pin.simulation.trajectory_batch import RunResult, TrajectoryBatch


def is_batch(controller: object, q0: object, v2_0: object, plant: object, options: object) -> bool:
    """True if the arguments of ``simulate`` describe many runs."""
    listed = isinstance(controller, list | tuple) or isinstance(plant, list | tuple)
    return listed or _has_rows(q0) or _has_rows(v2_0) or isinstance(_states(options), list)


def _has_rows(values: object) -> bool:
    if isinstance(values, np.ndarray):
        return values.ndim > 1
    return isinstance(values, list | tuple) and len(values) > 0 and isinstance(values[0], list | tuple | np.ndarray)


def _states(options: object) -> object:
    return options.controller_state if isinstance(options, SimulationOptions) else None


def fits_lock_step(reduced: ReducedModel, plant: object, options: SimulationOptions) -> bool:
    """True if a run can advance in lock-step with others of the same model, plant options and stop conditions."""
    data = reduced.reduction_data
    plain = plant is None or (type(plant) is ReducedPlant and plant.reduced is reduced and not plant.dissipates)
    simple = not options.loop and not options.stop.lift_off
    return plain and simple and reduced.evaluator.measures and not data.rheonomic and not data.affine


class ManyRuns:
    """Arguments of many runs of ``simulate``.

    Args:
        reduced: reduced model.
        controller: controller of all runs, or one for each.
        q0: initial configurations (B, nq), or one (nq,) for all.
        dt: sampling period [s].
        samples: number of samples.
        v2_0: initial reduced velocities (B, r), or (r,) for all; None for zero.
        plant: plant of all runs, or one for each; None for ``ReducedPlant(reduced)``.
        options: options; ``controller_state`` may be a list of one state for each run.

    Raises:
        InputError: wrong shapes, or the arguments have different numbers of runs.
        ConfigurationError: an observer, which could not tell the runs apart.

    Attributes:
        count: number of runs B.
        controllers: controller of each run.
        in_lock_step: True if the runs advance together.
    """

    def __init__(
        self,
        reduced: ReducedModel,
        controller: Controller | Sequence[Controller],
        q0: Array,
        dt: float,
        samples: int,
        v2_0: Array | None,
        plant: Plant | Sequence[Plant] | None,
        options: SimulationOptions,
    ) -> None:
        if isinstance(options, SimulationOptions) and options.observer is not None:
            raise ConfigurationError("observer: one observer cannot tell the runs of a batch apart; simulate each run")
        self._reduced, self._dt, self._samples = reduced, dt, samples
        q0, v2_0 = numbers_of(q0, "q0"), None if v2_0 is None else numbers_of(v2_0, "v2_0")
        state, counts = _states(options), {}
        for name, array in (("q0", q0), ("v2_0", v2_0)):
            if array is not None and array.ndim > 2:
                raise InputError(f"{name} has shape {array.shape}, expected one row or a row for each run")
            if array is not None and array.ndim == 2:
                counts[name] = len(array)
        for name, each in (("controller", controller), ("plant", plant), ("controller_state", state)):
            if isinstance(each, list) or (isinstance(each, tuple) and each is not state):
                counts[name] = len(each)
        self.count = B = next(iter(counts.values()))
        if len(set(counts.values())) > 1 or not B:
            said = ", ".join(f"{name} has {count}" for name, count in counts.items())
            raise InputError(f"the arguments need the same number of runs, at least one: {said}")
        self._q0 = q0 if q0.ndim == 2 else np.broadcast_to(q0, (B, *q0.shape))
        self._v2_0 = [v2_0] * B if v2_0 is None or v2_0.ndim == 1 else list(v2_0)
        self.controllers: list[Any] = list(controller) if isinstance(controller, list | tuple) else [controller] * B
        self._plants: list[Any] = list(plant) if isinstance(plant, list | tuple) else [plant] * B
        states = state if isinstance(state, list) else [state] * B
        self._options = [options] * B if state is None else [replace(options, controller_state=each) for each in states]

        self.in_lock_step = self._fit_together()

    def _fit_together(self) -> bool:
        """True if the runs can advance in lock-step."""
        first = self._plants[0]
        same = all(plant is first for plant in self._plants)
        return same and self.count > 1 and fits_lock_step(self._reduced, first, self._options[0])

    def run(self, number: int) -> SampledRun:
        """Return one run before its first sample, on a plant of its own."""
        plant = self._plants[number]
        if plant is not None and self.in_lock_step:
            plant = ReducedPlant(self._reduced, actuator_limits=plant.actuator_limits, substeps=plant.substeps)
        return self._started(number, plant, 1)

    def alone(self, number: int) -> RunResult:
        """Compute one run without the others."""
        return result_alone(self._started(number, self._plants[number], self._samples), self._samples)

    def _started(self, number: int, plant: Any, capacity: int) -> SampledRun:
        return SampledRun(
            self._reduced,
            self.controllers[number],
            self._q0[number].copy(),
            self._dt,
            capacity,
            v2_0=self._v2_0[number],
            plant=plant,
            options=self._options[number],
        )

    def together(self, runs: Sequence[SampledRun], numbers: Sequence[int]) -> list[RunResult]:
        """Compute runs that advance together."""
        return advance_together(runs, [self.controllers[number] for number in numbers], self._dt, self._samples)


def advance_together(
    runs: Sequence[SampledRun], controllers: Sequence[Controller], dt: float, samples: int
) -> list[RunResult]:
    """Compute runs of one model and of equal options in lock-step, each with the bits of a run alone.

    Args:
        runs: runs before their first sample, as for ``LockStep``.
        controllers: controller of each run.
        dt: sampling period [s].
        samples: number of samples.
    """
    states = [run.loop.state.controller for run in runs]
    batch = LockStep(runs, controllers, states, dt, samples)
    outcome = Outcome.COMPLETED
    with uninterrupted():
        try:
            with interruptible():
                batch.advance(Progress())
        except KeyboardInterrupt:
            outcome = Outcome.INTERRUPTED
        batch.settle()
        results: dict[int, RunResult] = {}
        for number, sampled in batch.leavers:
            if outcome is Outcome.INTERRUPTED:
                results[number] = _ended(runs[number], outcome)
                continue
            results[number] = result_alone(runs[number], samples, advance_first=sampled)
            outcome = results[number].outcome if results[number].outcome is Outcome.INTERRUPTED else outcome
    for number in batch.places.tolist():
        results[number] = _ended(runs[number], outcome)
    return [results[number] for number in range(len(runs))]


def simulate_many(many: ManyRuns) -> TrajectoryBatch:
    """Compute many runs, each with the bits of a run alone. An error ends only its run.

    Raises:
        InputError: wrong shapes or numbers, with the number of the run.
        ConfigurationError: as for ``simulate``.
    """
    results: dict[int, RunResult] = {}
    if not many.in_lock_step:
        for number in range(many.count):
            results[number] = _guarded(many, number)
        return TrajectoryBatch([results[number] for number in range(many.count)])
    runs: list[SampledRun] = []
    numbers: list[int] = []
    for number in range(many.count):
        try:
            runs.append(many.run(number))
            numbers.append(number)
        except (InputError, ConfigurationError) as error:
            raise error.within(f"run {number}") from None
        except RncError as error:
            results[number] = RunResult(outcome_of(error), error, None)
    if runs:
        results |= dict(zip(numbers, many.together(runs, numbers), strict=True))
    return TrajectoryBatch([results[number] for number in range(many.count)])


def _guarded(many: ManyRuns, number: int) -> RunResult:
    """Result of a run without the others."""
    try:
        return many.alone(number)
    except (InputError, ConfigurationError) as error:
        raise error.within(f"run {number}") from None
    except RncError as error:
        return RunResult(outcome_of(error), error, None)


def result_alone(run: SampledRun, samples: int, advance_first: bool = False) -> RunResult:
    """Result of a run that goes on alone to its end."""

    def advance(progress: Progress) -> str | None:
        if advance_first:
            progress.time = run.time
            run.advance()
        return run.run_to(samples, progress)

    try:
        trajectory = complete_run(advance, run.finish)
    except RncError as error:
        if not isinstance(error.trajectory, Trajectory):
            raise
        return RunResult(error.trajectory.outcome, error, error.trajectory)
    return RunResult(trajectory.outcome, None, trajectory)


def _ended(run: SampledRun, outcome: Outcome) -> RunResult:
    """Result of a run whose trajectory is made when somebody reads it."""
    return RunResult(outcome, None, lambda: run.finish(outcome, None, deferred=True))
