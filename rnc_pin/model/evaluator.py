"""Evaluations of one reduction: the compiled kernel answers first, and the formulas where it declines.

The kernel evaluates one state or a loop of states into records. It declines if a row is undefined, E is singular, or
other constraint rows have to be considered. ``evaluator_for`` compares it with the formulas when a reduction is made.
Only the function that has a formula sees that the kernel declined: here and in ``reduced_model`` for evaluations, in
``integrators`` and ``plants.friction`` for steps, in ``simulation.batch`` for runs side by side (the others go on
alone), in ``analysis.derivatives`` for derivatives, in ``motion.planning.action_models`` for planned steps, and in
``motion.optimal.verification`` for the steps of a whole plan. Functions of ``_kernel.library`` need no reduction: those
who call them have the formula beside the call.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import suppress
from functools import partial

import numpy as np
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.errors import SingularityError
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.filled_arrays import CompiledArraysAtQ, CompiledArraysAtV, empty_records
from rnc_pin.model.input_validation import ArrayInput, admit_numbers
from rnc_pin.model.reduction_data import ReductionData
from rnc_pin.model.reduction_kernel import ReductionKernel
from rnc_pin.model.state_evaluation import StateEvaluation

_COMPARED = ("passive_force", "M", "E", "nonlinear_effects", "gamma", "E_dot", "J1", "J1_dot")
"""Quantities by which the kernel is compared with the formulas: all others follow from them by matrices alone."""


class _SampledState(StateEvaluation):
    """State at an end of a sample, from its record.

    A program reads it in each sample, so it is made without the configuration and its arrays: with them, it takes as
    long as a product of matrices. They follow at the first look-up of anything else.
    """

    def __init__(
        self, evaluator: Evaluator, kernel: ReductionKernel, q: Array, v2: Array, kinematics: Array, inverse: Array
    ) -> None:
        ConfigurationEvaluation.__init__(self, evaluator, q)
        self._records = kernel, q, None, kinematics, inverse
        self.v2, self.E_inverse = v2, inverse["E_inverse"]
        self.R = self.E_inverse[..., evaluator.data.m :]

    def __reduce__(self) -> tuple[object, ...]:  # the record belongs to the kernel of this process
        return partial(StateEvaluation.at, self._evaluator, self.q, v=self.v), ()

    @cached_property
    def configuration(self) -> ConfigurationEvaluation:
        return ConfigurationEvaluation(self._evaluator, self.q, self)

    @cached_property
    def arrays_at_q(self) -> CompiledArraysAtQ:
        return CompiledArraysAtQ(*self._records)


class Evaluator:
    """Evaluations of one reduction, by its kernel if it has one.

    Args:
        data: the reduction.
        kernel: its compiled kernel; None for the formulas alone, which are the reference: ``calls`` decline.

    Attributes:
        measures: True if ``measured`` is one call, for many runs too.
        kept_chart: evaluator of the last velocity chart, and what defines it. Many runs start at one configuration.
    """

    def __init__(self, data: ReductionData, kernel: ReductionKernel | None = None) -> None:
        self.data, self.kernel = data, kernel
        self.calls: _kernel.library.Evaluator = _kernel.NUMPY_ALONE if kernel is None else kernel.calls
        self.measures = kernel is not None and kernel.measures
        self.kept_chart: tuple[tuple[object, ...], Evaluator] | None = None

    def __reduce__(self) -> tuple[object, ...]:  # the kernel refers to memory
        return (Evaluator if self.kernel is None else evaluator_for), (self.data,)

    def rows_changed(self) -> None:
        """Read the parameters of constraint rows again; call it after a change of e.g. the radius of a wheel."""
        self.kept_chart = None
        if self.kernel is not None:
            self.kernel.refresh()

    def vertical_outputs(self, at: ConfigurationEvaluation, J1: Array) -> Array:
        """Values x1 (k,) at one configuration, which another reduction has evaluated.

        Args:
            at: evaluation at the configuration.
            J1: Jacobian (k, nv), which is written.
        """
        kernel, data, known = self.kernel, self.data, at.compiled_kinematics
        if kernel is not None and known is not None and not kernel.python_values[1]:
            values = np.empty(data.r + len(J1))
            if kernel.calls.outputs(at.q, known, J1, values):
                return values[data.r :]
        here = at.in_reduction(self)
        J1[:] = here.J1
        return here.outputs()[0]

    def measured(self, q: Array, v: Array, t: float | None = None) -> StateEvaluation:
        """Evaluate one validated state (nq,), (nv,) with all that a measurement needs.

        Args:
            q: configuration (nq,), contiguous.
            v: full velocity (nv,), which need not satisfy the constraints.
            t: time of rheonomic constraints [s].
        """
        if self.measures:
            # One call instead of one for each quantity: a tick of a controller needs them all.
            status = np.array([1.0])
            found = self.measured_states(q, v, status, t)
            if status[0]:
                return found
        return StateEvaluation.at(self, q, v=v, t=t)

    def sample(self, q: Array, v2: Array, dt: float) -> tuple[StateEvaluation, StateEvaluation] | None:
        """States at the start of a sample and at its predicted end; None if the general way has to evaluate them.

        Args:
            q: configuration (nq,) at the start.
            v2: reduced velocities (r,) of both.
            dt: duration of the sample [s].
        """
        kernel = self.kernel
        numbers = self.calls.sample(q, v2, np.array([dt]))
        if kernel is None or numbers is None:
            return None
        numbers.setflags(write=False)
        record = np.ndarray((), kernel.sample, numbers)
        v2 = record["v2"]
        start = _SampledState(self, kernel, record["q"], v2, record["kinematics"], record["inverse"])
        end = _SampledState(self, kernel, record["q_end"], v2, record["kinematics_end"], record["inverse_end"])
        start.v, start.input_accelerations = record["v"], (record["effects"], record["adverse"])
        if self.data.p == self.data.r:
            start.accelerating_inputs = record["inputs"]
        return start, end

    def measured_states(
        self, q: Array, v: Array, status: Array, t: float | None = None, kinematics: Array | None = None
    ) -> StateEvaluation:
        """Evaluation at states (..., nq), (..., nv) by one call of the kernel, which has to exist.

        Args:
            q: configurations (..., nq).
            v: full velocities (..., nv) [rad/s or m/s].
            status: not zero (...) for states to be measured; it becomes zero where NumPy has to evaluate them.
            t: time of rheonomic constraints [s].
            kinematics: records of kinematics at q, if known, which nobody may change afterwards.
        """
        kernel, batch, r = self.kernel, q.shape[:-1], self.data.r
        assert kernel is not None
        inverse, rates = (empty_records(batch, each) for each in (kernel.inverse, kernel.rates))
        known = kinematics is not None
        placed = np.ndarray(batch, kernel.kinematics, kinematics) if known else empty_records(batch, kernel.kinematics)
        values = np.empty((*batch, r + self.data.vertical.size))
        kernel.calls.measure(q, v, placed, inverse, rates, values, status, known)
        rates.setflags(write=False)  # CompiledArraysAtQ protects those at q
        values.setflags(write=False)
        at_q = CompiledArraysAtQ(kernel, q, None, placed, inverse, (values[..., r:], values[..., :r]))
        state = StateEvaluation.at(self, q, v=v, t=t)
        # Set for the state too: its own look-up through the configuration costs a call in each sample.
        state.configuration.arrays_at_q = state.arrays_at_q = at_q
        state.arrays_at_v = CompiledArraysAtV(at_q, v, None, t, rates)
        return state

    def far_within(
        self, sample: Sequence[StateEvaluation], v2: Array, T: Array, t: float, dt: float, bounds: Sequence[Array]
    ) -> bool:
        """True if the motion of a sample keeps bounds for certain, by the kernel.

        The acceleration at its end tells by how much v2 deviates from a constant one, to second order. Bounds that are
        farther than twice this and the whole change in the sample are kept.

        Args:
            sample: states at its start, and at its predicted end.
            v2: reduced velocities (r,) at the end, by the acceleration at the start.
            T: inputs (p,).
            t: time of the end [s].
            dt: duration [s].
            bounds: rows (k, nv) on the full velocity, their lower and upper bounds (k,).
        """
        (start, end), data = sample, self.data
        later = np.empty(data.n + data.r + data.vertical.size + 1 + data.rheonomic)
        rates = self.rates_at(t) if data.rheonomic else None
        known = end.q, v2, T, end.compiled_kinematics, rates, later, start.v2
        return bool(self.calls.far_within(*known, np.array([dt]), *bounds))

    def rates_at(self, t: ArrayInput | None, q: ArrayInput | None = None) -> Array | None:
        """Right-hand sides of constraints over time for calls of the kernel; None for other constraints.

        Args:
            t: one time of all states [s]; there are none for other times.
            q: configurations (..., nq) of the states.
        """
        if t is not None and type(t) is not float:
            admit_numbers(t, "t")
        if self.kernel is None or not self.data.rheonomic or not isinstance(t, float | int | np.floating):
            return None
        return self.kernel.rates_at(float(t), q.shape[:-1] if isinstance(q, Array) else ())

    def admissible_velocity(self, q: Array, v2: Array, t: float | None = None) -> tuple[Array, float]:
        """Full velocity (nv,) at one state, and the sum of the squares of R.

        Args:
            q: configuration (nq,).
            v2: reduced velocities (r,).
            t: time of rheonomic constraints [s].
        """
        if self.kernel is not None:
            calls, v, size = self.kernel.calls, np.empty(self.data.n), np.empty(1)
            # The sum of squares of R is infinite where E is singular.
            calls.admissible_velocities((calls,), q, v2, self.rates_at(t), None, v, size)
            if size[0] < np.inf:
                return v, size[0]
        state = StateEvaluation.at(self, q, v2, t=t)
        return state.v, float(np.square(state.R).sum())


def evaluator_for(data: ReductionData, known: Evaluator | None = None) -> Evaluator:
    """Evaluator of a reduction: compiled if the kernel agrees with NumPy at a random state.

    NumPy alone evaluates robots whose joints have axes that change, and reductions without a regular random state.

    Args:
        data: the reduction.
        known: evaluator of another reduction of the same system. Rows that were compared for it are not compared again.
    """
    if _kernel.library is _kernel.NUMPY_ALONE or not data.kinematics.axes_are_constant:
        return Evaluator(data)
    # A chart of a run has the same varying rows as the model: it is not compared again at each recentring.
    compared = known is not None and known.kernel is not None and data.varies_as(known.data)
    try:
        found = Evaluator(data, ReductionKernel(data))
        difference = 0.0 if compared else _difference(found)
    except ValueError as error:
        _warn(str(error))
        return Evaluator(data)
    tolerance = 1e-9  # relative: both paths round differently, and an ill-scaled robot loses some digits
    if difference is not None and not difference < tolerance:
        _warn(f"it differs from NumPy by {difference:.1e} (relative), limit {tolerance:.0e}")
    return found if difference is not None and difference < tolerance else Evaluator(data)


def _warn(why: str) -> None:
    warnings.warn(f"the compiled kernel is not used for this model: {why}", RuntimeWarning, stacklevel=2)


def _difference(found: Evaluator) -> float | None:
    """Largest relative difference at a random regular state; None if there is none."""
    data, generator = found.data, np.random.default_rng(0)
    t = 0.3 if data.rheonomic else None  # [s]; at zero, rows over time may be at rest
    attempts = 8  # some random states are singular
    for _ in range(attempts):
        q, v = data.robot.random_configuration(generator), generator.uniform(-1.0, 1.0, data.n)
        with suppress(SingularityError, NotImplementedError):  # a row is undefined at q, or has no rate
            by_numpy, by_kernel = (StateEvaluation.at(each, q, v=v, t=t) for each in (Evaluator(data), found))
            if by_kernel.arrays_at_v is not None and by_kernel.arrays_at_v.rates is not None:
                differences = [_relative(getattr(by_kernel, name), getattr(by_numpy, name)) for name in _COMPARED]
                if data.affine:  # rates of the constraints at the velocity at which the reducing outputs rest
                    moved, _ = found.admissible_velocity(q, np.zeros(data.r), t)
                    differences.append(_relative(by_numpy.A @ moved, by_numpy.mu))
                return max(differences)
    return None


def _relative(found: Array, expected: Array) -> float:
    # Relative, unless the array vanishes to rounding.
    scale = max(float(np.abs(expected).max(initial=0.0)), 1e-3)
    return float(np.abs(found - expected).max(initial=0.0)) / scale
