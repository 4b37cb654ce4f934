"""Unknown masses in a momentum constraint, estimated while moving. Paper (14)-(21), Lemma 4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.constraints import MomentumConservation
from rnc_pin.errors import ConfigurationError, ModelError
from rnc_pin.robot import Robot


@dataclass(frozen=True)
class UnknownMass:
    """A body whose mass is not known; how the mass is spread over the body is.

    Args:
        joint: the joint that carries the body.
        unit: mass that counts as 1 [kg]. The paper's parameters are ``m_k / J``: unit J.
    """

    joint: str
    unit: float = 1.0


class MomentumRegressor:
    """``A_known(q) v + Y(q, v) p = 0``: momentum is linear in the unknown masses.

    With the base columns of ``A_known`` nonsingular, the base moves as ``x1dot = W0 + W p``.

    Args:
        robot: its model; the masses of unknown bodies in it are never read.
        base: the joint whose momentum is conserved.
        unknown: the bodies.

    Raises:
        ModelError: unknown joint, or a body without mass.
        ConfigurationError: nothing known is left to turn with the base.
    """

    def __init__(self, robot: Robot, base: str, unknown: Sequence[UnknownMass]) -> None:
        if not unknown:
            raise ConfigurationError("name at least one body of unknown mass")
        MomentumConservation(base).bind(robot)  # refuses a joint that is not cyclic
        self.names = tuple(each.joint for each in unknown)
        self.rows = robot.velocity_indices(base)
        self.joints = [robot.joint_id(each.joint) for each in unknown]
        self._known = robot.model.copy()
        self._unit = []
        for each, joint in zip(unknown, self.joints, strict=True):
            inertia = robot.model.inertias[joint]
            if not inertia.mass > 0:
                raise ModelError(f"body behind joint '{each.joint}' has no mass to estimate")
            # The shape of the body alone: its inertia divided by its mass.
            shape = inertia.toDynamicParameters() / inertia.mass
            self._unit.append(each.unit * shape)
            self._known.inertias[joint] = pin.Inertia.Zero()
        self._data, self._jacobians = self._known.createData(), self._known.createData()
        known = pin.crba(self._known, self._data, robot.configuration())[self.rows, self.rows]
        if np.linalg.cond(known) > 1e10:
            raise ConfigurationError(f"no body of known mass turns with joint '{base}'")

    def inertia(self, index: int, value: float) -> pin.Inertia:
        """Inertia of an unknown body for a value of its parameter."""
        return pin.Inertia.FromDynamicParameters(value * self._unit[index])

    def predict(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """W0 (k,) and W (k, s) at the measured q (nq,) and v (nv,)."""
        model, rows = self._known, self.rows
        A = pin.crba(model, self._data, q)[rows]
        pin.computeJointJacobians(model, self._jacobians, q)
        pin.forwardKinematics(model, self._jacobians, q, v)
        Y = np.empty((A.shape[0], len(self.joints)))
        for column, (joint, unit) in enumerate(zip(self.joints, self._unit, strict=True)):
            velocity = self._jacobians.v[joint]
            # A body's momentum is its regressor at velocity 0 and "acceleration" v, times its parameters.
            momentum = pin.bodyRegressor(pin.Motion.Zero(), velocity) @ unit
            jacobian = pin.getJointJacobian(model, self._jacobians, joint, pin.ReferenceFrame.LOCAL)
            Y[:, column] = jacobian[:, rows].T @ momentum
        others = v.copy()
        others[rows] = 0.0
        both = np.column_stack([A @ others, Y])
        solved = -np.linalg.solve(A[:, rows], both)
        return solved[:, 0], solved[:, 1:]


def adapt(
    p: np.ndarray, W: np.ndarray, error: np.ndarray, gain: float, elapsed: float, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """One sample of ``pdot = alpha W^T E`` (20), kept within bounds.

    The step is bounded like that of the trackers: it never corrects more than the error that it sees, so that
    ``|p - phat|`` does not grow (Lemma 4). Clipping to a box that holds p does not make it grow either.
    """
    step = gain * elapsed
    correction = W.T @ np.linalg.solve(np.eye(len(error)) + step * W @ W.T, step * error)
    return np.clip(p + correction, low, high)
