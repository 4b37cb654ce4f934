"""Compiled kernel of a reduction: its tables, and the records that it fills; ``_kernel/kernel.c`` has the formulas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy import ndarray as Array

from rnc_pin.math.components import Component
from rnc_pin.model.kernel_tables import RowTable, blocks_valued_by_python, kernel_evaluator
from rnc_pin.model.reduction_data import ReductionData


class ReductionKernel:
    """Kernel for the rows, outputs and actuators of a reduction.

    Args:
        data: the reduction.

    Raises:
        ValueError: Pinocchio's data have a memory layout that the kernel does not know.

    Attributes:
        calls: evaluator of the library; each call returns False or None if NumPy has to evaluate the states.
        external, external_vertical: blocks of E and of J1 that Python evaluates.
        python_rows: True if there are some.
        python_values: blocks of reducing and of vertical outputs whose values Python evaluates.
        measures: True if one call evaluates all rows and values.
        fused: True if the kernel knows all rows of E, all inputs and all forces.
        kinematics, inverse, rows, biases, rates, terms, derivatives, measured: types of records.
    """

    def __init__(self, data: ReductionData) -> None:
        self.data = data
        table = self._table = RowTable(data)
        self.external, self.external_vertical = table.external, table.external_vertical
        self.python_rows = bool(table.external or table.external_vertical)
        self.has_inputs, self.fused = data.actuation.parts is not None, table.fused
        self.calls = kernel_evaluator(data, table, np.array(table.rates) if data.affine else None)
        self._time: float | None = None  # of the rates in the library's object
        if table.driven and data.kinematics.time is not None:
            self.calls.set_rates(self.rates_over_time([data.kinematics.time]))
        n, r, k, p = data.n, data.r, data.vertical.size, data.p
        kinematics = {"M": (n, n), "J": (6, n), "placements": (data.robot.model.njoints, 12)}
        inverse = {"E": (n, n), "E_inverse": (n, n)}
        rows = {"J1": (k, n), "A_star": (k, r)}
        biases = {"nonlinear_effects": (n,), "gamma": (n,), "E_inverse_gamma": (n,), "motion_force": (n,), "H": (r, r)}
        velocities = {"row_velocities": (n,), "v1": (k,)}
        rates = {"E_dot": (n, n), "R_dot": (n, r), **rows, "J1_dot": (k, n), "A_star_dot": (k, r), **velocities}
        coriolis = {"C": (n, n), "V": (r, r), "g": (n,), "G": (r,)}
        forces = {"bias": (n,), "H": (r, r), "B": (n, p), "input_matrix": (r, p), "b": (n,), "b_dot": (n,)}
        self.kinematics, self.inverse, self.rows = _record(kinematics), _record(inverse), _record(rows)
        self.biases, self.rates = _record(biases), _record(rates)
        self.terms = _record({**kinematics, **inverse, "v": (n,), **rates, **coriolis, **forces})
        by = {"v_q": (n, n), "v_v2": (n, r), "v2_dot_q": (r, n), "v2_dot_v2": (r, r), "v2_dot_T": (r, p)}
        self.derivatives = _record({"v": (n,), "v2_dot": (r,), **by})
        stages = {"kinematics": self.kinematics, "inverse": self.inverse, "rates": self.rates}
        self.measured = np.dtype([*stages.items(), ("x2", float, (r,)), ("x1", float, (k,))])

        self.python_values = tuple(
            blocks_valued_by_python(stack, data.robot.model) for stack in (data.reducing, data.vertical)
        )
        self.measures = not (self.python_rows or any(self.python_values))

    def refresh(self) -> None:
        """Read the numbers of the constraint rows again, after a parameter of one changed."""
        self._table.read_constraints()
        self.calls.set_numbers(self._table.numbers)

    def rates_over_time(self, times: Sequence[float]) -> Array:
        """Right-hand sides mu at times (s,), then their rates over time, (s, 2, m); zero for moving ground."""
        found = np.zeros((len(times), 2, self.data.m))
        found[:, 0] = self._table.rates
        for t, rates in zip(times, found, strict=True):
            for place in self._table.driven:
                for rate, values in zip(rates, place.block.rates_over_time(t), strict=True):
                    rate[place.where] = place.of(values)
        return found

    def rates_between(self, times: Array) -> Array:
        """``rates_over_time`` for a call that sets them itself."""
        self._time = None
        return self.rates_over_time(times.tolist())

    def drift(self, t: Component | None, batch: tuple[int, ...]) -> Array | None:
        """Rates of mu over time at states (...), (..., m); None for constraints that do not depend on time."""
        if t is None or not self._table.driven:
            return None
        rates = self.rates_over_time(np.ravel(t).tolist())[:, 1].reshape(*np.shape(t), -1)
        return np.ascontiguousarray(np.broadcast_to(rates, (*batch, self.data.m)))

    def set_time(self, t: object) -> bool:
        """Use the rates of constraints over time at t in later calls; False without one time for all states."""
        if not self.data.rheonomic:
            return True
        if not isinstance(t, float | int | np.floating) or not self.data.affine:
            return False
        if t != self._time:
            self.calls.set_rates(self.rates_over_time([float(t)]))
            self._time = float(t)
        return True


def _record(fields: Mapping[str, tuple[int, ...]]) -> np.dtype[np.void]:
    """Type of a record of arrays, one after the other."""
    return _record_type(tuple(fields.items()))


@lru_cache(maxsize=256)  # NumPy takes long to make one, and each chart of a run has the same
def _record_type(fields: tuple[tuple[str, tuple[int, ...]], ...]) -> np.dtype[np.void]:
    return np.dtype([(name, float, shape) for name, shape in fields])
