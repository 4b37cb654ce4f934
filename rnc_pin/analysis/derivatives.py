"""Derivatives of a reduced system with respect to its state and its inputs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.model.differences import gradient_with_error
from rnc_pin.model.kinematics import Kinematics, VelocityKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.row_stack import RowStack
from rnc_pin.model.rows import Rows


@dataclass(frozen=True)
class StateDerivatives:
    """Derivatives of ``v = R v2 + b`` and ``v2_dot`` at a state, along the tangent space at q.

    ``state_derivatives`` returns it.
    """

    v: Float[Array, nv]
    v2_dot: Float[Array, r]
    v_q: Float[Array, "nv nv"]
    v_v2: Float[Array, "nv r"]
    """R."""
    v2_dot_q: Float[Array, "r nv"]
    v2_dot_v2: Float[Array, "r r"]
    v2_dot_T: Float[Array, "r p"]
    difference_error: float
    """Estimated error of the finite differences in these derivatives [as the rows]; 0.0 if all are in closed form."""


def state_derivatives(reduced: ReducedModel, q: Array, v2: Array, T: Array) -> StateDerivatives:
    """Derivatives of velocity and acceleration of a reduced system by its state and inputs, under the constraints.

    Differentiates ``E v = [mu; v2]``, ``E w + Edot v = [mudot; v2dot]`` with w the full acceleration, and the balance
    ``R^T (H* w + C* v + g* + A^T lambda - B T) = 0``. The multipliers count because R varies. The inertial part is
    Pinocchio's derivative of the recursive Newton-Euler algorithm (Carpentier and Mansard 2018). First derivatives of
    the rows are their exact rates along unit velocities. Each kind of rows provides its second derivatives, which are
    needed only if the system moves.
    Eighth-order differences replace two derivatives only: second derivatives of rows without a closed form (momenta,
    rows and outputs that a user writes), and the derivative of a user's ``B(q)``. ``difference_error`` is their error.

    Args:
        reduced: the model.
        q: configuration (nq,).
        v2: reduced velocity (r,).
        T: actuator inputs (p,).

    Raises:
        InputError, SingularityError: as in every method of ``ReducedModel``.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> found = rnc.state_derivatives(reduced, robot.configuration(), np.array([0.5, 0.2]), np.zeros(reduced.p))
        >>> round(float(found.v2_dot_v2[0, 1] / found.v2_dot[0]), 3)  # 2 over the yaw rate
        10.0
    """
    state = reduced.at(q, v2)
    v2_dot, T = state.v2_dot(T), np.asarray(T, float)
    q, v, E_inverse, M, B, R = state.q, state.v, state.E_inverse, state.M, state.B, state.R
    n, m = reduced.n, reduced.m
    rows = RowStack.joined(reduced.constraints, reduced.reducing)
    along = Kinematics(reduced.robot).position(np.tile(q, (n, 1))).with_velocity(np.eye(n))
    E_q = rows.jacobian_dot(along)  # (nv, nv, nv); the first index is the direction
    B_q, B_error = _actuation_gradient(reduced, along, q)
    mu_q = np.zeros((n, n))
    mu_q[:m] = reduced.constraints.rate_dot(along).T
    Ev_q = np.einsum("jab,b->aj", E_q, v) - mu_q
    E_dot = np.einsum("jab,j->ab", E_q, v)
    w = state.v_dot(v2_dot)
    drift_q, drift_error = _drift_gradient(rows, Kinematics(reduced.robot), q, v)
    Ew_q = np.einsum("jab,b->aj", E_q, w) + drift_q
    Ew_v = E_dot + Ev_q

    model = reduced.robot.model
    data = model.createData()
    tau_q, tau_v, _ = (np.array(each) for each in pin.computeRNEADerivatives(model, data, q, v, w))
    right = B @ T - pin.rnea(model, data, q, v, w)
    multipliers = E_inverse[:, :m].T @ right
    force_q = np.einsum("jab,b->aj", B_q, T) - np.einsum("jab,a->bj", E_q[:, :m], multipliers) - tau_q

    # A change of q also changes the velocity, by v_q, so that the rows keep their values.
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
        difference_error=B_error * float(np.abs(T).sum()) + drift_error,
    )


def _actuation_gradient(reduced: ReducedModel, along: VelocityKinematics, q: Array) -> tuple[Array, float]:
    """Derivatives of B, (nv, nv, p), and their error; the first index is the direction."""
    rate = reduced.actuation.matrix_rate(along)
    if rate is not None:
        return rate, 0.0
    kinematics = Kinematics(reduced.robot)

    def matrix(p: Array) -> Array:
        return np.array(reduced.actuation.matrix(kinematics.position(p)))

    differences, error = gradient_with_error(reduced.robot.model, matrix, q)
    return np.moveaxis(differences, -1, 0), error


def _drift_gradient(rows: RowStack, kinematics: Kinematics, q: Array, v: Array) -> tuple[Array, float]:
    """Derivative (nv, nv) of ``Edot v - mudot`` with respect to q at fixed v, and the error of finite differences."""
    out, error = np.zeros((rows.size, kinematics.nv)), 0.0
    if not v.any():
        return out, error
    gradients = kinematics.position(q).with_velocity(v)
    for place in rows.places:
        block = place.block
        whole = None if block.affine else block.bias_acceleration_gradient(gradients)
        if whole is None:
            whole, found = _differences(block, kinematics, q, v)
            error = max(error, found)
        out[place.where] = place.of_matrix(whole)
    return out, error


def _differences(block: Rows, kinematics: Kinematics, q: Array, v: Array) -> tuple[Array, float]:
    def bias_acceleration(p: Array) -> Array:
        rates = kinematics.position(p).with_velocity(v)
        return block.jacobian_dot(rates) @ v - block.rate_dot(rates)

    return gradient_with_error(kinematics.model, bias_acceleration, q)
