"""Runs side by side in calls of an evaluator; without a compiled one, every run takes its own path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.errors import InputError
from rnc_pin.model.state_evaluation import StateEvaluation


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


class NumPyRuns:
    """Calls that leave every run to its own path: the status of each is 0. All arrays are contiguous floats.

    Attributes:
        kinematics_size: numbers in a record of kinematics.
    """

    kinematics_size = 0

    def velocities(
        self, charts: tuple[object, ...], q: Array, y: Array, limit: float, kinematics: Array, v: Array, status: Array
    ) -> None:
        """Full velocities of B runs in their charts, and kinematics of all; as ``admissible_velocity``.

        Args:
            charts: ``NumPyEvaluator.chart`` of each run.
            q: configurations (B, nq).
            y: states (B, s) that start with the velocities of the charts.
            limit: sum of the squares of R from which a run is left out.
            kinematics: result: records of kinematics (B, ``kinematics_size``).
            v: result: full velocities (B, nv).
            status: result (B,): 1 where v is valid, 0 where the run takes its own path.
        """
        status[:] = 0.0

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
            charts: as for ``velocities``.
            q, y, T: states (B, nq) and (B, s), and inputs (B, p).
            h: duration of each step [s].
            steps: number of steps.
            kinematics: records of kinematics at q, if known.
        """
        return q, y, np.zeros(len(q))

    def measure(self, q: Array, v: Array, kinematics: Array, status: Array) -> RunRecords:
        """Quantities of states (q, v) with records of kinematics.

        Only runs with status 1 are measured; the status becomes 0 where the run takes its own path.

        Raises:
            InputError: the evaluator cannot measure the model.
        """
        raise InputError("the compiled kernel cannot measure this model: measure one state at a time")

    def states(self, q: Array, v: Array, records: RunRecords) -> StateEvaluation:
        """Evaluation at states (..., nq), (..., nv) from their records, which become read-only."""
        raise InputError("the compiled kernel cannot measure this model: measure one state at a time")
