"""Derivatives of a reduced system with respect to its state and its inputs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.analysis.differences import gradient_with_error
from rnc_pin.model.actuation import Actuation
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduction import ReducedModel
from rnc_pin.model.rows import Rows, RowStack


@dataclass(frozen=True)
class StateDerivatives:
    """Derivatives of ``v = R v2 + b`` and ``v2_dot`` at a state, along the tangent space at q."""

    v: Float[Array, nv]
    v2_dot: Float[Array, r]
    v_q: Float[Array, "nv nv"]
    v_v2: Float[Array, "nv r"]
    """R."""
    v2_dot_q: Float[Array, "r nv"]
    v2_dot_v2: Float[Array, "r r"]
    v2_dot_T: Float[Array, "r p"]
    difference_error: float
    """Estimated error of the differences that went into these [as the rows]; 0.0 where everything is in closed form."""


def state_derivatives(reduced: ReducedModel, q: Array, v2: Array, T: Array) -> StateDerivatives:
    """How velocity and acceleration of a reduced system depend on its state and inputs, constraints kept.

    Differentiates ``E v = [mu; v2]``, ``E w + Edot v = [mudot; v2dot]`` with w the full acceleration, and the balance
    ``R^T (H* w + C* v + g* + A^T lambda - B T) = 0``, in which the multipliers count since R varies. The
    inertial part is Pinocchio's derivative of the recursive Newton-Euler algorithm (Carpentier and Mansard 2018). First
    derivatives of the rows are their exact rates along unit velocities; second ones, needed only where the system
    moves, come from each kind of rows.
    Eighth-order differences stand in for two things only: second derivatives of rows without a closed form (momenta,
    rows and outputs that a user writes), and the derivative of a user's ``B(q)``; ``difference_error`` says how good.

    Args:
        reduced: the model.
        q: configuration (nq,).
        v2: reduced velocity (r,).
        T: actuator inputs (p,).

    Raises:
        InputError, SingularityError: as every method of ``ReducedModel``.
    """
    v2_dot = reduced.forward_dynamics(q, v2, T)
    q, v2, T = np.asarray(q, float), np.asarray(v2, float), np.asarray(T, float)
    E_inverse, M, B = (np.array(each) for each in reduced.stack(q))
    m, R = reduced.m, E_inverse[:, reduced.m :]
    v = reduced.velocity(q, v2)
    state = Kinematics(reduced.robot)
    rows = RowStack.joined(reduced.constraints, reduced.reducing)
    E_q, B_q, B_error = _rates_along_axes(rows, reduced.actuation, state, q)
    mu_q = _demand_gradient(reduced, state, q)
    Ev_q = np.einsum("jab,b->aj", E_q, v) - mu_q
    E_dot = np.einsum("jab,j->ab", E_q, v)
    w = R @ v2_dot - E_inverse @ (E_dot @ v - mu_q @ v)
    drift_q, drift_error = _drift_gradient(rows, state, q, v)
    Ew_q = np.einsum("jab,b->aj", E_q, w) + drift_q
    Ew_v = E_dot + Ev_q

    data = state.data
    tau_q, tau_v, _ = (np.array(each) for each in pin.computeRNEADerivatives(state.model, data, q, v, w))
    right = B @ T - pin.rnea(state.model, data, q, v, w)
    multipliers = E_inverse[:, :m].T @ right
    force_q = np.einsum("jab,b->aj", B_q, T) - np.einsum("jab,a->bj", E_q[:, :m], multipliers) - tau_q

    # Along a change of q the velocity changes too, by v_q, so that the rows keep their values.
    v_q = -E_inverse @ Ev_q
    H_inverse_Rt = np.linalg.solve(R.T @ M @ R, R.T)
    a_v = M @ E_inverse @ Ew_v - tau_v
    a_q = force_q + M @ E_inverse @ Ew_q + a_v @ v_q
    return StateDerivatives(
        v=v,
        v2_dot=v2_dot,
        v_q=v_q,
        v_v2=R,
        v2_dot_q=H_inverse_Rt @ a_q,
        v2_dot_v2=H_inverse_Rt @ (a_v @ R),
        v2_dot_T=H_inverse_Rt @ B,
        difference_error=max(B_error * float(np.abs(T).max(initial=0.0)), drift_error),
    )


def _rates_along_axes(rows: RowStack, actuation: Actuation, state: Kinematics, q: Array) -> tuple[Array, Array, float]:
    """Derivatives of E, (nv, nv, nv), and of B, (nv, nv, p), the first index that of the direction; error of B's."""
    n = state.model.nv
    E_q, B_q = np.empty((n, rows.size, n)), np.empty((n, n, actuation.size))
    known = True
    for direction, E_j, B_j in zip(np.eye(n), E_q, B_q, strict=True):
        state.set_rates(q, direction)
        rows.jacobian_dot(state, E_j)
        rate = actuation.matrix_rate(state)
        known = rate is not None
        if rate is not None:
            B_j[...] = rate
    if known:
        return E_q, B_q, 0.0

    def matrix(p: Array) -> Array:
        state.set_position(p)
        return np.array(actuation.matrix(state))

    differences, error = gradient_with_error(state.model, matrix, q)
    return E_q, np.moveaxis(differences, -1, 0), error


def _demand_gradient(reduced: ReducedModel, state: Kinematics, q: Array) -> Array:
    """Derivative of ``[mu; 0]``, what ``E v`` has to be at zero v2, (nv, nv)."""
    out = np.zeros((reduced.n, reduced.n))
    if reduced.affine:
        for direction, column in zip(np.eye(reduced.n), out.T, strict=True):
            state.set_rates(q, direction)
            reduced.constraints.rate_dot(state, column[: reduced.m])
    return out


def _drift_gradient(rows: RowStack, state: Kinematics, q: Array, v: Array) -> tuple[Array, float]:
    """Derivative of ``Edot v - mudot`` with respect to q, v fixed, (nv, nv); error of the part found by differences."""
    out, error = np.zeros((rows.size, state.model.nv)), 0.0
    if not v.any():
        return out, error
    for block, place, selection in rows.places:
        state.set_gradients(q, v)
        whole = None if block.affine else block.drift_gradient(state)
        if whole is None:
            whole, found = _differences(block, state, q, v)
            error = max(error, found)
        out[place] = whole if selection is None else whole[selection]
    return out, error


def _differences(block: Rows, state: Kinematics, q: Array, v: Array) -> tuple[Array, float]:
    def drift(p: Array) -> Array:
        state.set_rates(p, v)
        return block.jacobian_dot(state) @ v - block.rate_dot(state)

    return gradient_with_error(state.model, drift, q)
