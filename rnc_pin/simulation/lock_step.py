"""Runs of one model that advance in lock-step.

Only regular samples are computed together. A run that meets anything else (a singular state, a stop condition, an error
of its controller) leaves the others before that sample and goes on alone, which raises the errors of a run alone.

Each run has the bits of a run alone. The sizes of a sweep's batches follow the clock, and its rows must not.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import compress
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import (
    Command,
    Controller,
    NotStackable,
    State,
    accepts_batches,
    measurement_of_run,
    stack_states,
    state_of_runs,
)
from rnc_pin.control.loop import LoopState
from rnc_pin.math.linear_algebra import apply, clipped
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import FaultyPlant, ReducedPlant, ReducedPlantBatch
from rnc_pin.simulation.error_propagation import ErrorMark, marked
from rnc_pin.simulation.faulty_runs import FaultyRuns
from rnc_pin.simulation.sampled_run import SampledRun
from rnc_pin.simulation.stop import Progress

_GOALS = ("v2_desired", "x1_desired", "x2_desired")


class Leaver(NamedTuple):
    """Run that goes on alone."""

    place: int
    """Index among all runs."""
    sampled: bool
    """True if it leaves between a sample and the next, False before a sample."""


class _Answer(NamedTuple):
    """Commands of all runs."""

    command: Command
    """Fields (B, ...); NaN in the rows of the runs without a value."""
    states: State
    """States of the controllers after the step."""
    failed: Array
    """Mask (B,) of the runs whose controller raised an error, or gave another command than expected."""


class _Controllers:
    """Controllers of many runs, and their states: one call for all runs if they share one that accepts batches.

    Args:
        controllers: controller of each run.
        states: state of each controller.
    """

    def __init__(self, controllers: Sequence[Controller], states: Sequence[State]) -> None:
        self._each, self._shared = list(controllers), False
        self.states: State = list(states)
        if accepts_batches(controllers[0]) and all(each is controllers[0] for each in controllers):
            with suppress(NotStackable):
                self.states, self._shared = stack_states(states), True

    def step(self, t: float, measurement: Measurement) -> _Answer:
        """Return the commands of all runs at time t [s]; ``states`` does not change."""
        if not self._shared:
            return self._in_turn(t, measurement, self.states)
        every = np.ones(len(self._each), dtype=bool)
        try:
            command, states = self._each[0].step(t, measurement, self.states)
            if isinstance(command, Command) and _of_shapes(command, measurement):
                return _Answer(command, states, ~every)
            return _Answer(Command(), None, every)
        except Exception:  # of one run, which is not known
            found = self._in_turn(t, measurement, [self.state(place) for place in range(len(every))])
            if found.failed.any():
                return found
            try:
                return found._replace(states=stack_states(found.states))
            except NotStackable:
                return found._replace(failed=every)

    def state(self, place: int) -> State:
        """State of the controller of one run."""
        return state_of_runs(self.states, place) if self._shared else self.states[place]

    def keep(self, staying: Array) -> None:
        """Keep only the runs of a mask (B,)."""
        self._each = list(compress(self._each, staying))
        self.states = state_of_runs(self.states, staying) if self._shared else list(compress(self.states, staying))

    def _in_turn(self, t: float, measurement: Measurement, before: Sequence[State]) -> _Answer:
        """Commands of one controller after the other."""
        commands: list[object] = []
        states: list[State] = []
        failed = np.zeros(len(before), dtype=bool)
        for place, (controller, state) in enumerate(zip(self._each, before, strict=True)):
            seen = measurement_of_run(measurement, place)
            if seen.input_deficit is not None and not seen.input_deficit.any():
                seen = seen._replace(input_deficit=None, force_deficit=None)
            command: object = None
            try:
                command, state = controller.step(t, seen, state)
            except Exception:  # alone it raises the same error
                failed[place] = True
            commands.append(command)
            states.append(state)
        together, misfits = _together(commands, failed, measurement)
        return _Answer(together, states, failed | misfits)


class LockStep:
    """Runs of one model with equal sampling times.

    Args:
        runs: runs before their first sample, on a ``ReducedPlant`` each with equal options, or each with faults.
        dt: sampling period [s].
        samples: number of samples.

    Attributes:
        leavers: runs that left so far.
        places: indices of the runs that are still here.
        samples_done: number of complete samples of these.
    """

    def __init__(self, runs: Sequence[SampledRun], dt: float, samples: int) -> None:
        plant = _without_faults(runs[0])
        self._runs, self._dt, self._samples, self.samples_done = list(runs), dt, samples, 0
        self._plants = ReducedPlantBatch(plant, len(runs))
        self._limits = runs[0].loop.limits
        self._rows = np.full((len(runs), samples, runs[0].record.width), np.nan)
        for place, (run, rows) in enumerate(zip(runs, self._rows, strict=True)):
            self._plants.rollback(place, _without_faults(run).checkpoint())
            run.record.use(rows)
        faulty = isinstance(runs[0].plant, FaultyPlant)
        self._faults = FaultyRuns(runs, self._plants, dt, samples) if faulty else None
        states = [run.loop.state.controller for run in runs]
        self._controllers = _Controllers([run.controller for run in runs], states)
        self._deficit: Array | None = None
        self._marks: list[tuple[Array, ErrorMark]] = []
        self._steps = np.ones((len(runs), samples), dtype=np.int32)
        self.places = np.arange(len(runs))
        self.leavers: list[Leaver] = []

    def advance(self, progress: Progress) -> None:
        """Advance all runs to their end, or until they leave.

        Args:
            progress: receives the time.
        """
        for sample in range(self._samples):
            if not len(self.places):
                return
            progress.time = sample * self._dt
            while len(self.places) and not self._sample(sample):
                pass
            self.samples_done = sample + 1
            if sample + 1 < self._samples and len(self.places):
                if self._faults is not None and (slipping := self._faults.slipping()).any():
                    self._leave(slipping, sample + 1, sampled=True)
                    if not len(self.places):
                        return
                self._plants.advance(self._dt)
                if self._faults is not None:
                    self._faults.advance()
                if self._plants.failed.any():
                    self._leave(self._plants.failed, sample + 1, sampled=True)

    def settle(self) -> None:
        """Complete the records of the runs that are still here."""
        for place, run in enumerate(self.places.tolist()):
            record, loop = self._runs[run].record, self._runs[run].loop
            loop.state = loop.state._replace(controller=self._controllers.state(place))
            record.written(self.samples_done)
            self._keep_marks(run, self.samples_done)
            self._runs[run].errors.at_the_end = self._plants.errors_of(place)

    # ------------------------------------------------------------------ a sample

    def _sample(self, sample: int) -> bool:
        """Compute and record a sample. False if runs left instead: then the others have to be sampled again."""
        plants, t = self._plants, sample * self._dt
        states, valid = plants.measure()
        if not valid.all():
            return self._leave(~valid, sample)
        stopped = self._runs[0].stop.stopped(states)
        if stopped.any():
            return self._leave(stopped, sample)
        seen, integrals = states, plants.integrals
        if self._faults is not None:
            seen, integrals, failed = self._faults.read(t, states)
            if failed.any():
                return self._leave(failed, sample)
        measurement = self._measurement(seen, integrals)
        answer = self._controllers.step(t, measurement)
        if answer.failed.any():
            return self._leave(answer.failed, sample)
        requested, failed = self._inputs(seen, answer.command)
        if failed.any():
            return self._leave(failed, sample)
        T = requested if self._limits is None else clipped(requested, self._limits)
        if self._faults is None:
            plants.apply(T)
            applied, outputs = plants.applied, (measurement.x1, measurement.x2)
        else:
            self._faults.apply(T)
            applied, outputs = self._faults.applied, states.outputs(integrals)
            self._faults.keep_sample(sample, states.q, measurement, integrals, answer.command, requested)
        self._deficit = None if np.array_equal(requested, applied) else requested - applied
        history = self._runs[self.places[0]].errors
        if history.propagates:
            self._steps[self.places, sample] = plants.steps
            if marked(sample):
                due = history.sees(sample)
                memory = [self._controllers.state(place) if due else None for place in range(plants.size)]
                self._marks.append((self.places, ErrorMark(sample, plants.charts, memory, integrals)))
        self._controllers.states = answer.states
        self._record(sample, states, (*outputs, applied, integrals), answer.command)
        return True

    def _state(self, states: StateEvaluation, run: int) -> StateEvaluation:
        """One of the states that the loops see."""
        if self._faults is None:
            return self._plants.state(states, run)
        return self._plants.reduced.at(states.q[run], v=states.v[run])

    def _measurement(self, states: StateEvaluation, integrals: Array) -> Measurement:
        """Measurement of all runs, in contiguous arrays, with the deficits of the last sample."""
        measured = states.measure(integrals)
        fields = [None if field is None else np.ascontiguousarray(field) for field in measured]
        measurement, deficit = Measurement._make(fields), self._deficit
        if deficit is None:
            return measurement
        force = np.zeros(measurement.v2.shape)
        for run in np.flatnonzero(deficit.any(axis=1)).tolist():
            force[run] = apply(self._state(states, run).input_matrix, deficit[run])
        return measurement._replace(input_deficit=deficit, force_deficit=force)

    def _inputs(self, states: StateEvaluation, command: Command) -> tuple[Array, Array]:
        """Inputs (B, p) of a command, and the mask (B,) of the runs that have to find theirs alone."""
        reduced, count = self._plants.reduced, self._plants.size
        every, T = np.ones(count, dtype=bool), np.zeros((count, reduced.p))
        if (command.F is None) == (command.T is None):
            return T, every
        if command.T is not None:
            T = np.asarray(command.T, dtype=float)
            return T, every if T.shape != (count, reduced.p) else ~np.asarray(np.isfinite(T).all(axis=1))
        F = np.asarray(command.F, dtype=float)
        if F.shape != (count, reduced.r):
            return T, every
        failed = ~np.isfinite(F).all(axis=1)
        found = None if failed.any() else states.arrays_at_q.allocated(states, F)
        if found is not None:
            return found, failed
        for run in np.flatnonzero(~failed).tolist():
            try:
                T[run] = self._state(states, run).allocate(F[run])
            except Exception:  # alone it raises the same error
                failed[run] = True
        return T, failed

    def _record(self, sample: int, states: StateEvaluation, others: tuple[Array, ...], command: Command) -> None:
        """Record true states, with ``others``: x1, x2, applied inputs and integrals."""
        plants, count = self._plants, self._plants.size
        given = [getattr(command, name) for name in _GOALS]
        x1, x2, T, integrals = others
        goals = [
            np.full(of.shape, np.nan) if goal is None else goal
            for goal, of in zip(given, (states.v2, x1, x2), strict=True)
        ]
        numbers = (
            np.full((count, 1), sample * self._dt), plants.work[:, None], states.q, states.v, states.v2,
            x1, x2, states.v1, T, integrals, *goals,
        )  # fmt: skip
        np.concatenate(numbers, axis=1, out=(rows := np.empty((count, self._rows.shape[2]))))
        self._rows[self.places, sample] = rows
        if command.estimates is not None or command.prediction_error is not None:
            for place, run in enumerate(self.places.tolist()):
                record = self._runs[run].record
                record.written(sample)
                optional = command.estimates, command.prediction_error
                record.add_optional(*(None if each is None else each[place] for each in optional))

    def _keep_marks(self, run: int, samples: int) -> None:
        """Give a run the history of its errors in a number of samples."""
        history = self._runs[run].errors
        history.steps = self._steps[run, :samples].tolist() if history.propagates else []
        for places, mark in self._marks:
            history.keep(mark.of_run(int(np.searchsorted(places, run))))

    # ------------------------------------------------------------------ runs that leave

    def _leave(self, leaving: Array, samples: int, sampled: bool = False) -> bool:
        """Let runs go on alone after a number of samples; return False. ``sampled`` as of a ``Leaver``."""
        for place in np.flatnonzero(leaving).tolist():
            number = int(self.places[place])
            run = self._runs[number]
            deficit = None if self._deficit is None else self._deficit[place]
            if deficit is not None and not deficit.any():
                deficit = None
            state = LoopState(begin=0.0, input_deficit=deficit, controller=self._controllers.state(place))
            if self._faults is not None:
                state = self._faults.leave(place, state)
            run.continue_from(samples, self._plants.checkpoint(place), state)
            run.record.written(samples)
            self._keep_marks(number, samples)
            self.leavers.append(Leaver(number, sampled))
        staying = ~leaving
        self._plants.keep(staying)
        self._controllers.keep(staying)
        if self._faults is not None:
            self._faults.keep(staying)
        self.places = self.places[staying]
        self._deficit = None if self._deficit is None else self._deficit[staying]
        return False


def _without_faults(run: SampledRun) -> ReducedPlant:
    plant = run.plant.plant if isinstance(run.plant, FaultyPlant) else run.plant
    assert isinstance(plant, ReducedPlant)
    return plant


def _sizes(measurement: Measurement) -> dict[str, int]:
    """Size of the goals and forces of a command by name."""
    r, k = measurement.v2.shape[-1], measurement.x1.shape[-1]
    return {"F": r, "v2_desired": r, "x1_desired": k, "x2_desired": r}


def _of_shapes(command: Command, measurement: Measurement) -> bool:
    """True if the fields of a command of all runs have their rows."""
    count, sizes = len(measurement.v2), _sizes(measurement)
    given = {name: getattr(command, name) for name in sizes}
    return all(value is None or np.shape(value) == (count, sizes[name]) for name, value in given.items())


def _together(commands: Sequence[object], failed: Array, measurement: Measurement) -> tuple[Command, Array]:
    """Command of all runs, and the mask (B,) of those whose own has another form."""
    count, misfits = len(commands), np.zeros(len(commands), dtype=bool)
    present = [name for name in Command._fields if any(getattr(each, name, None) is not None for each in commands)]
    sizes, fields = _sizes(measurement), {}
    for name in present:
        shapes = [np.shape(value) for each in commands if (value := getattr(each, name, None)) is not None]
        shape = (sizes[name],) if name in sizes else shapes[0]
        field = np.full((count, *shape), np.nan)
        for place, each in enumerate(commands):
            value = getattr(each, name, None)
            if value is None:
                misfits[place] |= name not in ("v2_desired", "x1_desired", "x2_desired")
            elif np.shape(value) == shape:
                field[place] = value
            else:
                misfits[place] = True
        fields[name] = field
    for place, each in enumerate(commands):
        misfits[place] |= not failed[place] and not isinstance(each, Command)
    return Command(**fields), misfits
