"""Sensors, loops and actuators of runs with faults that advance in lock-step.

Noise, delays and the checks of a loop are those of the plant and of the loop of each run. The states that the loops see
are evaluated together.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import compress
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import Command, Runs
from rnc_pin.control.loop import Decision, LoopState
from rnc_pin.control.loop.control_loop import trapezoid
from rnc_pin.control.loop.loop_state import VelocityEstimate
from rnc_pin.control.loop.measurements import InvalidMeasurementError
from rnc_pin.errors import RncError
from rnc_pin.model.compiled_states import CompiledArraysAtV
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.faults import FaultyPlant, Reading, sensed_together, transmitted
from rnc_pin.plants.plant import Plant
from rnc_pin.plants.reduced import IntegrationErrors, ReducedPlantBatch
from rnc_pin.simulation.sampled_run import SampledRun

_EMPTY = np.zeros(0)


class _LastSample(NamedTuple):
    """Quantities of a sample that the loops keep."""

    measurement: Measurement
    command: Command
    requested: Array
    integrals: Array

    def of_runs(self, runs: Runs) -> _LastSample:
        """Rows of some runs, or of one."""
        parts = (type(each)._make([None if field is None else field[runs] for field in each]) for each in self[:2])
        measurement, command = cast(tuple[Measurement, Command], tuple(parts))
        return _LastSample(measurement, command, self.requested[runs], self.integrals[runs])


_Fields = TypeVar("_Fields", Measurement, Command)


def with_rows(fields: _Fields, runs: Sequence[int], rows: Sequence[_Fields]) -> _Fields:
    """Fields (B, ...) of all runs with those of some runs; NaN where these have none."""
    found = [None if field is None else np.array(field) for field in fields]
    for run, row in zip(runs, rows, strict=True):
        for field, own in zip(found, row, strict=True):
            if field is not None:
                field[run] = np.nan if own is None else own
    return type(fields)._make(found)


class SeparatePlants:
    """Plants of B runs with faults that take their steps one after the other.

    Args:
        plants: plants at the state of each run; they move.
        reduced: model of the controllers.

    Attributes:
        size: number of runs B.
        failed: mask (B,) of the runs whose last step raised an error; their plants have not moved.
        applied: inputs (B, p) of the plants within.
        models: model of each plant.
    """

    def __init__(self, plants: Sequence[Plant], reduced: ReducedModel) -> None:
        self.reduced, self.size = reduced, len(plants)
        self._plants = cast("list[FaultyPlant]", list(plants))
        self.failed = np.zeros(self.size, dtype=bool)
        self.applied = np.zeros((self.size, reduced.p))

    def measure(self) -> tuple[StateEvaluation | None, Array]:
        """Return the true states (B,), None if one is missing, and the mask (B,) of those that the kernel evaluates."""
        states: list[tuple[Array, Array]] = []
        valid = np.ones(self.size, dtype=bool)
        for run, plant in enumerate(self._plants):
            with suppress(Exception):  # alone it raises the same error
                states.append(plant.actual())
            valid[run] = len(states) == run + 1
            states += [(states[0] if states else (_EMPTY, _EMPTY))] * (run + 1 - len(states))
        if not valid.all():
            return None, valid
        q, v = (np.array(each) for each in zip(*states, strict=True))
        found = compiled_states(self.reduced, q, v)
        if found is None:
            valid[:] = [compiled_states(self.reduced, *each) is not None for each in zip(q, v, strict=True)]
        return found, valid if found is not None or not valid.all() else ~valid

    @property
    def models(self) -> list[ReducedModel]:
        """Model of each plant."""
        return [cast(ReducedModel, plant.reduced) for plant in self._plants]

    @property
    def integrals(self) -> Array:
        """Integrals that the plants know: none."""
        return np.zeros((self.size, self.reduced.r))

    @property
    def work(self) -> Array:
        """Work (B,) done on the plants."""
        return np.array([plant.work for plant in self._plants])

    @property
    def external(self) -> list[Array | None]:
        """Generalized forces (nv,) of each run in addition to the inputs that the loop knows."""
        return [plant.external for plant in self._plants]

    def apply(self, T: Array) -> None:
        """Hold the inputs T (B, p) that pass the faults of the actuators."""
        for run, (plant, own) in enumerate(zip(self._plants, T, strict=True)):
            plant.plant.apply(own)
            self.applied[run] = getattr(plant.plant, "applied", own)

    def advance(self, dt: float) -> None:
        """Advance all plants by a time dt [s]."""
        for run, plant in enumerate(self._plants):
            try:
                plant.advance(dt)
            except Exception:  # alone it raises the same error
                self.failed[run] = True

    def errors_of(self, run: int) -> IntegrationErrors:
        """Return the estimated errors of the integration of one run since its start."""
        return cast(IntegrationErrors, self._plants[run].errors)

    def checkpoint(self, run: int) -> None:
        """Return nothing: the plant of a run is at its state."""

    def keep(self, runs: Array) -> None:
        """Keep only the runs of a mask (B,)."""
        self._plants, self.failed, self.applied = (
            list(compress(self._plants, runs)),
            self.failed[runs],
            self.applied[runs],
        )
        self.size = len(self._plants)


def compiled_states(reduced: ReducedModel, q: Array, v: Array) -> StateEvaluation | None:
    """States (..., nq), (..., nv) if the kernel evaluates all of them, else None."""
    try:
        found = reduced.at(q, v=v)
    except RncError:  # of one state, whose run raises it alone
        return None
    filled = found.arrays_at_v
    return found if isinstance(filled, CompiledArraysAtV) and filled.rates is not None else None


class FaultyRuns:
    """Runs on a ``FaultyPlant`` each, over plants that advance together.

    Args:
        runs: runs before their first sample.
        plants: the plants without their faults.
        dt: sampling period [s].
        samples: number of samples.

    Attributes:
        applied: inputs (B, p) that the loops know.
        apart: mask (B,) of the runs whose last measurement was invalid; their own loops take the next sample.
    """

    def __init__(
        self, runs: Sequence[SampledRun], plants: ReducedPlantBatch | SeparatePlants, dt: float, samples: int
    ) -> None:
        self._dt = dt
        self._runs, self._plants, self._reduced = list(runs), plants, plants.reduced
        self._faulty = [run.plant for run in runs if isinstance(run.plant, FaultyPlant)]
        faults = [each.faults for each in self._faulty]
        self._effort = np.array([[each.effort] for each in faults])
        self._dead_zone = np.array([[each.dead_zone] for each in faults])
        self._time = 0.0
        self.readings: list[Reading | None] = [None] * len(runs)
        self._together = runs[0].loop.guard.measures_velocity
        self._valid_q: Array | None = None
        self._motions: list[VelocityEstimate | None] = []
        self._last: _LastSample | None = None
        self._last_time = 0.0
        self.apart = np.zeros(len(runs), dtype=bool)
        self.applied = self._passed = np.zeros((len(runs), self._reduced.p))
        self._v_measured = list(np.full((len(runs), samples, self._reduced.n), np.nan))

    # ------------------------------------------------------------------ a sample

    def read(self, t: float, states: StateEvaluation) -> tuple[StateEvaluation, Array, Array, Array]:
        """Take a measurement of true states (B,) at time t [s], once a sample.

        Returns:
            The states that the loops see, true ones of the runs apart; the integrals (B, r) of their reducing
            velocities; the mask (B,) of invalid measurements of other runs, and that of the runs which need the
            formulas of a single state.
        """
        due = [run for run, reading in enumerate(self.readings) if reading is None]
        if due:
            found = sensed_together([self._faulty[run] for run in due], states.q[due], states.v[due] + 0.0)
            for run, reading in zip(due, found, strict=True):
                self.readings[run] = reading
        q, v = (np.array(each) for each in zip(*cast("list[Reading]", self.readings), strict=True))
        invalid, self._motions = np.zeros(len(q), dtype=bool), [None] * len(q)
        if self._together:
            q, valid = self._runs[0].loop.guard.check_runs(self._valid_q, t - self._last_time, q, v)
            invalid = ~valid & ~self.apart
        else:
            for run in np.flatnonzero(~self.apart).tolist():
                loop = self._runs[run].loop
                try:
                    q[run], v[run], self._motions[run] = loop.guard.check(loop.state, t, q[run], v[run])
                except InvalidMeasurementError:
                    invalid[run] = True
        unseen = invalid | self.apart
        q[unseen], v[unseen] = states.q[unseen], states.v[unseen]
        self._seen_q, failed = q, np.zeros(len(q), dtype=bool)
        seen = compiled_states(self._reduced, q, v)
        if seen is None:
            failed[:] = [compiled_states(self._reduced, *each) is None for each in zip(q, v, strict=True)]
            return states, self._plants.integrals, invalid, failed if failed.any() else ~failed
        if self._last is None:
            return seen, np.zeros(seen.v2.shape), invalid, failed
        before, dt = self._last.measurement.v2, t - self._last_time
        return seen, trapezoid(self._last.integrals, dt, before, seen.v2), invalid, failed

    def apply(self, T: Array) -> None:
        """Apply inputs (B, p) with actuator faults; ``applied`` has those that the loops know."""
        known, self._passed = transmitted(T, self._effort, self._dead_zone)
        self._plants.apply(self._passed)
        self.applied = known + (self._plants.applied - self._passed)
        if isinstance(self._plants, SeparatePlants):
            for faulty, applied, passed in zip(self._faulty, self.applied, self._passed, strict=True):
                faulty.resume(self._time, applied, passed, None)

    def keep_sample(
        self, sample: int, measurement: Measurement, integrals: Array, command: Command, requested: Array
    ) -> None:
        """Complete a sample: write what the sensors told, and keep what the loops need in the next one.

        Args:
            sample: number of the sample.
            measurement: measurement of all runs.
            integrals: integrals (B, r) of the reducing velocities.
            command: commands of all runs.
            requested: requested inputs (B, p).
        """
        t = sample * self._dt
        self._last, self._last_time = _LastSample(measurement, command, requested, integrals), t
        self._valid_q = self._seen_q
        if not self._together:
            for run in np.flatnonzero(~self.apart).tolist():
                self._runs[run].loop.state = LoopState(0.0, t, self._valid_q[run], motion=self._motions[run])
        for each, rows, reading in zip(self._runs, self._v_measured, self.readings, strict=True):
            rows[sample] = cast(Reading, reading)[1]
            if sample == 0:
                each.record.arrays["v_measured"] = rows
        self.readings = [None] * len(self._runs)

    def rejoin(self, runs: Sequence[int]) -> None:
        """Let runs apart, whose loops took a valid measurement in this sample, go on with the others."""
        if not runs:
            return
        last = cast(_LastSample, self._last)
        decisions = [cast(Decision, self._runs[run].loop.last) for run in runs]
        measurement = with_rows(last.measurement, runs, [each.measurement for each in decisions])
        command = with_rows(last.command, runs, [each.command for each in decisions])
        self._last = _LastSample(measurement, command, last.requested, last.integrals)
        for run in runs:
            cast(Array, self._valid_q)[run] = self._runs[run].loop.state.q
        self.apart[runs] = False

    def lost(self, q: Array) -> list[Array | None] | None:
        """Generalized forces (nv,) of each run at q (B, nq) that its dead zone takes; None without them."""
        differences = self._plants.applied - self.applied
        if isinstance(self._plants, SeparatePlants) or not differences.any():
            return None
        pairs = zip(self._faulty, q, differences, strict=True)
        return [each.lost(*where) if where[1].any() else None for each, *where in pairs]

    def advance(self) -> None:
        """Advance the time by a sample."""
        self._time += self._dt

    # ------------------------------------------------------------------ runs that leave

    def leave(self, place: int, state: LoopState) -> LoopState:
        """Let a run go on alone; return the state of its loop.

        Args:
            place: index of the run.
            state: state of the loop without its measurement.
        """
        self._faulty[place].resume(self._time, self.applied[place], self._passed[place], self.readings[place])
        if self.apart[place]:
            return self._runs[place].loop.state
        if self._last is None:
            return state
        loop, T, last = self._runs[place].loop, self.applied[place], self._last.of_runs(place)
        if self._together:
            loop.state = LoopState(0.0, self._last_time, cast(Array, self._valid_q)[place])
        measurement = last.measurement
        seen = self._reduced.at(measurement.q, v=measurement.v)
        loop.last = Decision(self._last_time, seen, measurement, last.command, last.requested, T)
        own = {"T": T, "input_deficit": state.input_deficit, "controller": state.controller}
        return loop.state._replace(v2=measurement.v2, integrals=last.integrals, **own)

    def keep(self, staying: Array) -> None:
        """Keep only the runs of a mask (B,)."""
        for name in ("_runs", "_faulty", "readings", "_motions", "_v_measured"):
            setattr(self, name, list(compress(getattr(self, name), staying)))
        self._valid_q = None if self._valid_q is None else self._valid_q[staying]
        for name in ("_effort", "_dead_zone", "applied", "_passed", "apart"):
            setattr(self, name, getattr(self, name)[staying])
        self._last = None if self._last is None else self._last.of_runs(staying)
