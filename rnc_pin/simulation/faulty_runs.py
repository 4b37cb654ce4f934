"""Sensors, loops and actuators of runs with faults that advance in lock-step.

Noise, delays and the checks of a loop are those of the plant and of the loop of each run. The states that the loops see
are evaluated together.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import NamedTuple, cast

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import Command, Runs
from rnc_pin.control.loop import Decision, LoopState
from rnc_pin.control.loop.control_loop import trapezoid
from rnc_pin.control.loop.measurements import InvalidMeasurementError, ValidMeasurement
from rnc_pin.errors import RncError
from rnc_pin.model.compiled_states import CompiledArraysAtV
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.faults import FaultyPlant, Reading, transmitted
from rnc_pin.plants.reduced import ReducedPlantBatch
from rnc_pin.simulation.sampled_run import SampledRun


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


class FaultyRuns:
    """Runs on a ``FaultyPlant`` each, over plants that advance together.

    Args:
        runs: runs before their first sample.
        plants: the plants without their faults.
        dt: sampling period [s].
        samples: number of samples.

    Attributes:
        applied: inputs (B, p) that the loops know.
    """

    def __init__(self, runs: Sequence[SampledRun], plants: ReducedPlantBatch, dt: float, samples: int) -> None:
        self._dt = dt
        self._runs, self._plants, self._reduced = list(runs), plants, plants.reduced
        self._faulty = [run.plant for run in runs if isinstance(run.plant, FaultyPlant)]
        faults = [each.faults for each in self._faulty]
        self._effort = np.array([[each.effort] for each in faults])
        self._dead_zone = np.array([[each.dead_zone] for each in faults])
        self._time = 0.0
        self._readings: list[Reading | None] = [None] * len(runs)
        self._valid: list[ValidMeasurement] = []
        self._last: _LastSample | None = None
        self._last_time = 0.0
        self.applied = self._passed = np.zeros((len(runs), self._reduced.p))
        self._v_measured = list(np.full((len(runs), samples, self._reduced.n), np.nan))

    # ------------------------------------------------------------------ a sample

    def read(self, t: float, states: StateEvaluation) -> tuple[StateEvaluation, Array, Array]:
        """Take a measurement of true states (B,) at time t [s], once a sample.

        Returns:
            The states that the loops see, the integrals (B, r) of their reducing velocities, and the mask (B,) of the
            runs whose measurement is invalid or needs the formulas of a single state. With one of these, the states are
            the true ones.
        """
        failed = np.zeros(len(self._runs), dtype=bool)
        for run, reading in enumerate(self._readings):
            if reading is None:
                self._readings[run] = self._faulty[run].sensed(states.q[run], states.v[run] + 0.0)
        self._valid = []
        for run, reading in enumerate(self._readings):
            assert reading is not None
            loop = self._runs[run].loop
            try:
                self._valid.append(loop.guard.check(loop.state, t, *reading))
            except InvalidMeasurementError:
                failed[run] = True
        if failed.any():
            return states, self._plants.integrals, failed
        q, v = (np.array([getattr(each, name) for each in self._valid]) for name in ("q", "v"))
        seen = self._compiled(q, v)
        if seen is None:
            failed[:] = [self._compiled(*each) is None for each in zip(q, v, strict=True)]
            return states, self._plants.integrals, failed if failed.any() else ~failed
        return seen, self._integrals(t, seen.v2), failed

    def _compiled(self, q: Array, v: Array) -> StateEvaluation | None:
        """States (..., nq), (..., nv) if the kernel evaluates all of them, else None."""
        try:
            found = self._reduced.at(q, v=v)
        except RncError:  # of one state, whose run raises it alone
            return None
        filled = found.arrays_at_v
        return found if isinstance(filled, CompiledArraysAtV) and filled.rates is not None else None

    def _integrals(self, t: float, v2: Array) -> Array:
        if self._last is None:
            return np.zeros(v2.shape)
        return trapezoid(self._last.integrals, t - self._last_time, self._last.measurement.v2, v2)

    def apply(self, T: Array) -> None:
        """Apply inputs (B, p) with actuator faults; ``applied`` has those that the loops know."""
        known, self._passed = transmitted(T, self._effort, self._dead_zone)
        self._plants.apply(self._passed)
        self.applied = known + (self._plants.applied - self._passed)

    def keep_sample(
        self, sample: int, q: Array, measurement: Measurement, integrals: Array, command: Command, requested: Array
    ) -> None:
        """Complete a sample: write what the sensors told, and keep what the loops need in the next one.

        Args:
            sample: number of the sample.
            q: true configurations (B, nq).
            measurement: measurement of all runs.
            integrals: integrals (B, r) of the reducing velocities.
            command: commands of all runs.
            requested: requested inputs (B, p).
        """
        t = sample * self._dt
        self._last, self._last_time = _LastSample(measurement, command, requested, integrals), t
        differences = self._plants.applied - self.applied
        for run, (each, valid) in enumerate(zip(self._runs, self._valid, strict=True)):
            each.loop.state = LoopState(0.0, t, valid.q, motion=valid.motion)
            reading = self._readings[run]
            assert reading is not None
            self._v_measured[run][sample] = reading[1]
            each.record.arrays["v_measured"] = self._v_measured[run]
        for run in np.flatnonzero(differences.any(axis=1)).tolist():
            record = self._runs[run].record
            record.written(sample)
            record.moves(self._reduced, self._faulty[run].lost(q[run], differences[run]))
        self._readings = [None] * len(self._runs)

    def slipping(self) -> Array:
        """Mask (B,) of the runs that slip against their constraints until the next sample."""
        return np.array([each.faults.slips(self._time) for each in self._faulty])

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
        self._faulty[place].resume(self._time, self.applied[place], self._passed[place], self._readings[place])
        if self._last is None:
            return state
        loop, T, last = self._runs[place].loop, self.applied[place], self._last.of_runs(place)
        measurement = last.measurement
        seen = self._reduced.at(measurement.q, v=measurement.v)
        loop.last = Decision(self._last_time, seen, measurement, last.command, last.requested, T)
        own = {"T": T, "input_deficit": state.input_deficit, "controller": state.controller}
        return loop.state._replace(v2=measurement.v2, integrals=last.integrals, **own)

    def keep(self, staying: Array) -> None:
        """Keep only the runs of a mask (B,)."""
        for name in ("_runs", "_faulty", "_readings", "_valid", "_v_measured"):
            setattr(self, name, list(compress(getattr(self, name), staying)))
        for name in ("_effort", "_dead_zone", "applied", "_passed"):
            setattr(self, name, getattr(self, name)[staying])
        self._last = None if self._last is None else self._last.of_runs(staying)
