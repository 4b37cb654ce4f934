"""Runs of one model that advance in lock-step.

Only regular samples are computed together. A run that meets anything else (a singular state, a stop condition, an error
of its controller) leaves the others before that sample and goes on alone, which raises the errors of a run alone.

Each run has the bits of a run alone. The sizes of a sweep's batches follow the clock, and its rows must not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import Command
from rnc_pin.control.loop import Decision, LoopState
from rnc_pin.math.linear_algebra import apply, clipped
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import FaultyPlant, ReducedPlant, ReducedPlantBatch
from rnc_pin.plants.faults import Reading, needs_own_steps
from rnc_pin.simulation.faulty_runs import FaultyRuns, SeparatePlants, with_rows
from rnc_pin.simulation.many_controllers import ManyControllers
from rnc_pin.simulation.sampled_run import SampledRun
from rnc_pin.simulation.stop import Progress

_GOALS = ("v2_desired", "x1_desired", "x2_desired")


class Leaver(NamedTuple):
    """Run that goes on alone."""

    place: int
    """Index among all runs."""
    sampled: bool
    """True if it leaves between a sample and the next, False before a sample."""


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
        self._runs, self._dt, self._samples, self.samples_done = list(runs), dt, samples, 0
        self._plants = _plants_of(runs)
        self._limits = runs[0].loop.limits
        self._rows = np.full((len(runs), samples, runs[0].record.width), np.nan)
        for run, rows in zip(runs, self._rows, strict=True):
            run.record.use(rows)
        faulty = isinstance(runs[0].plant, FaultyPlant)
        self._faults = FaultyRuns(runs, self._plants, dt, samples) if faulty else None
        states = [run.loop.state.controller for run in runs]
        self._controllers = ManyControllers([run.controller for run in runs], states)
        self._deficit: Array | None = None
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
                self._plants.advance(self._dt)
                if self._faults is not None:
                    self._faults.advance()
                if self._plants.failed.any():
                    self._leave(self._plants.failed, sample + 1, sampled=True)

    def settle(self) -> None:
        """Complete the records of the runs that are still here."""
        for place, run in enumerate(self.places.tolist()):
            record, loop = self._runs[run].record, self._runs[run].loop
            if self._faults is None or not self._faults.apart[place]:
                loop.state = loop.state._replace(controller=self._controllers.state(place))
            record.written(self.samples_done)
            self._runs[run].errors = self._plants.errors_of(place)

    # ------------------------------------------------------------------ a sample

    def _sample(self, sample: int) -> bool:
        """Compute and record a sample. False if runs left instead: then the others have to be sampled again."""
        plants, t = self._plants, sample * self._dt
        states, valid = plants.measure()
        if states is None or not valid.all():
            return self._leave(~valid, sample)
        stopped = self._runs[0].stop.stopped(states)
        if stopped.any():
            return self._leave(stopped, sample)
        seen, integrals, apart = states, plants.integrals, np.zeros(plants.size, dtype=bool)
        if self._faults is not None:
            seen, integrals, invalid, failed = self._faults.read(t, states)
            if failed.any():
                return self._leave(failed, sample)
            for place in np.flatnonzero(invalid).tolist():
                self._runs[self.places[place]].loop.state = self._loop_state(place)
            self._faults.apart |= invalid
            apart = self._faults.apart
        measurement = self._measurement(seen, integrals)
        answer = self._controllers.step(t, measurement, apart)
        failed = answer.failed & ~apart
        if failed.any():
            return self._leave(failed, sample)
        command = answer.command
        requested, failed = self._inputs(seen, command, apart)
        if not failed.any() and apart.any():
            failed, command = self._step_apart(t, (requested, integrals), command)
        if failed.any():
            return self._leave(failed, sample)
        T = requested if self._limits is None else clipped(requested, self._limits)
        if self._faults is None:
            plants.apply(T)
            applied, outputs = plants.applied, (measurement.x1, measurement.x2)
        else:
            self._faults.apply(T)
            applied, outputs = self._faults.applied, states.outputs(integrals)
            if any(self._runs[run].loop.last is None for run in self.places[apart].tolist()):
                outputs = self._before_measurements(states, outputs)
            self._faults.keep_sample(sample, measurement, integrals, command, requested)
        self._deficit = None if np.array_equal(requested, applied) else requested - applied
        self._controllers.states = answer.states
        self._record(sample, states, (*outputs, applied, integrals), command)
        if apart.any():
            self._rejoin(t)
        return True

    def _step_apart(self, t: float, rows: tuple[Array, Array], command: Command) -> tuple[Array, Command]:
        """Let the loops of the runs apart take a sample.

        Args:
            t: time [s].
            rows: requested inputs (B, p) and integrals (B, r), into which those of these runs are written.
            command: commands of all runs.

        Returns:
            The mask (B,) of the runs that have to raise an error alone, and the commands with those of these runs.
        """
        faults, failed = cast(FaultyRuns, self._faults), np.zeros(len(self.places), dtype=bool)
        apart, commands = np.flatnonzero(faults.apart).tolist(), []
        loops = [self._runs[self.places[place]].loop for place in apart]
        before = [(loop.state, loop.last) for loop in loops]
        for place, loop in zip(apart, loops, strict=True):
            try:
                T = loop.step(t, *cast(Reading, faults.readings[place]))
            except Exception:  # alone it raises the same error
                failed[place] = True
                continue
            valid = loop.state.fault is None and loop.last is not None
            rows[0][place] = cast(Decision, loop.last).requested if valid else T
            rows[1][place] = 0.0 if loop.state.integrals is None else loop.state.integrals
            commands.append(Command() if loop.last is None else loop.last.command)
        if failed.any():
            for loop, (state, last) in zip(loops, before, strict=True):
                loop.state, loop.last = state, last
            return failed, command
        return failed, with_rows(command, apart, commands)

    def _before_measurements(self, states: StateEvaluation, outputs: tuple[Array, Array]) -> tuple[Array, Array]:
        """Outputs x1 and x2, without integrals in the runs that have had no valid measurement."""
        x1, x2 = outputs[0], np.array(outputs[1])
        for place in np.flatnonzero(cast(FaultyRuns, self._faults).apart).tolist():
            if self._runs[self.places[place]].loop.last is None:
                x2[place] = states.measure(None).x2[place]
        return x1, x2

    def _rejoin(self, t: float) -> None:
        """Complete the sample of the loops apart, and let those with a valid measurement go on with the others."""
        faults, back = cast(FaultyRuns, self._faults), []
        for place in np.flatnonzero(faults.apart).tolist():
            run = self._runs[self.places[place]]
            run.loop.report_applied_input(faults.applied[place].copy())
            run.count_fallback(t, run.loop.state.fault)
            if run.loop.state.fault is None:
                back.append(place)
        if back and self._controllers.put(back, [self._runs[self.places[p]].loop.state.controller for p in back]):
            faults.rejoin(back)

    def _loop_state(self, place: int) -> LoopState:
        """State of the loop of a run that takes the next sample with its own loop."""
        deficit = None if self._deficit is None else self._deficit[place]
        if deficit is not None and not deficit.any():
            deficit = None
        state = LoopState(begin=0.0, input_deficit=deficit, controller=self._controllers.state(place))
        return state if self._faults is None else self._faults.leave(place, state)

    def _state(self, states: StateEvaluation, run: int) -> StateEvaluation:
        """One of the states that the loops see."""
        if isinstance(self._plants, ReducedPlantBatch) and self._faults is None:
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

    def _inputs(self, states: StateEvaluation, command: Command, apart: Array) -> tuple[Array, Array]:
        """Inputs (B, p) of a command, and the mask (B,) of the runs, but those ``apart``, that find theirs alone."""
        reduced, count = self._plants.reduced, self._plants.size
        every, T = np.ones(count, dtype=bool), np.zeros((count, reduced.p))
        if (command.F is None) == (command.T is None):
            return T, every
        if command.T is not None:
            T = np.array(command.T, dtype=float)
            if T.shape != (count, reduced.p):
                return T, every
            T[apart] = 0.0
            return T, ~np.asarray(np.isfinite(T).all(axis=1))
        F = np.asarray(command.F, dtype=float)
        if F.shape != (count, reduced.r):
            return T, every
        if apart.any():
            F = np.where(apart[:, None], 0.0, F)
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
        external, models = plants.external, plants.models
        lost = None if self._faults is None else self._faults.lost(states.q)
        if models is not None or external is not None or lost is not None:
            for place, run in enumerate(self.places.tolist()):
                model = plants.reduced if models is None else models[place]
                forces: Array | None = None if external is None else external[place]
                taken = None if lost is None else lost[place]
                if taken is not None:
                    forces = taken if forces is None else forces + taken
                if forces is not None or models is not None:
                    self._runs[run].record.written(sample)
                    self._runs[run].record.moves(model, forces)
        if command.estimates is not None or command.prediction_error is not None:
            for place, run in enumerate(self.places.tolist()):
                record = self._runs[run].record
                record.written(sample)
                optional = command.estimates, command.prediction_error
                record.add_optional(*(None if each is None else each[place] for each in optional))

    # ------------------------------------------------------------------ runs that leave

    def _leave(self, leaving: Array, samples: int, sampled: bool = False) -> bool:
        """Let runs go on alone after a number of samples; return False. ``sampled`` as of a ``Leaver``."""
        for place in np.flatnonzero(leaving).tolist():
            number = int(self.places[place])
            run = self._runs[number]
            run.continue_from(samples, self._plants.checkpoint(place), self._loop_state(place))
            run.record.written(samples)
            self.leavers.append(Leaver(number, sampled))
        staying = ~leaving
        self._plants.keep(staying)
        self._controllers.keep(staying)
        if self._faults is not None:
            self._faults.keep(staying)
        self.places = self.places[staying]
        self._deficit = None if self._deficit is None else self._deficit[staying]
        return False


def _plants_of(runs: Sequence[SampledRun]) -> ReducedPlantBatch | SeparatePlants:
    """Plants of runs, without those faults that a plant does not have itself, at the state of each."""
    reduced, plants = runs[0].record.reduced, [run.plant for run in runs]
    if needs_own_steps(plants[0], reduced):
        return SeparatePlants(plants, reduced)
    moving = [each.plant if isinstance(each, FaultyPlant) else each for each in plants]
    batch = ReducedPlantBatch(cast(ReducedPlant, moving[0]), len(moving))
    for place, each in enumerate(moving):
        batch.rollback(place, cast(ReducedPlant, each).checkpoint())
    return batch
