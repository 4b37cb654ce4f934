"""Compiled evaluator of a reduction.

The kernel evaluates one state or a loop of states into records, and declines if a row is undefined, E is singular, or
other constraint rows have to be considered. Then ``NumPyEvaluator`` decides. It is also the reference:
``evaluator_for`` compares both before a reduction uses the kernel.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.array_shapes import Float
from rnc_pin.errors import InputError, SingularityError
from rnc_pin.model.compiled_states import CompiledArraysAtQ, CompiledArraysAtV, concatenated, empty_records
from rnc_pin.model.evaluator import ArraysAtQ, ArraysAtV, Configurations, Evaluator, HasArraysAtQ, ReducedTerms, States
from rnc_pin.model.input_validation import ArrayInput, admit_numbers
from rnc_pin.model.kinematics import VelocityKinematics
from rnc_pin.model.numpy_evaluator import NumPyEvaluator, PlannedFeedback
from rnc_pin.model.reduction_data import ReductionData
from rnc_pin.model.reduction_kernel import ReductionKernel
from rnc_pin.model.state_evaluation import StateEvaluation

_TOLERANCE = 1e-9  # largest relative difference of kernel and NumPy at the state that compares them
_TIME = 0.3  # of rows over time [s]
_FORMS = ("kinematic", "acceleration", "dynamic")
_ATTEMPTS = 8  # random states that may be singular


class RunRecords(NamedTuple):
    """Quantities of states (..., size) each; rows of runs that were not measured are undefined."""

    kinematics: Array
    inverse: Array
    rates: Array
    values: Array
    """Values of the reducing outputs, then of the vertical ones."""


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


class CompiledEvaluator(NumPyEvaluator):
    """Evaluator that fills arrays by the compiled kernel.

    Args:
        data: the reduction.
        kernel: its kernel, which other evaluators of the same rows may share.
    """

    compiled = True

    def __init__(self, data: ReductionData, kernel: ReductionKernel) -> None:
        super().__init__(data)
        self.kernel, self._calls = kernel, kernel.calls
        self.measures, self._steady = kernel.measures, not data.rheonomic

    def __reduce__(self) -> tuple[object, ...]:
        return evaluator_for, (self.data,)  # the kernel refers to memory

    def rows_changed(self) -> None:
        super().rows_changed()
        self.kernel.refresh()

    # ------------------------------------------------------------------ arrays

    def fill_at_q(self, at: Configurations, same: HasArraysAtQ | None) -> ArraysAtQ:
        kernel, kinematics = self.kernel, None
        position = at.position if kernel.python_rows else None
        known = None if same is None else same.arrays_at_q
        if isinstance(known, CompiledArraysAtQ):
            kinematics = known.kinematics
            if known.kernel.data.has_rows_of(kernel.data):
                return CompiledArraysAtQ(kernel, at.q, position, kinematics, known.inverse)
        external = concatenated(kernel.external, position, lambda block, now: block.jacobian(now), -2)
        batch = at.q.shape[:-1]
        record = empty_records(batch, kernel.kinematics) if kinematics is None else kinematics
        inverse = empty_records(batch, kernel.inverse)
        if not self._calls.configure(at.q, record, inverse, external, kinematics is not None):
            return super().fill_at_q(at, same)
        return CompiledArraysAtQ(kernel, at.q, position, record, inverse)

    def fill_at_v(self, at: States, filled: ArraysAtQ) -> ArraysAtV:
        if not isinstance(filled, CompiledArraysAtQ) or at.v.shape[:-1] != filled.batch:
            return super().fill_at_v(at, filled)
        return CompiledArraysAtV(filled, at.v, at.motion if self.kernel.python_rows else None, at.t)

    def measured(self, q: Array, v: Array, t: float | None = None) -> StateEvaluation:
        kernel = self.kernel
        if not kernel.measures:
            return super().measured(q, v, t)
        found, status = _run_records(kernel, ()), np.array([1.0])
        self._calls.measure(q, v, *found, status, False)
        return _measured_state(self, kernel, q, v, found, t) if status[0] else super().measured(q, v, t)

    # ------------------------------------------------------------------ whole calls

    def forward_dynamics(self, q: ArrayInput, v2: ArrayInput, T: ArrayInput, t: ArrayInput | None) -> Array:
        found = self._called(self._calls.forward_dynamics, (q, v2, T), t)
        return super().forward_dynamics(q, v2, T, t) if found is None else found

    def inverse_dynamics(self, q: ArrayInput, v2: ArrayInput, v2_dot: ArrayInput, t: ArrayInput | None) -> Array:
        found = self._called(self._calls.inverse_dynamics, (q, v2, v2_dot), t)
        return super().inverse_dynamics(q, v2, v2_dot, t) if found is None else found

    def _called(
        self, call: Callable[..., Array | None], arguments: tuple[ArrayInput, ...], t: ArrayInput | None
    ) -> Array | None:
        """Result of a call of the kernel; None if NumPy has to decide. Lists and other numbers are converted first."""
        rates = None if t is None else self._rates(t, arguments[0])
        try:
            found = call(*arguments, rates)
            if found is None and any(type(each) is not Array or each.dtype != float for each in arguments):
                with suppress(InputError):  # NumPy's path names what is wrong
                    found = call(*(np.ascontiguousarray(admit_numbers(each, "")) for each in arguments), rates)
            return found
        except ValueError:  # of Pinocchio
            self.data.robot.check_unchanged()
            raise

    def _rates(self, t: ArrayInput | None, q: ArrayInput | None = None) -> Array | None:
        """Right-hand sides of constraints over one time t of states q; None for other constraints and other times."""
        if t is not None and type(t) is not float:
            admit_numbers(t, "t")
        if self._steady or not isinstance(t, float | int | np.floating):
            return None
        return self.kernel.rates_at(float(t), q.shape[:-1] if isinstance(q, Array) else ())

    def terms(self, q: ArrayInput, v2: ArrayInput) -> ReducedTerms:
        self.data.robot.check_unchanged()
        numbers = self._calls.terms(q, v2) if type(q) is type(v2) is Array else None
        if numbers is None:
            return super().terms(q, v2)
        numbers.setflags(write=False)
        record = np.ndarray(numbers.shape[:-1], self.kernel.terms, numbers)
        m = self.data.m
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

    def state_derivative(
        self, q: Array, v2: Array, T: Array, external: Array | None, damping: Array | None, t: float | None = None
    ) -> tuple[Array, Array]:
        data, n = self.data, self.data.n
        found = np.empty(n + data.r + data.vertical.size + 1 + data.rheonomic)
        if self._calls.state_derivative(q, None, v2, T, external, damping, self._rates(t), found):
            return found[:n], found[n:]
        return super().state_derivative(q, v2, T, external, damping, t)

    def admissible_velocity(self, q: Array, v2: Array, t: float | None = None) -> tuple[Array, float]:
        v, size = np.empty(self.data.n), np.empty(1)
        self._calls.admissible_velocities((self._calls,), q, v2, self._rates(t), None, v, size)
        if size[0] < np.inf:
            return v, size[0]
        return super().admissible_velocity(q, v2, t)

    def integrate(self, q: Array, y: Array, T: Array, h: float, steps: int) -> tuple[Array, Array, float] | None:
        rates = None
        if self.data.rheonomic and self.kernel.fused:
            rates = self.kernel.rates_over_time((y[-2] + 0.5 * h * np.arange(2 * steps + 1)).tolist())
        q_end, y_end, status, rough = np.empty(q.shape), np.empty(y.shape), np.empty(1), np.empty(1)
        found = q_end, y_end, status, rough
        self._calls.integrate((self._calls,), q, y, T, h, steps, None, *found, rates, None, None, None)
        return (q_end, y_end, float(rough[0])) if status[0] else None

    def planned_motion(
        self, form: str, start: tuple[Array, Array], u: Array, h: float, steps: int, feedback: PlannedFeedback | None
    ) -> tuple[Array, Array, Array] | None:
        q, w = (np.array(each, dtype=float) for each in start)
        K, nu = u.shape
        found = np.empty((K * steps, len(q) + len(w) + nu))
        gains = planned = None
        limits = np.zeros((2, nu))
        if feedback is not None:
            gains = np.ascontiguousarray(feedback.gains)
            planned, limits = np.hstack([feedback.q, feedback.w]), np.stack([feedback.lower, feedback.upper])
        difference = partial(pin.difference, self.data.robot.model)
        arrays = (gains, planned, limits, difference, np.empty_like(q), np.empty_like(q), found)
        if not self._calls.planned_motion(_FORMS.index(form), K, steps, h, q, w, np.ascontiguousarray(u), *arrays):
            return None
        return found[:, : len(q)], found[:, len(q) : -nu], found[:, -nu:]

    def planned_steps(self, form: str, q: Array, w: Array, u: Array, h: Array) -> tuple[Array, Array] | None:
        found = np.empty((len(q), q.shape[1] + w.shape[1]))
        arrays = (np.ascontiguousarray(each, dtype=float) for each in (q, w, u, h))
        if not self._calls.planned_steps(_FORMS.index(form), *arrays, found):
            return None
        return found[:, : q.shape[1]], found[:, q.shape[1] :]

    def planned_derivatives(
        self, form: str, q: Array, w: Array, u: Array, h: Array
    ) -> tuple[Mapping[str, Array], tuple[Array, Array], Array] | None:
        kernel, (n, nq), nx = self.kernel, q.shape, self.data.n + w.shape[1]
        if not self.data.kinematics.axes_are_constant:
            return None
        record, after = np.empty(n, kernel.derivatives), np.empty((n, nq + w.shape[1]))
        slopes = np.empty((n, nx, nx + u.shape[1] + 1))
        arrays = (np.ascontiguousarray(each, dtype=float) for each in (q, w, u, h))
        if not self._calls.planned_derivatives(_FORMS.index(form), *arrays, record, after, slopes):
            return None
        first = {name: record[name] for name in kernel.derivatives.names or ()}
        return first, (after[:, :nq], after[:, nq:]), slopes

    def chart_rate(self, q: Array, x: Array, T: Array, damping: Array | None) -> Array | None:
        found, n = np.empty(len(x)), self.data.n
        state, rates = (q, x[:n], x[n : n + self.data.r]), self._rates(float(x[-2]))
        return found if self._calls.state_derivative(*state, T, None, damping, rates, found) else None

    def state_derivatives(
        self, q: ArrayInput, v2: ArrayInput, T: ArrayInput, t: ArrayInput | None = None
    ) -> Mapping[str, Array] | None:
        kernel = self.kernel
        numbers = None
        if type(q) is type(v2) is type(T) is Array:
            numbers = self._calls.state_derivatives(q, v2, T, self._rates(t, q))
        if numbers is None:
            return None
        numbers.setflags(write=False)
        record = np.ndarray(numbers.shape[:-1], kernel.derivatives, numbers)
        return {name: record[name] for name in kernel.derivatives.names or ()}


def evaluator_for(data: ReductionData, known: NumPyEvaluator | None = None) -> NumPyEvaluator:
    """Evaluator of a reduction: compiled if the kernel agrees with NumPy at a random state.

    Args:
        data: the reduction.
        known: evaluator of another reduction of the same system. Rows that were compared for it are not compared again.
    """
    if _kernel.library is _kernel.NUMPY_ALONE or not data.kinematics.axes_are_constant:
        return NumPyEvaluator(data)
    compared = isinstance(known, CompiledEvaluator) and data.varies_as(known.data)
    try:
        found = CompiledEvaluator(data, ReductionKernel(data))
        difference = 0.0 if compared else _difference(found)
    except ValueError as error:
        _warn(str(error))
        return NumPyEvaluator(data)
    if difference is not None and not difference < _TOLERANCE:
        _warn(f"it differs from NumPy by {difference:.1e} (relative), limit {_TOLERANCE:.0e}")
    return found if difference is not None and difference < _TOLERANCE else NumPyEvaluator(data)


def _warn(why: str) -> None:
    warnings.warn(f"the compiled kernel is not used for this model: {why}", RuntimeWarning, stacklevel=2)


def _difference(found: CompiledEvaluator) -> float | None:
    """Largest relative difference at a random regular state; None if there is none."""
    data, generator = found.data, np.random.default_rng(0)
    t = _TIME if data.rheonomic else None
    for _ in range(_ATTEMPTS):
        q, v = data.robot.random_configuration(generator), generator.uniform(-1.0, 1.0, data.n)
        with suppress(SingularityError, NotImplementedError):  # a row is undefined at q, or has no rate
            by_numpy, by_kernel = (StateEvaluation.at(each, q, v=v, t=t) for each in (NumPyEvaluator(data), found))
            expected = _expected(data, by_numpy.position.with_velocity(v))
            if isinstance(by_kernel.arrays_at_v, CompiledArraysAtV) and by_kernel.arrays_at_v.rates is not None:
                differences = [_relative(getattr(by_kernel, name), value) for name, value in expected.items()]
                if data.affine:  # rates of the constraints at the velocity at which the reducing outputs rest
                    moved, _ = found.admissible_velocity(q, np.zeros(data.r), t)
                    differences.append(_relative(by_numpy.A @ moved, by_numpy.mu))
                return max(differences)
    return None


def _expected(data: ReductionData, at: VelocityKinematics) -> dict[str, Array]:
    """Arrays of one state by NumPy, without factors of E: only SciPy computes these, and its import takes long."""
    return {
        "passive_force": data.forces.sums(at).total,
        "M": at.M,
        "E": data.stack.jacobian(at),
        "nonlinear_effects": at.bias,
        "gamma": data.stack.bias_acceleration(at),
        "E_dot": data.stack.jacobian_dot(at),
        "J1": data.vertical.jacobian(at),
        "J1_dot": data.vertical.jacobian_dot(at),
    }


def _relative(found: Array, expected: Array) -> float:
    scale = max(float(np.abs(expected).max(initial=0.0)), 1e-3)
    return float(np.abs(found - expected).max(initial=0.0)) / scale


class CompiledRuns:
    """Kernel of a reduction, for runs side by side. All arrays are contiguous floats.

    Args:
        evaluator: evaluator of the reduction in which the runs are measured.

    Attributes:
        chart: object that ``CompiledRuns`` of another reduction take for a chart in this one.
        kinematics_size: numbers in a record of kinematics.
    """

    def __init__(self, evaluator: CompiledEvaluator) -> None:
        self._evaluator, self._kernel = evaluator, evaluator.kernel
        self.chart = self._calls = evaluator.kernel.calls
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
        """
        found = _run_records(self._kernel, q.shape[:-1], kinematics)
        self._calls.measure(q, v, *found, status, True)
        return found

    def states(self, q: Array, v: Array, records: RunRecords) -> StateEvaluation:
        """Evaluation at states (..., nq), (..., nv) from their records, which nobody may change afterwards."""
        return _measured_state(self._evaluator, self._kernel, q, v, records)


def runs_of(evaluator: NumPyEvaluator) -> CompiledRuns | None:
    """Calls of the kernel for many runs; None where each run has to take its own path."""
    if not isinstance(evaluator, CompiledEvaluator) or evaluator.data.rheonomic:
        return None
    return CompiledRuns(evaluator)


def _run_records(kernel: ReductionKernel, batch: tuple[int, ...], kinematics: Array | None = None) -> RunRecords:
    """Records of measurements without values; kinematics: those of the states, if known."""
    first, inverse, rates, values = kernel.measured_sizes
    return RunRecords(
        np.empty((*batch, first)) if kinematics is None else kinematics,
        np.empty((*batch, inverse)),
        np.empty((*batch, rates)),
        np.empty((*batch, values)),
    )


def _measured_state(
    evaluator: Evaluator, kernel: ReductionKernel, q: Array, v: Array, records: RunRecords, t: float | None = None
) -> StateEvaluation:
    records.rates.setflags(write=False)  # CompiledArraysAtQ protects those at q
    records.values.setflags(write=False)
    batch, r = q.shape[:-1], kernel.data.r
    kinematics = np.ndarray(batch, kernel.kinematics, records.kinematics)
    inverse = np.ndarray(batch, kernel.inverse, records.inverse)
    rates = np.ndarray(batch, kernel.rates, records.rates)
    values = records.values[..., r:], records.values[..., :r]
    at_q = CompiledArraysAtQ(kernel, q, None, kinematics, inverse, values)
    return StateEvaluation.filled(evaluator, q, v, (at_q, CompiledArraysAtV(at_q, v, None, t, rates)), t)
