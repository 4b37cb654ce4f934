"""Calls of the compiled kernel over many runs, each with the bits of a run alone."""

from __future__ import annotations

import numpy as np
from numpy import ndarray as Array

from rnc_pin.model.compiled_states import CompiledArraysAtQ, CompiledArraysAtV
from rnc_pin.model.evaluator import Evaluator
from rnc_pin.model.reduction_kernel import ReductionKernel
from rnc_pin.model.runs import NumPyRuns, RunRecords
from rnc_pin.model.state_evaluation import StateEvaluation


class CompiledRuns(NumPyRuns):
    """Kernel of a reduction, for runs side by side.

    Args:
        evaluator: evaluator of the reduction in which the runs are measured; ``kernel``: its kernel.
    """

    def __init__(self, evaluator: Evaluator, kernel: ReductionKernel) -> None:
        self._evaluator, self._kernel, self._calls = evaluator, kernel, kernel.calls
        self.kinematics_size = kernel.kinematics.itemsize // 8

    def velocities(
        self, charts: tuple[object, ...], q: Array, y: Array, limit: float, kinematics: Array, v: Array, status: Array
    ) -> None:
        self._calls.velocities_of_runs(charts, q, y, limit, kinematics, v, status)

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
        q_end, y_end, status = np.empty_like(q), np.empty_like(y), np.zeros(len(q))
        self._calls.integrate_runs(charts, q, y, T, h, steps, kinematics, q_end, y_end, status)
        return q_end, y_end, status

    def measure(self, q: Array, v: Array, kinematics: Array, status: Array) -> RunRecords:
        kernel, data = self._kernel, self._kernel.data
        if not kernel.measures:
            return super().measure(q, v, kinematics, status)
        sizes = kernel.inverse.itemsize // 8, kernel.rates.itemsize // 8, data.r + data.vertical.size
        found = [np.empty((len(q), size)) for size in sizes]
        self._calls.measure_runs(q, v, kinematics, *found, status)
        return RunRecords(kinematics, *found)

    def states(self, q: Array, v: Array, records: RunRecords) -> StateEvaluation:
        kernel, batch, r = self._kernel, q.shape[:-1], self._kernel.data.r
        for array in records:
            array.setflags(write=False)
        kinematics = np.ndarray(batch, kernel.kinematics, records.kinematics)
        inverse = np.ndarray(batch, kernel.inverse, records.inverse)
        values = records.values[..., r:], records.values[..., :r]
        at_q = CompiledArraysAtQ(kernel, q, None, kinematics, inverse, values)
        rates = np.ndarray(batch, kernel.rates, records.rates)
        return StateEvaluation.filled(self._evaluator, q, v, (at_q, CompiledArraysAtV(at_q, v, None, None, rates)))
