"""Class 1 with constraints that are not known: certainty equivalence. Paper (14)-(21), Lemma 4."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.control.estimation import Regressor, adapt
from rnc_pin.control.protocol import Description, VelocityTarget, elapsed_time, listed
from rnc_pin.control.redundancy import RedundancyController
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import Spelled


class EstimatorState(NamedTuple):
    """What has been learnt."""

    time: float | None
    p: Float[Array, " s"]
    """Parameter estimates."""


class UncertainRedundancyController(Spelled):
    """(16): ``v22d = A4hat^-1 (x1d_dot + k3 (x1d - x1) - A3hat v21d)`` with estimates from (20).

    Constraints are affine in what is not known, ``A_known v + Y p = 0``, so with ``y = -A_known v`` the prediction
    error is ``E = y - Y phat = Y (p - phat)``, exactly, when Y is evaluated at the measured velocity, and
    ``phat_dot = alpha Y^T E`` gives ``Vdot = -alpha |E|^2`` for ``V = |p - phat|^2 / 2``. For momentum y and Y
    are the paper's ``x1dot - W0`` and W. A model of its own carries the estimates; true values of what is
    unknown in the system that it is given are never read.

    Reads from the measurement: ``q, v, v1, v2, x1, x2``. One state at a time.

    Args:
        reduced: the system.
        controller: the class-1 controller to feed with estimated kinematics.
        regressor: what is unknown, e.g. ``MomentumRegressor`` or ``WheelRegressor``.
        initial: first estimates (s,), in the regressor's units.
        bounds: lowest and highest values, positive; a number or one for each parameter.
        alpha: adaptation gain; 0 switches it off.
        dead_zone: prediction error below which nothing is learnt, as large as its noise; a number or one for each.

    Raises:
        ConfigurationError: estimates outside the bounds or of the wrong number, or a momentum that is not zero.
    """

    def __init__(
        self,
        reduced: ReducedModel,
        controller: RedundancyController,
        regressor: Regressor,
        initial: Sequence[float] | np.ndarray,
        bounds: tuple[float | Sequence[float] | np.ndarray, float | Sequence[float] | np.ndarray] = (0.05, 20.0),
        alpha: float = 1.0,
        dead_zone: float | np.ndarray = 0.0,
    ) -> None:
        self.regressor, self.controller, self.alpha, self.dead_zone = regressor, controller, alpha, dead_zone
        self.initial = np.array(initial, dtype=float)
        size = len(regressor.names)
        if self.initial.shape != (size,):
            raise ConfigurationError(f"{self.initial.size} initial estimates for {size} unknown parameters")
        self._low, self._high = (_one_each(bound, size) for bound in bounds)
        if not ((self._low > 0) & (self._low < self._high)).all():
            raise ConfigurationError(f"bounds of estimates have to be positive and in order, found {tuple(bounds)}")
        outside = np.flatnonzero((self.initial < self._low) | (self.initial > self._high))
        if len(outside):
            first = outside[0]
            raise ConfigurationError(
                f"first estimate of the {regressor.names[first]}, {self.initial[first]:g}, has to be within its bounds "
                f"{self._low[first]:g} and {self._high[first]:g}"
            )
        if reduced.affine:
            raise ConfigurationError("estimation assumes A v = 0, a momentum of zero, and this one is not zero")
        self._estimated = regressor.estimated(reduced)

    def describe(self) -> Description:
        """Gains of the class-1 controller, and of the estimation: alpha, first estimates by name, bounds."""
        return {
            **self.controller.describe(),
            "type": type(self).__name__,
            "alpha": self.alpha,
            "dead_zone": listed(self.dead_zone),
            "initial": dict(zip(self.regressor.names, self.initial.tolist(), strict=True)),
            "bounds": [listed(self._low), listed(self._high)],
        }

    def initial_state(self, measurement: Measurement) -> EstimatorState:
        """The first estimates."""
        return EstimatorState(None, self.initial)

    def step(self, t: float, measurement: Measurement, state: EstimatorState) -> tuple[VelocityTarget, EstimatorState]:
        elapsed = elapsed_time(t, state.time)
        y, Y = self.regressor.regress(measurement.q, measurement.v)
        error = y - Y @ state.p
        p = state.p
        if self.alpha > 0:
            p = adapt(p, Y, error, self.alpha, elapsed, self._low, self._high, self.dead_zone)
        guess = self._estimated.at(p).measure(measurement.q, measurement.v2)
        seen = measurement._replace(A_star=guess.A_star, A_star_dot=guess.A_star_dot)
        target, _ = self.controller.step(t, seen, None)
        return target._replace(estimates=p, prediction_error=error), EstimatorState(t, p)


def _one_each(bound: float | Sequence[float] | np.ndarray, size: int) -> np.ndarray:
    values = np.asarray(bound, dtype=float)
    if values.shape not in ((), (size,)):
        raise ConfigurationError(f"bounds of estimates: {values.size} values for {size} unknown parameters")
    return np.broadcast_to(values, (size,))
