"""Compiled evaluation of a reduction; ``rnc_pin/_kernel/kernel.c`` has the formulas.

The kernel evaluates one state or a loop of states into records, and declines if a row is undefined, E is singular, or
other constraint rows have to be considered. Then the formulas of ``configuration_evaluation`` and ``state_evaluation``
decide. They are also the reference: both are compared before a reduction uses the kernel.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.errors import SingularityError
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.kernel_rows import (
    INTEGERS,
    NUMBERS,
    AttachedFrame,
    Form,
    KernelRow,
    Value,
    attached,
    placement_numbers,
)
from rnc_pin.model.kinematics import Kinematics, PositionKinematics, RateKinematics, VelocityKinematics
from rnc_pin.model.row_stack import OutputStack, Place, RowStack
from rnc_pin.model.rows import OutputRows

if TYPE_CHECKING:
    from rnc_pin.model.reduction_data import ReductionData

_TOLERANCE = 1e-9  # largest relative difference of the two paths at the state that compares them
_ATTEMPTS = 8  # random states that may be singular


class UsesKernel:
    """Owner of a property ``compiled``, which copies and pickles omit because it refers to memory."""

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if name != "compiled"}


class CompiledReduction:
    """Kernel for the rows, outputs and actuators of a reduction.

    Args:
        data: the reduction.

    Raises:
        ValueError: Pinocchio's data have a memory layout that the kernel does not know.
    """

    def __init__(self, data: ReductionData) -> None:
        self._data = data
        table = _RowTable(data)
        self.external, self.external_vertical = table.external, table.external_vertical
        self.python_rows = bool(table.external or table.external_vertical)
        """True if Python evaluates rows of E or of J1."""
        parts = data.actuation.parts
        self.has_inputs = parts is not None
        mu = np.array(table.rates) if data.affine else None
        fused = self.has_inputs and not table.external
        self._evaluator = _evaluator(data, table, mu, fused)
        self.forward_dynamics: Callable[[object, object, object], Array | None] = self._evaluator.forward_dynamics
        """Reduced accelerations for q, v2 and T; None if the arrays or the state need the other path."""
        self._terms_at_once = fused and not (table.external_vertical or data.affine)
        n, r, k, p = data.n, data.r, data.vertical.size, data.p
        kinematics = {"M": (n, n), "J": (6, n), "placements": (data.robot.model.njoints, 12)}
        inverse = {"E": (n, n), "E_inverse": (n, n)}
        rows = {"J1": (k, n), "A_star": (k, r)}
        biases = {"bias": (n,), "dJ": (6, n), "gamma": (n,), "E_inverse_gamma": (n,), "unforced": (n,), "H": (r, r)}
        velocities = {"velocities": (n,), "v1": (k,)}
        rates = {"E_dot": (n, n), "R_dot": (n, r), **rows, "J1_dot": (k, n), "A_star_dot": (k, r), **velocities}
        coriolis = {"C": (n, n), "V": (r, r), "g": (n,), "G": (r,)}
        forces = {"bias": (n,), "H": (r, r), "B": (n, p), "input_matrix": (r, p)}
        self.kinematics, self.inverse, self.rows = _record(kinematics), _record(inverse), _record(rows)
        self.biases, self.rates = _record(biases), _record(rates)
        self.terms = _record({**kinematics, **inverse, "v": (n,), **rates, **coriolis, **forces})

        self.python_values = tuple(_python_values(stack, data.robot.model) for stack in (data.reducing, data.vertical))
        """Blocks of reducing and of vertical outputs whose values Python evaluates."""

    def refresh(self) -> None:
        """Read the numbers of the rows again, after a parameter of a row changed."""
        self._evaluator.set_numbers(_RowTable(self._data).numbers)

    def configuration(
        self, q: Array, position: PositionKinematics | None, kinematics: Array | None = None
    ) -> CompiledConfiguration | None:
        """Evaluation at configurations (..., nq); None if the other path has to evaluate them.

        Args:
            q: configurations, contiguous.
            position: kinematics at q; None if ``python_rows`` is False.
            kinematics: kinematics record at q, if known.
        """
        external = _concatenated(self.external, lambda block: block.jacobian(position), -2)
        known = kinematics is not None
        record = np.empty(q.shape[:-1], self.kinematics) if kinematics is None else kinematics
        inverse = np.empty(q.shape[:-1], self.inverse)
        if not self._evaluator.configure(q, record, inverse, external, known):
            return None
        return CompiledConfiguration(self, q, position, record, inverse)

    def terms_at_once(self, q: Array, v2: Array) -> Array | None:
        """Record of all matrices at states; None if they have to be evaluated one by one."""
        if not self._terms_at_once:
            return None
        record = np.empty(q.shape[:-1], self.terms)
        return record if self._evaluator.terms(q, v2, record) else None


class CompiledConfiguration:
    """Quantities at configurations.

    Attributes:
        kinematics: record of M, J and placements of joints; ``inverse``: record of E and its inverse.
    """

    def __init__(
        self,
        reduction: CompiledReduction,
        q: Array,
        position: PositionKinematics | None,
        kinematics: Array,
        inverse: Array,
    ) -> None:
        self.reduction, self.q, self.kinematics, self.inverse = reduction, q, kinematics, inverse
        self._position, self._evaluator = position, reduction._evaluator
        self.batch = q.shape[:-1]
        kinematics.setflags(write=False)
        inverse.setflags(write=False)

    @property
    def M(self) -> Array:
        """Inertia matrix before reduction."""
        return self.kinematics["M"]

    @property
    def E(self) -> Array:
        """Constraint rows and reducing outputs."""
        return self.inverse["E"]

    @property
    def E_inverse(self) -> Array:
        """Inverse of E."""
        return self.inverse["E_inverse"]

    def values(self, position: Callable[[], PositionKinematics]) -> tuple[Array, Array]:
        """Values of the vertical and of the reducing outputs; ``position`` returns kinematics at q."""
        data = self.reduction._data
        values = np.empty((*self.batch, data.r + data.vertical.size))
        self._evaluator.values(self.q, self.kinematics, values)
        x2, x1 = values[..., : data.r], values[..., data.r :]
        for x, places in zip((x2, x1), self.reduction.python_values, strict=True):
            for block, where in places:
                x[..., where] = block.value(position())
        return x1, x2

    def velocity(self, v2: Array, mu: Array | None) -> Array:
        """Full velocity (..., nv)."""
        v = np.empty((*self.batch, self.reduction._data.n))
        self._evaluator.velocity(self.inverse, mu, v2, v)
        return v

    @cached_property
    def H(self) -> Array:
        """Reduced inertia matrix."""
        r = self.reduction._data.r
        H = np.empty((*self.batch, r, r))
        self._evaluator.inertia(self.kinematics, self.inverse, H)
        return H

    def B(self) -> Array:
        """Actuation matrix, if it is not a function of the user."""
        data = self.reduction._data
        B = np.empty((*self.batch, data.n, data.p))
        self._evaluator.actuation(self.q, self.kinematics, B)
        return B

    @cached_property
    def vertical(self) -> Array | None:
        """Record of J1 and A_star; None if a row is undefined."""
        external = _concatenated(self.reduction.external_vertical, lambda block: block.jacobian(self._position), -2)
        rows = np.empty(self.batch, self.reduction.rows)
        return rows if self._evaluator.vertical(self.q, self.kinematics, self.inverse, external, rows) else None


class CompiledState:
    """Quantities at states.

    Args:
        at: the configurations.
        v: full velocities (..., nv).
        motion: kinematics at the states; None if ``python_rows`` is False.
    """

    def __init__(
        self,
        at: CompiledConfiguration,
        v: Array,
        motion: VelocityKinematics | None,
    ) -> None:
        self._at, self._v, self._motion = at, np.ascontiguousarray(v), motion
        self._evaluator = at._evaluator

    @cached_property
    def biases(self) -> Array:
        """Record of bias, gamma, its product with E^-1, and forces without actuators."""
        at, reduction = self._at, self._at.reduction
        external = _concatenated(reduction.external, lambda block: block.bias_acceleration(self._motion), -1)
        biases = np.empty(at.batch, reduction.biases)
        self._evaluator.biases(at.q, at.kinematics, at.inverse, self._v, external, biases)
        return biases

    def acceleration(self, force: Array) -> Array | None:
        """Reduced acceleration under forces (..., nv); None if it is not finite, or if the forces have more axes."""
        at = self._at
        if force.shape[:-1] != at.batch:
            return None
        v2_dot = np.empty((*at.batch, at.reduction._data.r))
        force = np.ascontiguousarray(force)
        return v2_dot if self._evaluator.accelerate(at.inverse, self.biases, force, v2_dot) else None

    @cached_property
    def rates(self) -> Array | None:
        """Record of J1, A_star, the rates of E, R, J1 and A_star, E v and J1 v; None if a row of J1 is undefined."""
        at, reduction = self._at, self._at.reduction
        rows = _concatenated(reduction.external_vertical, lambda block: block.jacobian(at._position), -2)
        stacks = reduction.external, reduction.external_vertical
        at_rates = None if self._motion is None else self._motion.rates()
        external = [_concatenated(each, lambda block: block.jacobian_dot(at_rates), -2) for each in stacks]
        rates = np.empty(at.batch, reduction.rates)
        arguments = at.q, at.kinematics, at.inverse, self._v, rows, *external, rates
        return rates if self._evaluator.rates(*arguments) else None


# ---------------------------------------------------------------------- tables of the kernel


class _RowTable:
    """Rows of E, of J1 and of inputs on frames, as arrays.

    Attributes:
        external, external_vertical: blocks of E and of J1 that Python evaluates.
        rates: right-hand sides mu of the constraint rows (m,).
        integers, numbers: (rows, 8) and (rows, 12); ``frames``: the frames of all rows.
    """

    def __init__(self, data: ReductionData) -> None:
        self._model = data.robot.model
        self.external, stacked = self._of(data.stack)
        self.external_vertical, vertical = self._of(data.vertical)
        parts = data.actuation.parts
        inputs = [] if parts is None else parts[1]
        self.columns = np.array([column for column, _, _ in inputs], dtype=np.int64)
        forces = [KernelRow(Form.OWN, (attached(self._model, frame),), (), np.eye(6)[row]) for _, frame, row in inputs]
        rows = [*stacked, *vertical, *forces]
        self.rates = [row.rate for row in stacked[: data.m]]
        self.frames: list[AttachedFrame] = []
        known: dict[tuple[int, bytes], int] = {}
        self.integers, self.numbers = np.zeros((len(rows), 3 + INTEGERS), np.int64), np.zeros((len(rows), NUMBERS))
        for row, integers, numbers in zip(rows, self.integers, self.numbers, strict=True):
            integers[0], integers[1] = row.form, row.joint
            if row.value[0] != Value.NONE:
                integers[7], integers[6] = row.value
            integers[3 : 3 + len(row.integers)], numbers[: len(row.numbers)] = row.integers, row.numbers
            for place, frame in enumerate(row.frames):
                key = frame.joint, np.array(frame.placement.homogeneous).tobytes()
                if key not in known:
                    known[key] = len(self.frames)
                    self.frames.append(frame)
                integers[1 + place] = known[key]

    def _of(self, stack: RowStack) -> tuple[list[Place], list[KernelRow]]:
        external: list[Place] = []
        rows: list[KernelRow] = []
        count = 0
        for place in stack.places:
            found = place.block.kernel_rows(self._model)
            chosen = (
                np.arange(len(place.block.names))
                if place.rows is None
                else np.arange(len(place.block.names))[place.rows]
            )
            if found is None:
                external.append(place)
                rows += [KernelRow(Form.EXTERNAL, (), (count + k,)) for k in range(len(chosen))]
                count += len(chosen)
            else:
                rows += [found[k] for k in chosen]
        return external, rows


def _python_values(stack: OutputStack, model: pin.Model) -> list[tuple[OutputRows, slice]]:
    """Blocks whose values Python evaluates."""
    found = []
    for block, where, _ in stack.places:
        rows = block.kernel_rows(model)
        if isinstance(block, OutputRows) and not block.quasi and (rows is None or rows[0].value[0] == Value.NONE):
            found.append((block, where))
    return found


def _evaluator(data: ReductionData, table: _RowTable, mu: Array | None, fused: bool) -> Any:
    """The kernel's object, with Pinocchio data of its own."""
    robot, model = data.robot, data.robot.model
    pinocchio = model.createData()
    n, k, joints = data.n, data.vertical.size, model.njoints
    moved = [_entries(model, joint) for joint in range(joints)]
    q, v = robot.configuration(), np.zeros(n)
    views = (
        _view(pinocchio.M, (n, n)),
        _view(pinocchio.J, (6, n)),
        _view(pinocchio.dJ, (6, n)),
        _view(pinocchio.nle, (n,)),
        _view(pinocchio.C, (n, n)),
        _placements(pinocchio, joints),
        q,
        v,
    )
    functions = (pin.crba, pin.nonLinearEffects, pin.computeJointJacobiansTimeVariation, pin.computeCoriolisMatrix)
    references = (model, pinocchio, q, v, pin.Convention.WORLD, *functions, pin.isNormalized, 1e-6, np.empty)
    parts = data.actuation.parts
    constant = np.zeros((n, data.p)) if parts is None else parts[0]
    external = [
        sum(len(place.of(np.arange(len(place.block.names)))) for place in places)
        for places in (table.external, table.external_vertical)
    ]
    sizes = (robot.nq, n, data.m, k, data.p, joints, len(table.frames), *external, len(table.integers))
    placements = np.array([placement_numbers(frame.placement) for frame in table.frames])
    return _kernel.library.Evaluator(
        (*sizes, sum(map(len, moved)), robot.nq != robot.nv, fused),
        references,
        views,
        table.integers,
        table.numbers,
        table.columns,
        np.array([frame.joint for frame in table.frames], np.int64),
        placements,
        np.cumsum([0, *map(len, moved)], dtype=np.int64),
        np.array([entry for entries in moved for entry in entries], np.int64),
        np.ascontiguousarray(np.vstack([data.template, data.vertical.template(n)])),
        np.ascontiguousarray(constant),
        mu,
        np.ascontiguousarray(data.lengths),
        data.fast_length,
        data.fast_limit,
    )


def _entries(model: pin.Model, joint: int) -> list[int]:
    """Entries of v that move a joint."""
    found: list[int] = []
    for support in list(model.supports[joint])[1:]:
        moving = model.joints[support]
        found += range(moving.idx_v, moving.idx_v + moving.nv)
    return found


def _view(array: Array, shape: tuple[int, ...]) -> Array:
    """Pinocchio's memory in a shape; Pinocchio returns matrices with one column as vectors."""
    view = array.reshape(shape, order="F")
    if not np.shares_memory(view, array):
        raise ValueError("Pinocchio's matrices are not stored by columns")
    return view


def _placements(data: pin.Data, joints: int) -> Array:
    """Placements of all joints (12, joints): rotation by columns, then translation."""
    first = data.oMi[0].rotation
    for joint in range(joints):
        place = data.oMi[joint]
        rotation, translation = place.rotation, place.translation
        where = first.ctypes.data + 96 * joint
        if rotation.strides != (8, 24) or (rotation.ctypes.data, translation.ctypes.data) != (where, where + 72):
            raise ValueError("Pinocchio's placements are not stored one after the other")
    return np.lib.stride_tricks.as_strided(first, (12, joints), (8, 96))


def _concatenated(places: Sequence[Place], of: Callable[[Any], Array], axis: int) -> Array | None:
    """Concatenate a quantity of blocks that Python evaluates, along the axis of the rows; None without blocks."""
    if not places:
        return None
    selected = (place.of if axis == -1 else place.of_matrix for place in places)
    values = [select(of(place.block)) for select, place in zip(selected, places, strict=True)]
    return np.ascontiguousarray(np.concatenate(values, axis=axis), dtype=float)


def _record(fields: Mapping[str, tuple[int, ...]]) -> np.dtype[Any]:
    """Type of a record of arrays, one after the other."""
    return np.dtype([(name, float, shape) for name, shape in fields.items()])


# ---------------------------------------------------------------------- comparison with NumPy


def compile_reduction(data: ReductionData) -> CompiledReduction | None:
    """Kernel of a reduction, after a comparison with NumPy at a random state; None if NumPy has to evaluate it."""
    if _kernel.library is None:
        return None
    try:
        found = CompiledReduction(data)
        difference = _difference(found, data)
    except ValueError as error:
        _warn(str(error))
        return None
    if difference is not None and not difference < _TOLERANCE:
        _warn(f"it differs from NumPy by {difference:.1e} (relative), limit {_TOLERANCE:.0e}")
    return found if difference is not None and difference < _TOLERANCE else None


def _warn(why: str) -> None:
    warnings.warn(f"the compiled kernel is not used for this model: {why}", RuntimeWarning, stacklevel=2)


def _difference(found: CompiledReduction, data: ReductionData) -> float | None:
    """Largest relative difference at a random regular state; None if there is none."""
    generator, kinematics = np.random.default_rng(0), Kinematics(data.robot)
    for _ in range(_ATTEMPTS):
        q, v = data.robot.random_configuration(generator), generator.uniform(-1.0, 1.0, data.n)
        rates = kinematics.position(q).with_velocity(v).rates()
        with suppress(SingularityError, NotImplementedError):  # a row is undefined at q, or has no rate
            expected, computed = _by_numpy(data, rates), _by_kernel(found, rates)
            if computed is not None:
                return max(_relative(computed[name], value) for name, value in expected.items())
    return None


def _by_numpy(data: ReductionData, at: RateKinematics) -> dict[str, Array]:
    return {
        "M": at.M,
        "E": data.stack.jacobian(at),
        "bias": at.bias,
        "gamma": data.stack.bias_acceleration(at),
        "E_dot": data.stack.jacobian_dot(at),
        "J1": data.vertical.jacobian(at),
        "J1_dot": data.vertical.jacobian_dot(at),
    }


def _by_kernel(found: CompiledReduction, at: RateKinematics) -> dict[str, Array] | None:
    configuration = found.configuration(at.q, at)
    if configuration is None:
        return None
    state = CompiledState(configuration, at.v, at)
    if state.rates is None:
        return None
    records = configuration.kinematics, configuration.inverse, state.biases, state.rates
    return {name: each[name] for each in records for name in each.dtype.names or ()}


def _relative(found: Array, expected: Array) -> float:
    scale = max(float(np.abs(expected).max(initial=0.0)), 1e-3)
    return float(np.abs(found - expected).max(initial=0.0)) / scale
