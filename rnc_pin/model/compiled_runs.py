"""Calls of the compiled kernel for runs side by side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.model.evaluator import Evaluator
from rnc_pin.model.reduction_kernel import ReductionKernel, RunRecords
from rnc_pin.model.state_evaluation import StateEvaluation


class RunStarts(NamedTuple):
    """States and inputs of B runs at the start of a step."""

    q: Float[Array, "B nq"]
    y: Float[Array, "B s"]
    T: Float[Array, "B p"]
    kinematics: Array | None = None
    """Records of kinematics at q, if known."""


class Dissipation(NamedTuple):
    """Damping and dry friction of B runs."""

    damping: Float[Array, " nv"] | None
    """Viscous coefficients; None for zero."""
    joints: Float[Array, " j"]
    """Entries of v with dry friction."""
    limits: Float[Array, "B k"]
    """Limits of the friction of these joints, then of the inputs if they have friction."""


class CompiledRuns:
    """Kernel of a reduction, for runs side by side. All arrays are contiguous floats.

    Args:
        evaluator: evaluator of the reduction in which the runs are measured.
        kernel: its kernel.

    Attributes:
        chart: object that ``CompiledRuns`` of another reduction take for a chart in this one.
        kinematics_size: numbers in a record of kinematics.
    """

    def __init__(self, evaluator: Evaluator, kernel: ReductionKernel) -> None:
        self._evaluator, self._kernel = evaluator, kernel
        self.chart = self._calls = kernel.calls
        self.kinematics_size = self._kernel.measured_sizes[0]

    def velocities(
        self, charts: tuple[object, ...], q: Array, y: Array, limit: float, kinematics: Array, v: Array, status: Array
    ) -> None:
        """Full velocities of B runs in their charts, and kinematics of all; as ``admissible_velocity``.

        Args:
            charts: ``chart`` of each run.
            q: configurations (B, nq).
            y: states (B, s) that start with the velocities of the charts.
            limit: sum of the squares of R from which a run is left out.
            kinematics: result: records of kinematics (B, ``kinematics_size``).
            v: result: full velocities (B, nv).
            status: result (B,): 1 where v is valid, 0 where the run takes its own path.
        """
        sizes = np.empty(len(q))
        self._calls.admissible_velocities(charts, q, y, None, kinematics, v, sizes)
        status[:] = sizes < limit

    def integrate(
        self, charts: tuple[object, ...], start: RunStarts, h: float, steps: int, losses: Dissipation | None = None
    ) -> tuple[Array, Array, Array, Array]:
        """States (B, nq) and (B, s) after equal steps, status (B,), roughness (B,), which may be infinite with losses.

        Args:
            charts: as for ``velocities``.
            start: states and inputs at the start.
            h: duration of each step [s].
            steps: number of steps.
            losses: damping and dry friction, as ``DissipativeStep.advance``; None for Runge-Kutta steps without them.
        """
        return self._integrated(charts, start, (h, steps), losses, np.empty_like(start.y))

    def friction(
        self, charts: tuple[object, ...], start: RunStarts, h: float, losses: Dissipation
    ) -> tuple[Array, Array]:
        """Generalized forces (B, nv) of dry friction during a step, and status (B,); arguments as of ``integrate``."""
        found = np.empty((len(charts), self._kernel.data.n))
        return self._integrated(charts, start, (h, 0), losses, found)[1:3]

    def _integrated(
        self,
        charts: tuple[object, ...],
        start: RunStarts,
        steps: tuple[float, int],
        losses: Dissipation | None,
        y_end: Array,
    ) -> tuple[Array, Array, Array, Array]:
        q, y, T, kinematics = start
        found = np.empty_like(q), y_end, np.zeros(len(q)), np.zeros(len(q))
        self._calls.integrate(charts, q, y, T, *steps, kinematics, *found, None, *(losses or (None, None, None)))
        return found

    def measure(self, q: Array, v: Array, kinematics: Array, status: Array) -> RunRecords:
        """Quantities of states (q, v) with records of kinematics.

        Only runs with status 1 are measured; the status becomes 0 where the run takes its own path.

        Args:
            q: configurations (B, nq).
            v: full velocities (B, nv).
            kinematics: records of kinematics at q.
            status: result (B,), and which runs are measured.
        """
        found = self._kernel.run_records(q.shape[:-1], kinematics)
        self._calls.measure(q, v, *found, status, True)
        return found

    def states(self, q: Array, v: Array, records: RunRecords) -> StateEvaluation:
        """Evaluation at states (..., nq), (..., nv) from their records, which nobody may change afterwards.

        Args:
            q: configurations (..., nq).
            v: full velocities (..., nv) [rad/s or m/s].
            records: their records.
        """
        return self._evaluator.filled_state(self._kernel, q, v, records)


def runs_of(evaluator: Evaluator) -> CompiledRuns | None:
    """Calls of the kernel for many runs; None where each run has to take its own path.

    Args:
        evaluator: evaluator of the reduction in which runs are measured.
    """
    kernel = evaluator.kernel
    return None if kernel is None or evaluator.data.rheonomic else CompiledRuns(evaluator, kernel)
