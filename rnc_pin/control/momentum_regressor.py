"""Unknown masses in a momentum constraint, estimated while moving. Paper (14)-(21), Lemma 4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin

from rnc_pin.constraints import MomentumConservation
from rnc_pin.control.estimation import EstimatedModel, ParametrizedCopy
from rnc_pin.errors import ConfigurationError, ModelError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class UnknownMass:
    """Body of unknown mass but known mass distribution.

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
        robot: the robot; the masses of its unknown bodies are never read.
        base: the joint whose momentum is conserved.
        unknown: the bodies.

    Raises:
        ModelError: unknown joint, or a body without mass.
        ConfigurationError: no body of known mass turns with the base.
    """

    def __init__(self, robot: Robot, base: str, unknown: Sequence[UnknownMass]) -> None:
        if not unknown:
            raise ConfigurationError("name at least one body of unknown mass")
        momentum = MomentumConservation(base).bind(robot)  # raises an error if the joint is not cyclic
        self.names = tuple(f"mass behind {each.joint}" for each in unknown)
        self.units = tuple("kg" if each.unit == 1.0 else f"{each.unit:g} kg" for each in unknown)
        self.rows = robot.velocity_indices(base)
        self.predicted = robot.velocity_names[self.rows]
        self.predicted_units = tuple("rad/s" if unit == "N m s" else "m/s" for unit in momentum.units)
        self.joints = [robot.joint_id(each.joint) for each in unknown]
        self._known = robot.model.copy()
        self._unit = []
        for each, joint in zip(unknown, self.joints, strict=True):
            inertia = robot.model.inertias[joint]
            if not inertia.mass > 0:
                raise ModelError(f"body behind joint '{each.joint}' has no mass to estimate")
            # Inertia of the body at unit mass.
            shape = inertia.toDynamicParameters() / inertia.mass
            self._unit.append(each.unit * shape)
            self._known.inertias[joint] = pin.Inertia.Zero()
        self._data, self._jacobians = self._known.createData(), self._known.createData()
        known = pin.crba(self._known, self._data, robot.configuration())[self.rows, self.rows]
        if np.linalg.cond(known) > 1e10:
            raise ConfigurationError(f"no body of known mass turns with joint '{base}'")

    def inertia(self, index: int, value: float) -> pin.Inertia:
        """Return the inertia of an unknown body for a value of its parameter."""
        return pin.Inertia.FromDynamicParameters(value * self._unit[index])

    def regress(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ``x1dot - W0`` (k,) and W (k, s), the paper's form of y and Y."""
        W0, W = self.predict(q, v)
        return v[self.rows] - W0, W

    def estimated(self, reduced: ReducedModel) -> EstimatedModel:
        """Return models whose unknown bodies have the estimated masses."""
        return EstimatedModel(reduced, partial(self._copy, reduced))

    def _copy(self, reduced: ReducedModel) -> ParametrizedCopy:
        """Copy of the model with unit masses. No row holds a mass."""
        model = reduced.robot.model.copy()
        self._set_parameters(model, np.ones(len(self.names)))
        return ParametrizedCopy(model, reduced.all_constraints, partial(self._set_parameters, model))

    def _set_parameters(self, model: pin.Model, p: np.ndarray) -> None:
        for index, (joint, value) in enumerate(zip(self.joints, p, strict=True)):
            model.inertias[joint] = self.inertia(index, float(value))

    def predict(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return W0 (k,) and W (k, s) at the measured q (nq,) and v (nv,)."""
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
