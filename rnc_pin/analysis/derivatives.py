"""Derivatives of a reduced system with respect to its state and its inputs."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import InputError
from rnc_pin.model.configuration_evaluation import no_time
from rnc_pin.model.input_validation import ArrayInput, vector
from rnc_pin.model.kinematics import Kinematics, VelocityKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import Rows, RowStack
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.user_functions import gradient_with_error
from rnc_pin.printing import printed


@printed()
@dataclass(frozen=True)
class StateDerivatives:
    """Derivatives of ``v = R v2 + b`` and ``v2_dot`` at states, along the tangent space at q.

    ``state_derivatives`` returns it.
    """

    v: Float[Array, "*batch nv"]
    v2_dot: Float[Array, "*batch r"]
    v_q: Float[Array, "*batch nv nv"]
    v_v2: Float[Array, "*batch nv r"]
    """R."""
    v2_dot_q: Float[Array, "*batch r nv"]
    v2_dot_v2: Float[Array, "*batch r r"]
    v2_dot_T: Float[Array, "*batch r p"]
    difference_error: Float[Array, "*batch"] | float
    """Estimated error of the finite differences in these derivatives [as the rows]; 0.0 if all are in closed form."""


def state_derivatives(
    reduced: ReducedModel, q: ArrayInput, v2: ArrayInput, T: ArrayInput, *, t: ArrayInput | None = None
) -> StateDerivatives:
    """Derivatives of velocity and acceleration of a reduced system by its state and inputs, under the constraints.

    Differentiates ``E v = [mu; v2]``, ``E w + Edot v = [mudot; v2dot]`` with w the full acceleration, and the balance
    ``R^T (H* w + C* v + g* + A^T lambda - B T) = 0``. The multipliers count because R varies. The inertial part is
    Pinocchio's derivative of the recursive Newton-Euler algorithm (Carpentier and Mansard 2018). All built-in
    constraints, outputs and actuators are in closed form; the compiled kernel evaluates them if it is available.
    Eighth-order differences replace derivatives of functions of a user only: second derivatives of rows and outputs,
    and the first ones of ``B(q)`` and of forces without slopes. They replace all derivatives for a robot with joints
    whose axes depend on their own position (universal and composite joints). ``difference_error`` is their error.

    Args:
        reduced: the model.
        q: configurations (..., nq).
        v2: reduced velocities (..., r).
        T: actuator inputs (..., p).
        t: times (...) of the states [s], at which constraints over time are differentiated; others ignore them.

    Raises:
        InputError, SingularityError: as in every method of ``ReducedModel``.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> found = rnc.state_derivatives(reduced, robot.configuration(), np.array([0.5, 0.2]), np.zeros(reduced.p))
        >>> round(float(found.v2_dot_v2[0, 1] / found.v2_dot[0]), 3)  # 2 over the yaw rate
        10.0
        >>> rnc.state_derivatives(reduced, robot.configuration(), np.zeros((4, 2)), np.zeros(reduced.p)).v_q.shape
        (4, 3, 3)
    """
    found = _compiled(reduced, q, v2, T, t)
    if found is not None:
        return found
    state, T = reduced.at(q, v2, t=t), vector(T, reduced.p, "T")
    states = state.q.shape[:-1]
    if state.t is None and reduced.rheonomic:
        raise no_time(reduced.reduction_data)
    if not states and T.ndim == 1:
        return _read_only(_at_one_state(reduced, state, T))
    try:
        # Compiled code takes flat arrays of states, of one shape.
        batch = np.broadcast_shapes(states, T.shape[:-1])
    except ValueError:
        raise InputError(f"T of shape {T.shape} does not broadcast to states of shape {states}") from None
    flat = [_flat(each, batch) for each in (state.q, state.v2, T)]
    found = _compiled(reduced, flat[0], flat[1], flat[2], t)
    if found is None:
        # Kinds of rows without compiled code: one state after the other.
        times = [None] * len(flat[0]) if state.t is None else np.broadcast_to(state.t, batch).ravel().tolist()
        states_at = zip(*flat, times, strict=True)
        found = _stacked([state_derivatives(reduced, *each, t=time) for *each, time in states_at], reduced)
    whole = {name: value.reshape(*batch, *value.shape[1:]) for name, value in vars(found).items()}
    return _read_only(StateDerivatives(**whole))


def _read_only(found: StateDerivatives) -> StateDerivatives:
    """The same derivatives as read-only arrays, such as the kernel returns."""
    for value in vars(found).values():
        if isinstance(value, Array):
            value.setflags(write=False)
    return found


def _compiled(
    reduced: ReducedModel, q: ArrayInput, v2: ArrayInput, T: ArrayInput, t: ArrayInput | None
) -> StateDerivatives | None:
    """Derivatives from one call of the kernel, of one state or a stack of states; None if formulas have to decide."""
    evaluator, kernel = reduced.evaluator, reduced.evaluator.kernel
    if kernel is None or not type(q) is type(v2) is type(T) is Array:
        return None
    numbers = kernel.calls.state_derivatives(q, v2, T, evaluator.rates_at(t, q))
    if numbers is None:
        return None
    count, numbers.flags.writeable = numbers.shape[:-1], False
    record = np.ndarray(count, kernel.derivatives, numbers)
    found = {name: record[name] for name in kernel.derivatives.names or ()}
    return StateDerivatives(**found, difference_error=np.zeros(count) if count else 0.0)


def _flat(values: Array, batch: tuple[int, ...]) -> Array:
    # The kernel takes rows that follow each other in memory.
    wide = np.broadcast_to(values, (*batch, values.shape[-1]))
    return np.ascontiguousarray(wide.reshape(int(np.prod(batch)), values.shape[-1]))


def _stacked(found: list[StateDerivatives], reduced: ReducedModel) -> StateDerivatives:
    n, r, p = reduced.n, reduced.r, reduced.p
    shapes = ((n,), (r,), (n, n), (n, r), (r, n), (r, r), (r, p), ())
    values = ([getattr(each, field.name) for each in found] for field in fields(StateDerivatives))
    stacks = [np.reshape(each, (len(found), *shape)) for each, shape in zip(values, shapes, strict=True)]
    return StateDerivatives(*stacks)


def _at_one_state(reduced: ReducedModel, state: StateEvaluation, T: Array) -> StateDerivatives:
    """Reference of the compiled kernel. Derivatives by q of rows over time are those at a constant time."""
    reduced, state = _smooth_at(reduced, state)
    if not reduced.reduction_data.kinematics.axes_are_constant:
        return _by_differences(reduced, state, T)
    q, v, n, m, v2_dot = state.q, state.v, reduced.n, reduced.m, state.v2_dot(T)
    w = state.v_dot(v2_dot)
    rows = reduced.reduction_data.stack
    time = reduced.reduction_data.kinematics.time if state.t is None else float(np.asarray(state.t))
    kinematics = Kinematics(reduced.robot, time)
    # Rates along the n unit velocities are the derivatives by q: one batch gives the whole tensor.
    along = kinematics.position(np.tile(q, (n, 1))).with_velocity(np.eye(n))
    still = kinematics.position(q).with_velocity(np.zeros(n))  # rates of rows over time that do not move
    E_t = rows.jacobian_dot(still) if rows.turning else np.zeros((n, n))
    E_q = rows.jacobian_dot(along) - E_t  # (nv, nv, nv); the first index is the direction
    B_q, B_error = _actuation_gradient(reduced, along, q)
    mu_q = np.zeros((n, n))
    mu_q[:m] = (reduced.constraints.rate_dot(along) - reduced.constraints.rate_dot(still)).T
    # Derivatives of E v and of E w + Edot v at fixed v and w.
    Ev_q = np.einsum("jab,b->aj", E_q, v) - mu_q
    Ew_v = np.einsum("jab,j->ab", E_q, v) + E_t + Ev_q
    drift_q, error = _drift_gradient(rows, Kinematics(reduced.robot, kinematics.time), q, v)
    Ew_q = np.einsum("jab,b->aj", E_q, w) + drift_q

    model = reduced.robot.model
    data = model.createData()
    tau_q, tau_v, _ = (np.array(each).reshape(n, n) for each in pin.computeRNEADerivatives(model, data, q, v, w))
    # H* w + C* v + g* at a fixed acceleration w, whose change by q follows from the rows.
    forces = np.array(pin.rnea(model, data, q, v, w))
    if reduced.reduction_data.forces:
        found = reduced.reduction_data.forces.gradient(state.motion, along)
        forces, tau_q, tau_v = forces - state.passive_force, tau_q - found.q, tau_v - found.v
        error += found.error
    # An error in a column of B acts with the input of that column.
    error += B_error * float(np.abs(T).sum())
    E_inverse, M, B, R = state.E_inverse, state.M, state.B, state.R
    # R^T times the balance has no multipliers, but R moves with q: its derivative acts on the whole force.
    multipliers = E_inverse[:, :m].T @ (B @ T - forces)
    force_q = np.einsum("jab,b->aj", B_q, T) - np.einsum("jab,a->bj", E_q[:, :m], multipliers) - tau_q

    # A change of q also changes the velocity, by v_q, so that the rows keep their values.
    v_q = -E_inverse @ Ev_q
    # Projected by R^T, the change of the balance gives the change of v2dot, without that of the multipliers.
    H_inverse_Rt = np.linalg.solve(R.T @ M @ R, R.T)
    a_v = M @ E_inverse @ Ew_v - tau_v
    a_q = force_q + M @ E_inverse @ Ew_q + a_v @ v_q
    by_state = H_inverse_Rt @ a_q, H_inverse_Rt @ (a_v @ R)
    return StateDerivatives(state.v, v2_dot, v_q, R, *by_state, H_inverse_Rt @ B, error)


def _smooth_at(reduced: ReducedModel, state: StateEvaluation) -> tuple[ReducedModel, StateEvaluation]:
    """The model with the rows that E has at the state, at a constant time if that is needed."""
    constant = reduced.reduction_data.kinematics.axes_are_constant
    if reduced.rheonomic and (state.factorization.kept is not None or not constant):
        reduced = reduced.frozen(float(np.asarray(state.t)))
        state = reduced.at(state.q, state.v2)
    if state.configuration.factorization.kept is not None:  # E has other rows at q than by default
        # Selected rows are those of the state: nearby states with other rows would not be differentiable.
        reduced = reduced.with_basis_at(state.q)
        state = reduced.at(state.q, state.v2)
    return reduced, state


def _by_differences(reduced: ReducedModel, state: StateEvaluation, T: Array) -> StateDerivatives:
    model, q, v2 = reduced.robot.model, state.q, state.v2
    # Where axes of joints move in their bodies, Pinocchio's derivatives are wrong: only differences remain.
    at = state.configuration

    v_q, v_error = gradient_with_error(model, lambda p: np.array(reduced.at(p, v2).v), q)
    v2_dot_q, error = gradient_with_error(model, lambda p: np.array(reduced.at(p, v2).v2_dot(T)), q)
    # Accelerations are quadratic in v2, so that central differences with unit steps are exact.
    ahead, behind = (reduced.at(q, v2 + sign * np.eye(reduced.r)).v2_dot(T) for sign in (1.0, -1.0))
    by_v2, by_T = (ahead - behind).T / 2, np.linalg.solve(at.H, at.input_matrix)
    return StateDerivatives(state.v, state.v2_dot(T), v_q, at.R, v2_dot_q, by_v2, by_T, max(v_error, error))


def _actuation_gradient(reduced: ReducedModel, along: VelocityKinematics, q: Array) -> tuple[Array, float]:
    """Derivatives of B, (nv, nv, p), and their error; the first index is the direction."""
    rate = reduced.actuation.matrix_rate(along)
    if rate is not None:
        return rate, 0.0
    place, B = Kinematics(reduced.robot).position, reduced.actuation.matrix
    differences, error = gradient_with_error(reduced.robot.model, lambda p: np.array(B(place(p))), q)
    return np.moveaxis(differences, -1, 0), error


def _drift_gradient(rows: RowStack, kinematics: Kinematics, q: Array, v: Array) -> tuple[Array, float]:
    """Derivative (nv, nv) of ``Edot v - mudot`` with respect to q at fixed v, and the error of finite differences."""
    out, error = np.zeros((rows.size, kinematics.nv)), 0.0
    # The drift is quadratic in v: at rest its derivative is zero, and user functions need no differences.
    if not (v.any() or rows.rheonomic):
        return out, error
    gradients = kinematics.position(q).with_velocity(v)
    for place in rows.places:
        block = place.block
        whole = block.bias_acceleration_gradient(gradients)
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
