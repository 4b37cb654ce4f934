"""Arrays that the compiled kernel fills for evaluations at configurations and at states.

``ConfigurationEvaluation`` and ``StateEvaluation`` hold each formula once. With ``filled_at_q`` or ``filled_at_v``, an
array below of the same name takes its place, unless it is None.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy import ndarray as Array

from rnc_pin.math.linear_algebra import Component
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.factorization import Factorization
from rnc_pin.model.generalized_forces import ForceSums
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.reduction_kernel import ReductionKernel


class RecordEntry:
    """Array of a record, by the name of the attribute; None without the record."""

    def __init__(self, record: str) -> None:
        self._record = record

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, owner: object, kind: type) -> Array | None:
        record: Array | None = getattr(owner, self._record)
        return None if record is None else record[self._name]


class CompiledArraysAtQ:
    """Arrays at regular configurations, in records that the kernel has filled.

    Args:
        kernel: the kernel.
        q: configurations (..., nq).
        position: kinematics at q; None if ``python_rows`` is False.
        kinematics: record of M, J and placements of joints; ``inverse``: record of E and its inverse.
        output_values: values x1 and x2, if known.
    """

    M = RecordEntry("kinematics")
    E, E_inverse = RecordEntry("inverse"), RecordEntry("inverse")
    J1, A_star = RecordEntry("vertical"), RecordEntry("vertical")

    def __init__(
        self,
        kernel: ReductionKernel,
        q: Array,
        position: PositionKinematics | None,
        kinematics: Array,
        inverse: Array,
        output_values: tuple[Array, Array] | None = None,
    ) -> None:
        self.kernel, self.q, self.kinematics, self.inverse = kernel, q, kinematics, inverse
        self._position, self._calls, self._output_values = position, kernel.calls, output_values
        self.batch = q.shape[:-1]
        # Evaluations hand out views of these records.
        kinematics.setflags(write=False)
        inverse.setflags(write=False)

    @cached_property
    def factorization(self) -> Factorization:
        """E and its inverse, with the default rows."""
        regular = np.ones(self.batch, dtype=bool) if self.batch else True
        return Factorization(self.inverse["E"], self.inverse["E_inverse"], regular)

    def output_values(self, position: PositionKinematics | None) -> tuple[Array, Array]:
        """Values x1 (..., k) and x2 (..., r); zero for quasi-velocities.

        Args:
            position: kinematics at q; None if Python evaluates no value.
        """
        if self._output_values is not None:
            return self._output_values
        # Values are in the order of the rows of E, reducing outputs first.
        data = self.kernel.data
        values = np.empty((*self.batch, data.r + data.vertical.size))
        self._calls.values(self.q, self.kinematics, values)
        x2, x1 = values[..., : data.r], values[..., data.r :]
        for x, places in zip((x2, x1), self.kernel.python_values, strict=True):
            for block, where in places:
                assert position is not None
                x[..., where] = block.value(position)
        return x1, x2

    def velocity(self, v2: Array, mu: Array | None) -> Array:
        """Full velocity (..., nv) for reduced velocities.

        Args:
            v2: reduced velocities (..., r) [rad/s or m/s], with the axes of q.
            mu: right-hand side (..., m) of affine constraints; None for others.
        """
        v2 = np.ascontiguousarray(v2, float)  # a controller may give integers, or a column of a matrix
        v = np.empty((*self.batch, self.kernel.data.n))
        self._calls.velocity(self.inverse, mu, v2, v)
        return v

    @cached_property
    def H(self) -> Array | None:
        """Reduced inertia matrix (..., r, r)."""
        r = self.kernel.data.r
        return _filled(self._calls.inertia, (*self.batch, r, r), self.kinematics, self.inverse)

    @cached_property
    def varying_B(self) -> Array | None:
        """Actuation matrix (..., nv, p); None if it is a function of the user."""
        if not self.kernel.has_inputs:
            return None
        shape = (*self.batch, self.kernel.data.n, self.kernel.data.p)
        return _filled(self._calls.actuation, shape, self.q, self.kinematics)

    def allocated(self, F: Array) -> Array | None:
        """Actuator inputs (..., p) for reduced forces (..., r); None if NumPy has to decide.

        Args:
            F: reduced forces (..., r) [N or N m].
        """
        data = self.kernel.data
        # With more or fewer actuators than velocities, a pseudoinverse has to decide.
        if data.p != data.r or not self.kernel.has_inputs or F.shape[:-1] != self.batch:
            return None
        records = self.q, self.kinematics, self.inverse
        return _filled(self._calls.allocate, F.shape, *records, np.ascontiguousarray(F))

    def output_slopes(self, along: Sequence[int] | Array) -> Array | None:
        """Rates (s, ..., k, r) of A_star in motions of single reducing outputs; None if NumPy has to evaluate them.

        Args:
            along: indices of the reducing outputs (s,).
        """
        data = self.kernel.data
        if self.kernel.python_rows or data.affine or not len(along):
            return None
        rates = empty_records((len(along), *self.batch), self.kernel.rates)
        for j, record in zip(along, rates.reshape(len(along), -1), strict=True):
            # A column of R is the velocity at which one reducing output moves at unit rate and the others rest.
            v = self.inverse["E_inverse"][..., data.m + j].copy()
            if not self._calls.rates(self.q, self.kinematics, self.inverse, v, None, None, None, record):
                return None
        return rates["A_star_dot"]

    @cached_property
    def vertical(self) -> Array | None:
        """Record of J1 and A_star; None if a row is undefined."""
        position = self._position
        external = None if position is None else self.kernel.external_vertical.jacobian(position)
        rows = empty_records(self.batch, self.kernel.rows)
        return rows if self._calls.vertical(self.q, self.kinematics, self.inverse, external, rows) else None


class CompiledArraysAtV:
    """Arrays at states, in records that the kernel fills.

    Args:
        at_q: arrays at the configurations.
        v: full velocities (..., nv).
        motion: kinematics at the states; None if ``python_rows`` is False.
        t: times (...) for constraints that depend on them [s].
        rates: record of rates, if known.
    """

    nonlinear_effects, gamma = RecordEntry("biases"), RecordEntry("biases")
    E_inverse_gamma, motion_force = RecordEntry("biases"), RecordEntry("biases")
    E_dot, R_dot = RecordEntry("rates"), RecordEntry("rates")
    J1_dot, A_star, A_star_dot = RecordEntry("rates"), RecordEntry("rates"), RecordEntry("rates")

    def __init__(
        self,
        at_q: CompiledArraysAtQ,
        v: Array,
        motion: VelocityKinematics | None,
        t: Component | None = None,
        rates: Array | None = None,
    ) -> None:
        self.at_q, self._v, self._motion, self._t = at_q, np.ascontiguousarray(v), motion, t
        self._kernel, self._calls = at_q.kernel, at_q.kernel.calls
        if rates is not None:
            self.rates, self.row_velocities, self.v1 = rates, rates["row_velocities"], rates["v1"]

    @cached_property
    def biases(self) -> Array:
        """Record of bias, gamma, its product with E^-1, forces without actuators, and H."""
        at, kernel = self.at_q, self._kernel
        external = None if self._motion is None else kernel.external.bias_acceleration(self._motion)
        biases = empty_records(at.batch, kernel.biases)
        rates = kernel.rates_at(self._t, at.batch)
        self._calls.biases(at.q, at.kinematics, at.inverse, self._v, external, rates, biases)
        return biases

    def accelerated(self, force: Array) -> Array | None:
        """Reduced acceleration (..., r); None if it is not finite, or if the forces have more axes than the states.

        Args:
            force: generalized forces (..., nv), passive ones included [N or N m].
        """
        at = self.at_q
        if force.shape[:-1] != at.batch:
            return None
        shape = (*at.batch, self._kernel.data.r)
        return _filled(self._calls.accelerate, shape, at.inverse, self.biases, np.ascontiguousarray(force))

    def input_accelerations(self, B: Array) -> tuple[Array, Array] | None:
        """Reduced accelerations (r, p) of unit inputs, and those (r,) without any force; None if H is singular."""
        r = self._kernel.data.r
        found = np.empty((r, B.shape[-1])), np.empty(r)
        return found if self._calls.input_accelerations(self.at_q.inverse, self.biases, B, *found) else None

    @cached_property
    def passive_sums(self) -> ForceSums | None:
        """Sums of the passive forces; None if Python evaluates one of them."""
        if not self._kernel.fused:
            return None
        # All forces, and those with a potential, whose work counts as energy.
        at, shape = self.at_q, (*self.at_q.batch, 2, self._kernel.data.n)
        found = _filled(self._calls.passive_forces, shape, at.q, at.kinematics, self._v)
        if found is None:
            return None
        found.setflags(write=False)
        total, springs = found[..., 0, :], found[..., 1, :]
        return ForceSums(total, total - springs)

    @cached_property
    def row_velocities(self) -> Array | None:
        """Rates ``E v`` of the constraint rows and of the reducing outputs, (..., nv)."""
        return _filled(self._calls.row_velocities, self._v.shape, self.at_q.inverse, self._v)

    @cached_property
    def v1(self) -> Array | None:
        """Rates of the vertical outputs ``J1 v``, (..., k); None if a row of J1 is undefined."""
        rows = self.at_q.vertical
        if rows is None:
            return None
        shape = (*self.at_q.batch, self._kernel.data.vertical.size)
        return _filled(self._calls.vertical_velocities, shape, rows, self._v)

    @cached_property
    def rates(self) -> Array | None:
        """Record of J1, A_star, the rates of E, R, J1 and A_star, E v and J1 v; None if a row of J1 is undefined."""
        at, kernel = self.at_q, self._kernel
        # Python's rows of J1, and the rates of Python's rows of E and of J1.
        rows = external = vertical = None
        if self._motion is not None:
            rows = kernel.external_vertical.jacobian(self._motion)
            external = kernel.external.jacobian_dot(self._motion)
            vertical = kernel.external_vertical.jacobian_dot(self._motion)
        rates = empty_records(at.batch, kernel.rates)
        arguments = at.q, at.kinematics, at.inverse, self._v, rows, external, vertical, rates
        return rates if self._calls.rates(*arguments) else None


def arrays_at_q(
    kernel: ReductionKernel, q: Array, position: PositionKinematics | None, known: CompiledArraysAtQ | None
) -> CompiledArraysAtQ | None:
    """Arrays for configurations; None if the kernel declines one of them.

    Args:
        kernel: kernel of the reduction.
        q: configurations (..., nq).
        position: kinematics at q; None if ``python_rows`` is False.
        known: arrays of the same configurations in another reduction.
    """
    # Another reduction with the same E, e.g. with other vertical outputs: nothing is left to fill.
    if known is not None and known.kernel.data.has_rows_of(kernel.data):
        return CompiledArraysAtQ(kernel, q, position, known.kinematics, known.inverse)
    external = None if position is None else kernel.external.jacobian(position)
    batch = q.shape[:-1]
    kinematics = empty_records(batch, kernel.kinematics) if known is None else known.kinematics
    inverse = empty_records(batch, kernel.inverse)
    # The kernel tests E as ``factorize`` does; it declines where other rows may have to be selected.
    if not kernel.calls.configure(q, kinematics, inverse, external, known is not None):
        return None
    return CompiledArraysAtQ(kernel, q, position, kinematics, inverse)


def _filled(call: Callable[..., bool], shape: tuple[int, ...], *arguments: Array) -> Array | None:
    """Array that a call of the kernel fills; None if NumPy has to evaluate it."""
    found = np.empty(shape)
    return found if call(*arguments, found) else None


def empty_records(shape: tuple[int, ...], record: np.dtype[np.void]) -> Array:
    """Records without values; NumPy's ``empty`` takes several times as long for a type with fields.

    Args:
        shape: leading axes.
        record: type of one record.
    """
    return np.ndarray(shape, record, np.empty((*shape, record.itemsize // 8)))
