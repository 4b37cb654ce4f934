"""The square stack ``E = [A; J2]`` of a reduction: evaluated state by state, inverted, checked.

What arrays may come in, and what Pinocchio computes for them, is decided here; the formulas are in ``reduction``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import prod
from typing import Any

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.errors import InputError, SingularityError
from rnc_pin.math.linear_algebra import apply, condition_number, inverse, row_conditions, unit_rows
from rnc_pin.model.actuation import Actuation
from rnc_pin.model.assembly import Assembly
from rnc_pin.model.independence import DroppedRow
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputStack, RowStack
from rnc_pin.robots.robot import Robot

ArrayInput = Any  # whatever NumPy makes a float array of


class Stack:
    """Constraint rows above reducing outputs, with the inertia and the actuation matrix beside them.

    Leading batch axes are looped over with one Pinocchio workspace; a single state writes into buffers that are
    kept, and costs no loop.
    """

    def __init__(
        self,
        robot: Robot,
        constraints: RowStack,
        actuation: Actuation,
        reducing: OutputStack,
        vertical: OutputStack,
        singularity_limit: float,
        dropped_rows: Sequence[DroppedRow] = (),
        assembly: Assembly | None = None,
    ) -> None:
        self.robot = robot
        self.constraints = constraints
        self.actuation = actuation
        self.reducing = reducing
        self.vertical = vertical
        self.singularity_limit = singularity_limit
        self.dropped_rows = tuple(dropped_rows)
        self.assembly = Assembly(robot, ()) if assembly is None else assembly
        self.affine = constraints.affine
        self.n, self.m, self.r, self.p = robot.nv, constraints.size, reducing.size, actuation.size
        self._square_limit = singularity_limit**2
        self._basis = (..., slice(self.m, None))  # of E^-1: the columns that are R
        self._rows = RowStack.joined(constraints, reducing)  # E
        self._state = Kinematics(robot)
        self._nq = robot.nq
        self._check_norm = not all(joint.nq == joint.nv for joint in list(robot.model.joints)[1:])
        # Workspace of the single state: views made once, constant rows written once.
        self._E, self._gamma = np.empty((self.n, self.n), order="F"), np.empty(self.n)
        self._E_flat = self._E.ravel("K")  # a view
        self._rows.prepare(self._state, self._E, self._gamma)

    # ------------------------------------------------------------------ how regular it is

    def condition(self, q: ArrayInput) -> Array | float:
        """Condition number (...) of E with unit rows: how well x2 parametrises the motion at q."""
        return condition_number(self._position(self._admit(q))[0])

    def smallest_singular_value(self, q: ArrayInput) -> Array | float:
        """Smallest singular value (...) of E with unit rows; zero at a singular configuration."""
        return np.linalg.svd(unit_rows(self._position(self._admit(q))[0]), compute_uv=False)[..., -1]

    def stacked_rows(self, q: ArrayInput) -> Float[Array, "*batch nv nv"]:
        """``E = [A; J2]``, constraint rows above reducing outputs; raises at no singular configuration."""
        return self._position(self._admit(q))[0].copy()

    # ------------------------------------------------------------------ Pinocchio, state by state

    def stack(self, q: Array) -> tuple[Array, Array, Array]:
        """E^-1 (..., nv, nv), H* (..., nv, nv) and B (..., nv, p) at admitted configurations (..., nq).

        Raises:
            SingularityError: E cannot be inverted; names the dependent rows.
        """
        E, M, B = self._position(q)
        E_inverse = inverse(E)
        if E.ndim == 2:
            # The product of Frobenius norms bounds every row's condition: one cheap test on the hot path.
            flat = E_inverse.ravel("K")
            if self._E_flat.dot(self._E_flat) * flat.dot(flat) < self._square_limit:
                return E_inverse, M, B
        self._check_regular(q, E, E_inverse)
        return E_inverse, M, B

    def _position(self, q: Array) -> tuple[Array, Array, Array]:
        state, rows, actuation = self._state, self._rows, self.actuation
        if q.ndim == 1:
            state.set_position(q)
            rows.jacobian(state, self._E)
            return self._E, state.M, actuation.matrix(state)
        batch, n = q.shape[:-1], self.n
        E, M, B = np.empty((*batch, n, n)), np.empty((*batch, n, n)), actuation.constant
        rows.prepare(state, E, np.empty((*batch, n)))
        if B is not None:
            for q_i, E_i, M_i in self._states(q, E, M):
                state.set_position(q_i)
                rows.jacobian(state, E_i)
                M_i[...] = state.M
            return E, M, B
        B = np.empty((*batch, n, self.p))
        for q_i, E_i, M_i, B_i in self._states(q, E, M, B):
            state.set_position(q_i)
            rows.jacobian(state, E_i)
            M_i[...] = state.M
            B_i[...] = actuation.matrix(state)
        return E, M, B

    def _drift(self, q: Array, v: Array) -> tuple[Array, Array]:
        """``Edot v - [mudot; 0]`` (..., nv) and the nonlinear effects (..., nv)."""
        state, rows = self._state, self._rows
        if q.ndim == 1:
            state.set_velocity(q, v)
            rows.drift(state, self._gamma)
            return self._gamma, state.bias
        gamma, bias = np.zeros(v.shape), np.empty(v.shape)
        for q_i, v_i, gamma_i, bias_i in self._states(q, v, gamma, bias):
            state.set_velocity(q_i, v_i)
            rows.drift(state, gamma_i)
            bias_i[...] = state.bias
        return gamma, bias

    def _rates(self, q: Array, v: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Edot, C*, g*, A, J1 and J1dot."""
        batch, n, k = q.shape[:-1], self.n, self.vertical.size
        E_dot, C, g = np.empty((*batch, n, n)), np.empty((*batch, n, n)), np.empty((*batch, n))
        A, J1, J1_dot = np.empty((*batch, self.m, n)), np.empty((*batch, k, n)), np.empty((*batch, k, n))
        state = self._state
        for q_i, v_i, E_i, C_i, g_i, A_i, J_i, Jd_i in self._states(q, v, E_dot, C, g, A, J1, J1_dot):
            state.set_rates(q_i, v_i)
            A_i[...] = self.constraints.evaluate(state)
            self._rows.jacobian_dot(state, E_i)
            J_i[...] = self.vertical.evaluate(state)
            self.vertical.jacobian_dot(state, Jd_i)
            C_i[...] = state.C
            g_i[...] = state.bias - apply(state.C, v_i)
        return E_dot, C, g, A, J1, J1_dot

    def _states(self, q: Array, *arrays: Array) -> Iterable[tuple[Array, ...]]:
        """One tuple a state: views of q and of every array; a single state is one tuple."""
        if q.ndim == 1:
            return ((q, *arrays),)
        if q.ndim > 2:
            depth, count = q.ndim - 1, prod(q.shape[:-1])
            return zip(*(each.reshape(count, *each.shape[depth:]) for each in (q, *arrays)), strict=True)
        return zip(q, *arrays, strict=True)

    # ------------------------------------------------------------------ the boundary

    def _admit(self, q: ArrayInput, beside: Array | None = None) -> Array:
        """A float array q (..., nq), one for each entry of ``beside``; unit complex numbers and quaternions checked."""
        q = np.asarray(q, float)  # by position: a keyword costs as much as the call
        if q.ndim == 0 or q.shape[-1] != self._nq:
            raise InputError(f"q has shape {q.shape}, expected (..., {self._nq})")
        if beside is not None and beside.shape[:-1] != q.shape[:-1]:
            try:
                batch = np.broadcast_shapes(beside.shape[:-1], q.shape[:-1])
            except ValueError:
                raise InputError(f"q of shape {q.shape} and v2 of shape {beside.shape} do not go together") from None
            # One configuration for many velocities: spread it, so that the loops run over pairs.
            q = np.ascontiguousarray(np.broadcast_to(q, (*batch, self._nq)))
        if self._check_norm:
            for (q_i,) in self._states(q):
                if not pin.isNormalized(self._state.model, q_i, 1e-6):
                    self._explain_not_finite(q)
                    raise InputError("q holds a (cos, sin) pair or a quaternion that is not of unit length")
        return q

    def _shaped(self, array: ArrayInput, size: int, name: str) -> Array:
        array = np.asarray(array, float)
        if array.ndim == 0 or array.shape[-1] != size:
            raise InputError(f"{name} has shape {array.shape}, expected (..., {size})")
        return array

    def _explain_not_finite(self, q: Array, **others: Array) -> None:
        for name, array in {"q": q, **others}.items():
            if not np.isfinite(array).all():
                raise InputError(f"{name} holds values that are not finite: {np.array2string(array, precision=4)}")

    def _check_regular(self, q: Array, E: Array, E_inverse: Array) -> None:
        with np.errstate(invalid="ignore", over="ignore"):
            conditions = row_conditions(E, E_inverse)
        good = (conditions < self.singularity_limit).all(axis=-1)
        if good.all():
            return
        self._explain_not_finite(q)
        first = np.unravel_index(int(np.argmin(good)), good.shape) if good.ndim else ()
        raise SingularityError(
            "singular configuration",
            q=q[first].copy(),
            condition=float(condition_number(E[first])),
            rows=self.dependent_rows(E[first]),
        )

    def dependent_rows(self, E: Array) -> Sequence[str]:
        """Names of the rows that take part in the weakest combination of a stack (nv, nv)."""
        left = np.linalg.svd(unit_rows(E))[0][:, -1]
        return [
            name for name, weight in zip(self._rows.names, np.abs(left), strict=True) if weight > 0.1 * max(abs(left))
        ]
