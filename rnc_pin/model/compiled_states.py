"""Quantities at configurations and states, in records that the compiled kernel fills."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy import ndarray as Array

from rnc_pin.math.components import Component
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.row_stack import Place

if TYPE_CHECKING:
    from rnc_pin.model.compiled import CompiledReduction


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

    def allocate(self, F: Array) -> Array | None:
        """Actuator inputs (..., p) for reduced forces (..., r); None if the other path has to decide."""
        data = self.reduction._data
        if data.p != data.r or not self.reduction.has_inputs or F.shape[:-1] != self.batch:
            return None
        T = np.empty(F.shape)
        force = np.ascontiguousarray(F)
        return T if self._evaluator.allocate(self.q, self.kinematics, self.inverse, force, T) else None

    def output_slopes(self, along: Sequence[int] | Array) -> Array | None:
        """Rates (s, k, r) of A_star in the motions of single reducing outputs; None if the other path has to decide."""
        data = self.reduction._data
        if self.batch or self.reduction.python_rows or data.affine or not len(along):
            return None
        rates = empty_records((len(along),), self.reduction.rates)
        for place, j in enumerate(along):
            v = self.E_inverse[:, data.m + j].copy()
            record = rates[place : place + 1]
            if not self._evaluator.rates(self.q, self.kinematics, self.inverse, v, None, None, None, record):
                return None
        return rates["A_star_dot"]

    @cached_property
    def vertical(self) -> Array | None:
        """Record of J1 and A_star; None if a row is undefined."""
        external = concatenated(self.reduction.external_vertical, lambda block: block.jacobian(self._position), -2)
        rows = empty_records(self.batch, self.reduction.rows)
        return rows if self._evaluator.vertical(self.q, self.kinematics, self.inverse, external, rows) else None


class CompiledState:
    """Quantities at states.

    Args:
        at: the configurations.
        v: full velocities (..., nv).
        motion: kinematics at the states; None if ``python_rows`` is False.
        t: times (...) for constraints that depend on them [s].
    """

    def __init__(
        self,
        at: CompiledConfiguration,
        v: Array,
        motion: VelocityKinematics | None,
        t: Component | None = None,
    ) -> None:
        self.at, self._v, self._motion, self._t = at, np.ascontiguousarray(v), motion, t
        self._evaluator = at._evaluator

    @cached_property
    def biases(self) -> Array:
        """Record of bias, gamma, its product with E^-1, and forces without actuators."""
        at, reduction = self.at, self.at.reduction
        external = concatenated(reduction.external, lambda block: block.bias_acceleration(self._motion), -1)
        biases = empty_records(at.batch, reduction.biases)
        drift = reduction.drift(self._t, at.batch)
        self._evaluator.biases(at.q, at.kinematics, at.inverse, self._v, external, drift, biases)
        return biases

    def acceleration(self, force: Array) -> Array | None:
        """Reduced acceleration under forces (..., nv); None if it is not finite, or if the forces have more axes."""
        at = self.at
        if force.shape[:-1] != at.batch:
            return None
        v2_dot = np.empty((*at.batch, at.reduction._data.r))
        force = np.ascontiguousarray(force)
        return v2_dot if self._evaluator.accelerate(at.inverse, self.biases, force, v2_dot) else None

    @cached_property
    def passive(self) -> tuple[Array, Array] | None:
        """Forces that follow from the state, and those of springs (..., nv); None if Python evaluates them."""
        if not self.at.reduction.fused:
            return None
        found = np.empty((*self._v.shape[:-1], 2, self._v.shape[-1]))
        if not self._evaluator.passive_forces(self.at.q, self.at.kinematics, self._v, found):
            return None
        found.setflags(write=False)
        return found[..., 0, :], found[..., 1, :]

    @cached_property
    def row_velocities(self) -> Array:
        """Rates ``E v`` of the constraint rows and of the reducing outputs, (..., nv)."""
        if "rates" in vars(self) and self.rates is not None:
            return self.rates["velocities"]
        velocities = np.empty(self._v.shape)
        self._evaluator.row_velocities(self.at.inverse, False, self._v, velocities)
        return velocities

    @cached_property
    def v1(self) -> Array | None:
        """Rates of the vertical outputs ``J1 v``, (..., k); None if a row of J1 is undefined."""
        if "rates" in vars(self):
            return None if self.rates is None else self.rates["v1"]
        rows = self.at.vertical
        if rows is None:
            return None
        v1 = np.empty((*self.at.batch, self.at.reduction._data.vertical.size))
        self._evaluator.row_velocities(rows, True, self._v, v1)
        return v1

    @cached_property
    def rates(self) -> Array | None:
        """Record of J1, A_star, the rates of E, R, J1 and A_star, E v and J1 v; None if a row of J1 is undefined."""
        at, reduction = self.at, self.at.reduction
        rows = concatenated(reduction.external_vertical, lambda block: block.jacobian(at._position), -2)
        stacks = reduction.external, reduction.external_vertical
        at_rates = None if self._motion is None else self._motion
        external = [concatenated(each, lambda block: block.jacobian_dot(at_rates), -2) for each in stacks]
        rates = empty_records(at.batch, reduction.rates)
        arguments = at.q, at.kinematics, at.inverse, self._v, rows, *external, rates
        return rates if self._evaluator.rates(*arguments) else None


def concatenated(places: Sequence[Place], of: Callable[[Any], Array], axis: int) -> Array | None:
    """Concatenate a quantity of blocks that Python evaluates, along the axis of the rows; None without blocks."""
    if not places:
        return None
    selected = (place.of if axis == -1 else place.of_matrix for place in places)
    values = [select(of(place.block)) for select, place in zip(selected, places, strict=True)]
    return np.ascontiguousarray(np.concatenate(values, axis=axis), dtype=float)


def empty_records(shape: tuple[int, ...], record: np.dtype[Any]) -> Array:
    """Records without values; NumPy's ``empty`` takes several times as long for a type with fields."""
    return np.ndarray(shape, record, np.empty((*shape, record.itemsize // 8)))
