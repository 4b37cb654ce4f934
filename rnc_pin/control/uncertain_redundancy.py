"""Class 1 with a momentum constraint that is not known: certainty equivalence. Paper (14)-(21), Lemma 4."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.control.momentum_estimator import MomentumRegressor, UnknownMass, adapt
from rnc_pin.control.protocol import VelocityTarget, elapsed_time
from rnc_pin.control.redundancy import RedundancyController
from rnc_pin.errors import ConfigurationError
from rnc_pin.measurement import Measurement
from rnc_pin.reduction import ReducedModel
from rnc_pin.robot import Robot
from rnc_pin.rows import OutputStack, RowStack


class EstimatorState(NamedTuple):
    """What has been learnt."""

    time: float | None
    p: Float[Array, " s"]
    """Parameter estimates."""


class UncertainRedundancyController:
    """(16): ``v22d = A4hat^-1 (x1d_dot + k3 (x1d - x1) - A3hat v21d)`` with estimates from (20).

    Prediction error ``E = x1dot - W0 - W phat = W (p - phat)``, exactly, when W is evaluated at the measured
    velocity; ``phat_dot = alpha W^T E``. A model of its own carries the estimates; the masses of the unknown
    bodies in the robot that it is given are never read.

    Reads from the measurement: ``q, v, v1, v2, x1, x2``. One state at a time.

    Args:
        reduced: the system; its vertical outputs are the coordinates of the base joint.
        controller: the class-1 controller to feed with estimated kinematics.
        base: the joint whose momentum is conserved.
        unknown: bodies of unknown mass.
        initial: first estimates (s,), in the units of ``unknown``.
        bounds: lowest and highest values of every parameter, positive.
        alpha: adaptation gain; 0 switches it off.

    Raises:
        ConfigurationError: estimates outside the bounds or of the wrong number, other vertical outputs, or a
            momentum that is not zero.
    """

    def __init__(
        self,
        reduced: ReducedModel,
        controller: RedundancyController,
        base: str,
        unknown: Sequence[UnknownMass],
        initial: Sequence[float] | np.ndarray,
        bounds: tuple[float, float] = (0.05, 20.0),
        alpha: float = 1.0,
    ) -> None:
        self.regressor = MomentumRegressor(reduced.robot, base, unknown)
        self.controller, self.alpha = controller, alpha
        self.k3, self.k21 = controller.k3, controller.k21
        self.initial = np.array(initial, dtype=float)
        size = len(self.regressor.names)
        if self.initial.shape != (size,):
            raise ConfigurationError(f"{self.initial.size} initial estimates for {size} unknown masses")
        self._low, self._high = np.full(size, bounds[0]), np.full(size, bounds[1])
        if not (0 < bounds[0] < bounds[1] and (self.initial >= bounds[0]).all() and (self.initial <= bounds[1]).all()):
            raise ConfigurationError(f"estimates {self.initial.tolist()} have to be within positive bounds {bounds}")
        if reduced.affine:
            raise ConfigurationError("unknown masses are estimated from a momentum of zero, and this one is not zero")
        if reduced.vertical.names != (base,):
            raise ConfigurationError(f"the vertical output has to be the base joint '{base}' alone")
        self._model = reduced.robot.model.copy()
        self._set(self.initial)
        self._estimated = _same_outputs(reduced, Robot(self._model))

    def _set(self, p: np.ndarray) -> None:
        for index, (joint, value) in enumerate(zip(self.regressor.joints, p, strict=True)):
            self._model.inertias[joint] = self.regressor.inertia(index, float(value))

    def initial_state(self, measurement: Measurement) -> EstimatorState:
        """The first estimates."""
        return EstimatorState(None, self.initial)

    def step(self, t: float, measurement: Measurement, state: EstimatorState) -> tuple[VelocityTarget, EstimatorState]:
        elapsed = elapsed_time(t, state.time)
        W0, W = self.regressor.predict(measurement.q, measurement.v)
        error = measurement.v1 - W0 - W @ state.p
        p = adapt(state.p, W, error, self.alpha, elapsed, self._low, self._high) if self.alpha > 0 else state.p
        self._set(p)
        guess = self._estimated.measure(measurement.q, measurement.v2)
        seen = measurement._replace(A_star=guess.A_star, A_star_dot=guess.A_star_dot)
        target, _ = self.controller.step(t, seen, None)
        return target._replace(estimates=p, prediction_error=error), EstimatorState(t, p)


def _same_outputs(reduced: ReducedModel, robot: Robot) -> ReducedModel:
    """The reduction of a robot that differs in its inertias alone: bound rows know joints and frames only by index."""
    constraints: RowStack = reduced.constraints
    reducing: OutputStack = reduced.reducing
    return ReducedModel(robot, constraints, reduced.actuation, reducing, reduced.vertical, reduced.singularity_limit)
