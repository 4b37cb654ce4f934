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

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.errors import InputError, SingularityError
from rnc_pin.model.compiled_states import CompiledArraysAtQ, CompiledArraysAtV, concatenated, empty_records
from rnc_pin.model.evaluator import ArraysAtQ, ArraysAtV, Configurations, HasArraysAtQ, ReducedTerms, States
from rnc_pin.model.input_validation import ArrayInput, admit_numbers
from rnc_pin.model.kinematics import VelocityKinematics
from rnc_pin.model.numpy_evaluator import Dissipation, NumPyEvaluator, PlannedFeedback
from rnc_pin.model.reduction_data import ReductionData
from rnc_pin.model.reduction_kernel import ReductionKernel
from rnc_pin.model.state_evaluation import StateEvaluation

_TOLERANCE = 1e-9  # largest relative difference of kernel and NumPy at the state that compares them
_TIME = 0.3  # of rows over time [s]
_FORMS = ("kinematic", "acceleration", "dynamic")
_ATTEMPTS = 8  # random states that may be singular


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
        self._steady = not data.rheonomic

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
        records, status = [np.empty(size) for size in kernel.measured_sizes], np.array([1.0])
        self._calls.measure(q, v, *records, status, False)
        if not status[0]:
            return super().measured(q, v, t)
        kinematics, inverse, rates = (
            np.ndarray((), kind, record)
            for kind, record in zip((kernel.kinematics, kernel.inverse, kernel.rates), records, strict=False)
        )
        values, r = records[-1], self.data.r
        for each in (rates, values):  # CompiledArraysAtQ protects those at q
            each.setflags(write=False)
        at_q = CompiledArraysAtQ(kernel, q, None, kinematics, inverse, (values[r:], values[:r]))
        return StateEvaluation.filled(self, q, v, (at_q, CompiledArraysAtV(at_q, v, None, t, rates)), t)

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
        rates = self._rates(t, arguments[0])
        for each in arguments:
            if type(each) is not Array or each.dtype != float:
                try:
                    arguments = tuple(np.ascontiguousarray(admit_numbers(one, "")) for one in arguments)
                except InputError:  # NumPy's path names what is wrong
                    return None
                break
        try:
            return call(*arguments, rates)
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
        self,
        q: Array,
        v2: Array,
        T: Array,
        external: Array | None,
        damping: Array | None,
        t: float | None = None,
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

    def integrate(
        self, q: Array, y: Array, T: Array, h: float, steps: int, losses: Dissipation | None = None
    ) -> tuple[Array, Array, float] | None:
        rates = None
        if self.data.rheonomic and losses is not None:
            return None
        if self.data.rheonomic and self.kernel.fused:
            rates = self.kernel.rates_over_time((y[-2] + 0.5 * h * np.arange(2 * steps + 1)).tolist())
        q_end, y_end, status, rough = np.empty(q.shape), np.empty(y.shape), np.empty(1), np.empty(1)
        found = q_end, y_end, status, rough
        self._calls.integrate((self._calls,), q, y, T, h, steps, None, *found, rates, *(losses or (None, None, None)))
        return (q_end, y_end, float(rough[0])) if status[0] else None

    def friction(self, q: Array, y: Array, T: Array, h: float, losses: Dissipation) -> Array | None:
        if self.data.rheonomic:
            return None
        force, status = np.empty(self.data.n), np.empty(1)
        found = np.empty(q.shape), force, status, np.empty(1)
        self._calls.integrate((self._calls,), q, y, T, h, 0, None, *found, None, *losses)
        return force if status[0] else None

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
