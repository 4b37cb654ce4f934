"""Regressor of the reduced dynamics: they are linear in the inertial parameters of the bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.model.input_validation import ArrayInput, vector
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.printing import printed
from rnc_pin.robots.robot import Robot

_INERTIAL = ("m", "m x", "m y", "m z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz")
"""Parameters of a body in Pinocchio's order: mass, first moments, moments of inertia about the origin of the joint."""


@printed()
@dataclass(frozen=True)
class ReducedRegressor:
    """Columns of the reduced dynamics ``F = matrix @ p`` at states, for parameters p of the bodies.

    The multipliers of all constraints are absent, because ``A R = 0``: those of wheels and of closed loops alike.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> reduced = rnc.NonholonomicSystem(robot, (), robot.joint_names[1:]).reduce()
        >>> q, v2, v2_dot = robot.configuration({"joint_2": 1.0}), np.ones(4), np.zeros(4)
        >>> regressor = reduced.regressor(q, v2, v2_dot)
        >>> regressor.names[:2], regressor.matrix.shape
        (('m of platform', 'm x of platform'), (4, 40))
        >>> np.allclose(regressor.matrix @ regressor.parameters, reduced.inverse_dynamics(q, v2, v2_dot))
        True
    """

    matrix: Float[Array, "*batch r columns"]
    """Derivative of the reduced forces F with respect to the parameters."""
    names: tuple[str, ...]
    """Names of the columns: ten of each body, e.g. ``I_zz of joint_1``, then the motor inertias that the robot has.

    Moments are about the origin of the body's joint, in its axes. A motor inertia is Pinocchio's ``armature``.
    """
    parameters: Float[Array, " columns"]
    """Values of the parameters in the robot."""


def regressor_of(state: StateEvaluation, robot: Robot, v2_dot: ArrayInput) -> ReducedRegressor:
    """Return the regressor ``R^T Y(q, v, vdot)`` at states.

    Args:
        state: the states.
        robot: their robot.
        v2_dot: reduced accelerations (..., r).
    """
    R, model, data = state.R, robot.model, robot.model.createData()
    v_dot = state.v_dot(vector(v2_dot, R.shape[-1], "v2_dot"))
    batch = v_dot.shape[:-1]
    q, v = np.broadcast_to(state.q, (*batch, model.nq)), np.broadcast_to(state.v, (*batch, model.nv))
    torques = np.empty((*batch, model.nv, 10 * (model.njoints - 1)))
    for k in np.ndindex(batch):
        torques[k] = pin.computeJointTorqueRegressor(model, data, q[k], v[k], v_dot[k])
    driven = np.flatnonzero(model.armature)
    motors = np.eye(model.nv)[:, driven] * v_dot[..., None, driven]
    bodies = [f"{each} of {joint}" for joint in list(model.names)[1:] for each in _INERTIAL]
    values = [each.toDynamicParameters() for each in list(model.inertias)[1:]]
    return ReducedRegressor(
        R.mT @ np.concatenate([torques, motors], axis=-1),
        (*bodies, *(f"motor inertia of {robot.velocity_names[k]}" for k in driven)),
        np.concatenate([*values, model.armature[driven]]),
    )
