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
from rnc_pin.model.input_validation import Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class UnknownMass:
    """Body of unknown mass but known mass distribution.

    Args:
        joint: the joint that carries the body.
        unit: mass that counts as 1 [kg]. The paper's parameters are ``m_k / J``: unit J.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> unknown = rnc.control.UnknownMass("joint_3", unit=10.0)
        >>> regressor = rnc.control.MomentumRegressor(robot, "platform", [unknown])
        >>> regressor.names, regressor.units
        (('mass behind joint_3',), ('10 kg',))
    """

    joint: str
    unit: Positive = 1.0


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

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> regressor = rnc.control.MomentumRegressor(robot, "platform", [rnc.control.UnknownMass("joint_3")])
        >>> state = reduced.at(robot.configuration({"joint_2": 1.8}), [0.1, 0.2, 0.3])
        >>> y, Y = regressor.regress(state.q, state.v)
        >>> (y / Y[:, 0]).round(6), robot.model.inertias[robot.joint_id("joint_3")].mass  # estimated and true mass
        (array([10.]), 10.0)
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
            # The true mass is divided out above and removed here: no prediction depends on it.
            self._known.inertias[joint] = pin.Inertia.Zero()
        self._unit_inertias = [pin.Inertia.FromDynamicParameters(unit) for unit in self._unit]
        base_joint = robot.joint_id(base)
        self._moved = [base_joint in list(robot.model.supports[joint]) for joint in self.joints]
        self._data = self._known.createData()
        known = pin.crba(self._known, self._data, robot.configuration())[self.rows, self.rows]
        # W0 and W need the inverse of the known base inertia, which must not consist of rounding.
        if np.linalg.cond(known) > 1e10:
            raise ConfigurationError(f"no body of known mass turns with joint '{base}'")

    def inertia(self, index: int, value: float) -> pin.Inertia:
        """Return the inertia of an unknown body for a value of its parameter.

        Args:
            index: number of the body among the unknown ones.
            value: value of its parameter, in its unit.
        """
        return pin.Inertia.FromDynamicParameters(value * self._unit[index])

    def regress(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ``x1dot - W0`` (k,) and W (k, s), the paper's form of y and Y.

        Args:
            q: measured configuration.
            v: measured velocity.
        """
        W0, W = self.predict(q, v)
        return v[self.rows] - W0, W

    def estimated(self, reduced: ReducedModel) -> EstimatedModel:
        """Return models whose unknown bodies have the estimated masses.

        Args:
            reduced: the model with the true masses.
        """
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
        """Return W0 (k,) and W (k, s) at the measured q (nq,) and v (nv,).

        Args:
            q: measured configuration.
            v: measured velocity.
        """
        model, data, rows = self._known, self._data, self.rows
        A = pin.crba(model, data, q, pin.Convention.WORLD)[rows]  # Jacobians in world axes too
        pin.forwardKinematics(model, data, q, v)
        columns = np.empty((1 + len(self.joints), A.shape[0]))
        for column, joint, unit, moved in zip(columns[1:], self.joints, self._unit_inertias, self._moved, strict=True):
            # Momentum of the body at unit parameter, about the origin of the world.
            momentum = data.oMi[joint].act(unit * data.v[joint]).vector
            column[:] = momentum.dot(data.J[:, rows]) if moved else 0.0
        others = v.copy()
        others[rows] = 0.0
        columns[0] = A.dot(others)
        solved = np.linalg.solve(A[:, rows], columns.T)
        return -solved[:, 0], -solved[:, 1:]
