"""Compiled evaluation of a reduction; ``rnc_pin/_kernel/kernel.c`` has the formulas.

The kernel evaluates one state or a loop of states into records, and declines if a row is undefined, E is singular, or
other constraint rows have to be considered. Then the formulas of ``configuration_evaluation`` and ``state_evaluation``
decide. They are also the reference: ``kernel_comparison`` compares both before a reduction uses the kernel, and
``kernel_tables`` makes the tables that the kernel reads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy import ndarray as Array

from rnc_pin.math.components import Component
from rnc_pin.model.compiled_states import CompiledConfiguration, CompiledState, concatenated, empty_records
from rnc_pin.model.kernel_tables import RowTable, blocks_valued_by_python, kernel_evaluator
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.result_types import ReducedTerms

if TYPE_CHECKING:
    from rnc_pin.model.reduction_data import ReductionData


class UsesKernel:
    """Owner of properties ``compiled...`` or ``_compiled...`` that refer to memory, which copies and pickles omit."""

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if not name.lstrip("_").startswith("compiled")}


class CompiledReduction:
    """Kernel for the rows, outputs and actuators of a reduction.

    Args:
        data: the reduction.

    Raises:
        ValueError: Pinocchio's data have a memory layout that the kernel does not know.
    """

    def __init__(self, data: ReductionData) -> None:
        self._data = data
        table = self._table = RowTable(data)
        self.external, self.external_vertical = table.external, table.external_vertical
        self.python_rows = bool(table.external or table.external_vertical)
        """True if Python evaluates rows of E or of J1."""
        parts = data.actuation.parts
        self.has_inputs, self.fused = parts is not None, table.fused
        mu = np.array(table.rates) if data.affine else None
        self._evaluator = kernel_evaluator(data, table, mu)
        self._time: float | None = None  # of the rates in the evaluator
        if table.driven and data.kinematics.time is not None:
            self._evaluator.set_rates(self.rates_over_time([data.kinematics.time]))
        self.forward_dynamics: Callable[[object, object, object], Array | None] = self._evaluator.forward_dynamics
        """Reduced accelerations for q, v2 and T; None if the arrays or the state need the other path.

        Call ``set_time`` before, if the constraints depend on time."""
        self.inverse_dynamics: Callable[[object, object, object], Array | None] = self._evaluator.inverse_dynamics
        """Reduced forces for q, v2 and v2_dot, in the same way."""
        n, r, k, p = data.n, data.r, data.vertical.size, data.p
        kinematics = {"M": (n, n), "J": (6, n), "placements": (data.robot.model.njoints, 12)}
        inverse = {"E": (n, n), "E_inverse": (n, n)}
        rows = {"J1": (k, n), "A_star": (k, r)}
        biases = {"bias": (n,), "gamma": (n,), "E_inverse_gamma": (n,), "unforced": (n,), "H": (r, r)}
        velocities = {"velocities": (n,), "v1": (k,)}
        rates = {"E_dot": (n, n), "R_dot": (n, r), **rows, "J1_dot": (k, n), "A_star_dot": (k, r), **velocities}
        coriolis = {"C": (n, n), "V": (r, r), "g": (n,), "G": (r,)}
        forces = {"bias": (n,), "H": (r, r), "B": (n, p), "input_matrix": (r, p), "b": (n,), "b_dot": (n,)}
        self.kinematics, self.inverse, self.rows = _record(kinematics), _record(inverse), _record(rows)
        self.biases, self.rates = _record(biases), _record(rates)
        self._terms = _record({**kinematics, **inverse, "v": (n,), **rates, **coriolis, **forces})
        by = {"v_q": (n, n), "v_v2": (n, r), "v2_dot_q": (r, n), "v2_dot_v2": (r, r), "v2_dot_T": (r, p)}
        self._derivatives = _record({"v": (n,), "v2_dot": (r,), **by})
        stages = {"kinematics": self.kinematics, "inverse": self.inverse, "rates": self.rates}
        self._measured = np.dtype([*stages.items(), ("x2", float, (r,)), ("x1", float, (k,))])

        self.python_values = tuple(
            blocks_valued_by_python(stack, data.robot.model) for stack in (data.reducing, data.vertical)
        )
        """Blocks of reducing and of vertical outputs whose values Python evaluates."""
        self.measures = not (self.python_rows or any(self.python_values))
        """True if ``measure`` evaluates all rows and values."""

    def refresh(self) -> None:
        """Read the numbers of the constraint rows again, after a parameter of one changed."""
        self._table.read_constraints()
        self._evaluator.set_numbers(self._table.numbers)

    def configuration(
        self, q: Array, position: PositionKinematics | None, kinematics: Array | None = None
    ) -> CompiledConfiguration | None:
        """Evaluation at configurations (..., nq); None if the other path has to evaluate them.

        Args:
            q: configurations, contiguous.
            position: kinematics at q; None if ``python_rows`` is False.
            kinematics: kinematics record at q, if known.
        """
        external = concatenated(self.external, lambda block: block.jacobian(position), -2)
        known = kinematics is not None
        record = empty_records(q.shape[:-1], self.kinematics) if kinematics is None else kinematics
        inverse = empty_records(q.shape[:-1], self.inverse)
        if not self._evaluator.configure(q, record, inverse, external, known):
            return None
        return CompiledConfiguration(self, q, position, record, inverse)

    def rates_over_time(self, times: Sequence[float]) -> Array:
        """Right-hand sides mu at times (s,), then their rates over time, (s, 2, m); zero for moving ground."""
        found = np.zeros((len(times), 2, self._data.m))
        found[:, 0] = self._table.rates
        for t, rates in zip(times, found, strict=True):
            for place in self._table.driven:
                for rate, values in zip(rates, place.block.rates_over_time(t), strict=True):
                    rate[place.where] = place.of(values)
        return found

    def drift(self, t: Component | None, batch: tuple[int, ...]) -> Array | None:
        """Rates of mu over time at states (...), (..., m); None for constraints that do not depend on time."""
        if t is None or not self._table.driven:
            return None
        rates = self.rates_over_time(np.ravel(t).tolist())[:, 1].reshape(*np.shape(t), -1)
        return np.ascontiguousarray(np.broadcast_to(rates, (*batch, self._data.m)))

    def set_time(self, t: Component | None) -> bool:
        """Use the rates of constraints over time at t in later calls; False without one time for all states."""
        if not self._data.rheonomic:
            return True
        if t is None or np.ndim(t) or not self._data.affine:
            return False
        if t != self._time:
            self._evaluator.set_rates(self.rates_over_time([float(t)]))
            self._time = float(t)
        return True

    def measure(self, q: Array, v: Array, t: Component | None = None) -> tuple[CompiledState, Array, Array] | None:
        """State (q, v) with its rates, and values x1 and x2, in one call; None if the other path has to decide.

        Args:
            q, v: one configuration (nq,) and one velocity (nv,), contiguous floats.
            t: time for constraints that depend on it [s].
        """
        numbers = np.empty(self._measured.itemsize // 8)
        if not self._evaluator.measure(q, v, numbers):
            return None
        numbers.setflags(write=False)
        found = np.ndarray((), self._measured, numbers)
        at = CompiledConfiguration(self, q, None, found["kinematics"], found["inverse"])
        state = CompiledState(at, v, None, t)
        state.rates = found["rates"]
        return state, found["x1"], found["x2"]

    def output_slopes(self, q: Array, along: Array) -> Array | None:
        """Rates (..., s, k, r) of A_star in the motions of single reducing outputs; None if the other path decides.

        Args:
            q: configurations (nq,) or (B, nq).
            along: indices of the outputs (s,).
        """
        found = np.empty((*q.shape[:-1], len(along), self._data.vertical.size, self._data.r))
        return found if self._evaluator.output_slopes(q, along, found) else None

    def state_derivative(
        self,
        q: Array,
        v2: Array,
        T: Array,
        external: Array | None,
        damping: Array | None,
        t: float | None = None,
    ) -> tuple[Array, Array] | None:
        """Full velocity, and rates of v2, of the integrals of J1 v, of a time, and of the work.

        None if the other path decides.

        Args:
            q: one configuration (nq,); all arrays are contiguous floats.
            v2: reduced velocities (r,).
            T: actuator inputs (p,).
            external: generalized forces (nv,) in addition to inputs and damping; None for zero.
            damping: viscous coefficients (nv,); None for zero.
            t: time for constraints that depend on it [s].
        """
        n, r = self._data.n, self._data.r
        found = np.empty(n + r + self._data.vertical.size + 1 + self._data.rheonomic)
        if not self.set_time(t) or not self._evaluator.state_derivative(q, v2, T, external, damping, found):
            return None
        return found[:n], found[n:]

    def integrate(self, q: Array, y: Array, T: Array, h: float, steps: int) -> tuple[Array, Array] | None:
        """Configuration and y after equal Runge-Kutta steps; None if the other path has to decide.

        Args:
            q: configuration (nq,); all arrays are contiguous floats.
            y: reduced velocities v2, integrals of the rates of the vertical outputs, and work, (r + k + 1,). If the
                constraints depend on time, it comes before the work.
            T: actuator inputs (p,), constant.
            h: duration of each step [s].
            steps: number of steps.
        """
        found = np.empty(len(q) + len(y))
        rates = None
        if self._data.rheonomic and self.fused:
            rates = self.rates_over_time((y[-2] + 0.5 * h * np.arange(2 * steps + 1)).tolist())
            self._time = None
        if not self._evaluator.integrate(q, y, T, h, steps, rates, found):
            return None
        return found[: len(q)], found[len(q) :]

    def chart_rate(self, q: Array, x: Array, T: Array, damping: Array | None) -> Array | None:
        """Rates of local coordinates ``x = (u, y)`` at ``q (+) u``; None if the other path has to decide.

        Args:
            q: configuration (nq,) at the centre; all arrays are contiguous floats.
            x: coordinates u (nv,), then y as for ``integrate``.
            T: actuator inputs (p,).
            damping: viscous coefficients (nv,); None for zero.
        """
        found = np.empty(len(x))
        if not self.set_time(float(x[-2]) if self._data.rheonomic else None):
            return None
        return found if self._evaluator.chart_rate(q, x, T, damping, found) else None

    def admissible_velocity(self, q: Array, v2: Array, t: float | None = None) -> tuple[Array, float] | None:
        """Full velocity (nv,) at one state, and the sum of the squares of R; None if the other path has to decide."""
        found = np.empty(self._data.n + 1)
        if not self.set_time(t):
            return None
        return (found[:-1], found[-1]) if self._evaluator.admissible_velocity(q, v2, found) else None

    def state_derivatives(
        self, q: object, v2: object, T: object, t: Component | None = None
    ) -> Mapping[str, Array] | None:
        """Derivatives of ``analysis.derivatives`` at one state or a stack of states, by name, as read-only views.

        None if the arrays or the states need the other path.
        """
        numbers = self._evaluator.state_derivatives(q, v2, T) if self.set_time(t) else None
        if numbers is None:
            return None
        numbers.setflags(write=False)
        record = np.ndarray(numbers.shape[:-1], self._derivatives, numbers)
        return {name: record[name] for name in self._derivatives.names or ()}

    def terms(self, q: object, v2: object, t: Component | None = None) -> ReducedTerms | None:
        """All matrices at states (q, v2), as read-only views; None if the arrays or the states need the other path."""
        numbers = self._evaluator.terms(q, v2) if self.set_time(t) else None
        if numbers is None:
            return None
        numbers.setflags(write=False)
        record = np.ndarray(numbers.shape[:-1], self._terms, numbers)
        m = self._data.m
        terms = object.__new__(ReducedTerms)  # its own constructor takes as long as all matrices of a small system
        vars(terms).update(
            R=record["E_inverse"][..., m:],
            R_dot=record["R_dot"],
            H=record["H"],
            V=record["V"],
            G=record["G"],
            input_matrix=record["input_matrix"],
            A=record["E"][..., :m, :],
            A_dot=record["E_dot"][..., :m, :],
            A_star=record["A_star"],
            A_star_dot=record["A_star_dot"],
            v=record["v"],
            b=record["b"],
            b_dot=record["b_dot"],
        )
        return terms


def _record(fields: Mapping[str, tuple[int, ...]]) -> np.dtype[Any]:
    """Type of a record of arrays, one after the other."""
    return _record_type(tuple(fields.items()))


@lru_cache(maxsize=256)  # NumPy takes long to make one, and each chart of a run has the same
def _record_type(fields: tuple[tuple[str, tuple[int, ...]], ...]) -> np.dtype[Any]:
    return np.dtype([(name, float, shape) for name, shape in fields])
