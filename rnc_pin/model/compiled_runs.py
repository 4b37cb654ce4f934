"""Calls of the compiled kernel over many runs, each with the bits of a run alone."""

from __future__ import annotations

import numpy as np
from numpy import ndarray as Array

from rnc_pin.model.compiled import CompiledConfiguration, CompiledReduction, CompiledState


def evaluator_of(reduction: CompiledReduction | None) -> object:
    """Evaluator of a reduction, for calls over many runs; None without the kernel."""
    return None if reduction is None else reduction._evaluator


class CompiledRuns:
    """Kernel of a reduction, for runs side by side. All arrays are contiguous floats.

    Args:
        reduction: kernel of the reduction in which the runs are measured.

    Attributes:
        kinematics_size: numbers in a record of kinematics.
        measured_size: numbers in a record of ``measure``; it starts with the kinematics.
    """

    def __init__(self, reduction: CompiledReduction) -> None:
        self._reduction, self._evaluator = reduction, reduction._evaluator
        self.kinematics_size = reduction.kinematics.itemsize // 8
        self.measured_size = reduction._measured.itemsize // 8

    def velocities(
        self, charts: tuple[object, ...], q: Array, y: Array, limit: float, records: Array, v: Array, status: Array
    ) -> None:
        """Full velocities of B runs in their charts, and kinematics of all; as ``admissible_velocity``.

        Args:
            charts: evaluator of each run; None for runs without one.
            q: configurations (B, nq).
            y: states (B, s) that start with the velocities of the charts.
            limit: sum of the squares of R from which a run is left out.
            records: result: rows (B, ...) that start with the record of kinematics.
            v: result: full velocities (B, nv).
            status: result (B,): 1 where v is valid, 0 where the other path has to decide.
        """
        self._evaluator.velocities_of_runs(charts, q, y, limit, records, v, status)

    def measure(self, q: Array, v: Array, records: Array, status: Array) -> None:
        """Complete the records (B, ``measured_size``) of states (q, v) from their kinematics.

        Only runs with status 1 are measured; the status becomes 0 where the other path has to decide.
        """
        self._evaluator.measure_runs(q, v, records, status)

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
            kinematics: rows (B, ...) that start with the record of kinematics at q, if known.
        """
        q_end, y_end, status = np.empty_like(q), np.empty_like(y), np.zeros(len(q))
        self._evaluator.integrate_runs(charts, q, y, T, h, steps, kinematics, q_end, y_end, status)
        return q_end, y_end, status

    def place(self, q: Array, record: Array) -> None:
        """Write the kinematics at one configuration (nq,) to the start of a record."""
        numbers, inverse = np.empty(self.kinematics_size), np.empty(self._reduction.inverse.itemsize // 8)
        self._evaluator.configure(q, numbers, inverse, None, False)
        record[: len(numbers)] = numbers

    def states(self, q: Array, v: Array, records: Array) -> tuple[CompiledState, Array, Array]:
        """States (B, ...) from records of ``measure``, and their values x1 and x2, read-only."""
        records.setflags(write=False)
        found = np.ndarray(q.shape[:-1], self._reduction._measured, records)
        at = CompiledConfiguration(self._reduction, q, None, found["kinematics"], found["inverse"])
        state = CompiledState(at, v, None)
        state.rates = found["rates"]
        return state, found["x1"], found["x2"]
