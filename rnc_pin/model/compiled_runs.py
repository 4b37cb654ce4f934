"""Calls of the compiled kernel over many runs, each with the bits of a run alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.model.compiled import CompiledReduction
from rnc_pin.model.compiled_states import CompiledConfiguration, CompiledState


def evaluator_of(reduction: CompiledReduction | None) -> object:
    """Evaluator of a reduction, for calls over many runs; None without the kernel."""
    return None if reduction is None else reduction._evaluator


class RunRecords(NamedTuple):
    """Quantities of states (..., size) each; rows of runs that were not measured are undefined."""

    kinematics: Array
    inverse: Array
    rates: Array
    values: Array
    """Values of the reducing outputs, then of the vertical ones."""

    def of(self, run: int) -> RunRecords:
        """Copy of one run."""
        return RunRecords(*(array[run].copy() for array in self))


class CompiledRuns:
    """Kernel of a reduction, for runs side by side. All arrays are contiguous floats.

    Args:
        reduction: kernel of the reduction in which the runs are measured.

    Attributes:
        kinematics_size: numbers in a record of kinematics.
    """

    def __init__(self, reduction: CompiledReduction) -> None:
        self._reduction, self._evaluator = reduction, reduction._evaluator
        self.kinematics_size = reduction.kinematics.itemsize // 8

    def velocities(
        self, charts: tuple[object, ...], q: Array, y: Array, limit: float, kinematics: Array, v: Array, status: Array
    ) -> None:
        """Full velocities of B runs in their charts, and kinematics of all; as ``admissible_velocity``.

        Args:
            charts: evaluator of each run; None for runs without one.
            q: configurations (B, nq).
            y: states (B, s) that start with the velocities of the charts.
            limit: sum of the squares of R from which a run is left out.
            kinematics: result: records of kinematics (B, ``kinematics_size``).
            v: result: full velocities (B, nv).
            status: result (B,): 1 where v is valid, 0 where the other path has to decide.
        """
        self._evaluator.velocities_of_runs(charts, q, y, limit, kinematics, v, status)

    def measure(self, q: Array, v: Array, kinematics: Array, status: Array) -> RunRecords:
        """Quantities of states (q, v) with records of kinematics.

        Only runs with status 1 are measured; the status becomes 0 where the other path has to decide.
        """
        reduction, count = self._reduction, len(q)
        sizes = reduction.inverse.itemsize // 8, reduction.rates.itemsize // 8
        values = reduction._data.r + reduction._data.vertical.size
        found = [np.empty((count, size)) for size in (*sizes, values)]
        self._evaluator.measure_runs(q, v, kinematics, *found, status)
        return RunRecords(kinematics, *found)

    def integrate(
        self,
        charts: tuple[object, ...],
        q: Array,
        y: Array,
        T: Array,
        h: float,
        steps: int,
        kinematics: Array | None,
    ) -> tuple[Array, Array, Array]:
        """States (B, nq) and (B, s) after equal Runge-Kutta steps, and status (B,); each as ``integrate``.

        Args:
            charts: evaluator of each run; None for runs without one.
            q, y, T: states (B, nq) and (B, s), and inputs (B, p).
            h: duration of each step [s].
            steps: number of steps.
            kinematics: records of kinematics at q, if known.
        """
        q_end, y_end, status = np.empty_like(q), np.empty_like(y), np.zeros(len(q))
        self._evaluator.integrate_runs(charts, q, y, T, h, steps, kinematics, q_end, y_end, status)
        return q_end, y_end, status

    def place(self, q: Array, record: Array) -> None:
        """Write the kinematics at one configuration (nq,) into a record."""
        numbers, inverse = np.empty(self.kinematics_size), np.empty(self._reduction.inverse.itemsize // 8)
        self._evaluator.configure(q, numbers, inverse, None, False)
        record[:] = numbers

    def states(self, q: Array, v: Array, records: RunRecords) -> tuple[CompiledState, Array, Array]:
        """States (...) from their records, and values x1 and x2, read-only."""
        reduction, batch = self._reduction, q.shape[:-1]
        for array in records:
            array.setflags(write=False)
        kinematics = np.ndarray(batch, reduction.kinematics, records.kinematics)
        inverse = np.ndarray(batch, reduction.inverse, records.inverse)
        state = CompiledState(CompiledConfiguration(reduction, q, None, kinematics, inverse), v, None)
        state.rates = np.ndarray(batch, reduction.rates, records.rates)
        r = reduction._data.r
        return state, records.values[..., r:], records.values[..., :r]
