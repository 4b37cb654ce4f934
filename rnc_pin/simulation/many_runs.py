"""Simulation of many runs and their results.

Runs that fit together advance in lock-step, the others one after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar, cast, overload

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import Controller
from rnc_pin.errors import ConfigurationError, InputError, RncError
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.model.input_validation import numbers_of
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants import Plant
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin
from rnc_pin.simulation.lock_step import LockStep
from rnc_pin.simulation.run_info import Outcome
from rnc_pin.simulation.sampled_run import SampledRun
from rnc_pin.simulation.simulation_options import RunArguments, SimulationOptions
from rnc_pin.simulation.stop import Progress, complete_run, outcome_of
from rnc_pin.simulation.trajectory import Trajectory

_Each = TypeVar("_Each")


class RunResult:
    """Result of one run of a batch.

    Args:
        outcome: outcome of the run.
        error: error that ended it early, if any.
        trajectory: the run, or a function that returns it; None if the run could not start.
    """

    def __init__(
        self, outcome: Outcome, error: Exception | None, trajectory: Trajectory | Callable[[], Trajectory] | None
    ) -> None:
        self.outcome, self.error, self._trajectory = outcome, error, trajectory

    @property
    def started(self) -> bool:
        """True if the run has a trajectory."""
        return self._trajectory is not None

    @property
    def trajectory(self) -> Trajectory:
        """The run so far.

        Raises:
            Exception: the error of a run that could not start.
        """
        if self._trajectory is None:
            assert self.error is not None
            raise self.error
        if not isinstance(self._trajectory, Trajectory):
            self._trajectory = self._trajectory()
        return self._trajectory

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "_trajectory": None if self._trajectory is None else self.trajectory}


class TrajectoryBatch(SummaryMixin, Sequence[Trajectory]):
    """Runs of ``simulate`` with many initial states, controllers or plants, in their order.

    ``runs[3]`` is a ``Trajectory``, and ``runs[:4]`` a batch. Forces, energies and residuals of a run are computed when
    they are first read.

    Args:
        results: result of each run.

    Attributes:
        outcomes: outcome of each run.
        errors: error that ended each run early; None for the others.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([0.5, 0.0]))
        >>> starts, tracker = [[0.1, 0.0], [0.2, 0.0], [2e3, 0.0]], rnc.control.VelocityTracker(target)
        >>> runs = rnc.simulate(reduced, tracker, robot.configuration(), 1.0, dt=0.01, v2_0=starts)
        >>> runs
        TrajectoryBatch of 3 runs: 2 completed, 1 diverged
        >>> [str(outcome) for outcome in runs.outcomes], runs[1].v2[0].tolist()
        (['completed', 'completed', 'diverged'], [0.2, 0.0])
        >>> runs.stack("v2").shape  # NaN after the end of a run
        (3, 101, 2)
    """

    def __init__(self, results: Sequence[RunResult]) -> None:
        self._results = tuple(results)
        self.outcomes = tuple(result.outcome for result in self._results)
        self.errors = tuple(result.error for result in self._results)

    def __len__(self) -> int:
        return len(self._results)

    @overload
    def __getitem__(self, index: int) -> Trajectory: ...

    @overload
    def __getitem__(self, index: slice) -> TrajectoryBatch: ...

    def __getitem__(self, index: int | slice) -> Trajectory | TrajectoryBatch:
        if isinstance(index, slice):
            return TrajectoryBatch(self._results[index])
        return self._results[index].trajectory

    def __iter__(self) -> Iterator[Trajectory]:
        return (result.trajectory for result in self._results)

    def stack(self, name: str) -> Array:
        """Array (B, N, ...) of all runs, such as "q" or "time"; NaN after the end of a run, and if it could not start.

        Raises:
            InputError: no run has an array of that name, or their shapes differ.
        """
        started = [result for result in self._results if result.started]
        arrays = {id(result): getattr(result.trajectory, name, None) for result in started}
        found = [array for array in arrays.values() if isinstance(array, np.ndarray)]
        if not found or len(found) < len(started) or len({array.shape[1:] for array in found}) > 1:
            raise InputError(f"no array '{name}' of one shape in all runs")
        stacked = np.full((len(self), max(map(len, found)), *found[0].shape[1:]), np.nan)
        for row, result in zip(stacked, self._results, strict=True):
            array = arrays.get(id(result))
            if array is not None:
                row[: len(array)] = array
        return stacked

    def _summary(self) -> ObjectSummary:
        counts = {str(outcome): self.outcomes.count(outcome) for outcome in Outcome}
        said = ", ".join(f"{count} {outcome}" for outcome, count in counts.items() if count)
        errors = [Item(f"run {run}", str(error)) for run, error in enumerate(self.errors) if error is not None]
        title = f"TrajectoryBatch of {len(self)} runs: {said or 'none'}"
        return ObjectSummary(title, [("errors", errors[:20])] if errors else [])


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


def runs_of_batch(
    reduced: ReducedModel,
    controller: Controller | Sequence[Controller],
    q0: Array,
    dt: float,
    samples: int,
    v2_0: Array | None,
    plant: Plant | Sequence[Plant] | None,
    options: SimulationOptions,
) -> list[RunArguments]:
    """Arguments of each run of a batch.

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
    """
    if isinstance(options, SimulationOptions) and options.observer is not None:
        raise ConfigurationError("observer: one observer cannot tell the runs of a batch apart; simulate each run")
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
    count = next(iter(counts.values()))
    if len(set(counts.values())) > 1 or not count:
        said = ", ".join(f"{name} has {number}" for name, number in counts.items())
        raise InputError(f"the arguments need the same number of runs, at least one: {said}")

    def of_runs(value: _Each | Sequence[_Each]) -> list[_Each]:
        return list(value) if isinstance(value, list | tuple) else [cast(_Each, value)] * count

    every = [options] * count
    if isinstance(state, list):
        every = [replace(options, controller_state=each) for each in state]
    starts = list(q0) if q0.ndim == 2 else of_runs(q0)
    velocities = of_runs(v2_0) if v2_0 is None or v2_0.ndim == 1 else list(v2_0)
    columns = of_runs(controller), starts, velocities, of_runs(plant), every
    return [
        RunArguments(reduced, own, q.copy(), dt, samples, v2, moves, how)
        for own, q, v2, moves, how in zip(*columns, strict=True)
    ]


def simulate_many(runs: Sequence[RunArguments], raises: tuple[type[RncError], ...] = ()) -> list[RunResult]:
    """Compute runs. An error ends only its run; Ctrl-C ends all.

    Args:
        runs: the runs. Those with the same ``lock_step_key`` advance together.
        raises: types of errors that are raised, with the number of the run, if a run cannot start.
    """
    groups: dict[Hashable, list[int]] = {}
    for number, run in enumerate(runs):
        groups.setdefault(run.lock_step_key or number, []).append(number)
    results: dict[int, RunResult] = {}
    interrupted = False
    for numbers in groups.values():
        together, started = len(numbers) > 1, {}
        for number in numbers:
            run = runs[number].on_own_plant() if together else runs[number]
            try:
                started[number] = SampledRun(run, capacity=1 if together else None)
            except RncError as error:
                if isinstance(error, raises):
                    raise error.within(f"run {number}") from None
                results[number] = RunResult(outcome_of(error), error, None)
        if interrupted:
            found = [_ended(each, Outcome.INTERRUPTED) for each in started.values()]
        elif together and started:
            found = _advance_together(list(started.values()), runs[numbers[0]].dt, runs[numbers[0]].samples)
        else:
            found = [_advance_alone(each, run.samples) for each in started.values()]
        results |= dict(zip(started, found, strict=True))
        interrupted = interrupted or any(each.outcome is Outcome.INTERRUPTED for each in found)
    return [results[number] for number in range(len(runs))]


def _advance_together(runs: Sequence[SampledRun], dt: float, samples: int) -> list[RunResult]:
    """Results of runs in lock-step; those that leave the others go on alone."""
    batch, outcome = LockStep(runs, dt, samples), Outcome.COMPLETED
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
            results[number] = _advance_alone(runs[number], samples, advance_first=sampled)
            outcome = results[number].outcome if results[number].outcome is Outcome.INTERRUPTED else outcome
    for number in batch.places.tolist():
        results[number] = _ended(runs[number], outcome)
    return [results[number] for number in range(len(runs))]


def _advance_alone(run: SampledRun, samples: int, advance_first: bool = False) -> RunResult:
    """Result of a run that goes on alone to its end; ``advance_first`` if its last sample is complete."""

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
