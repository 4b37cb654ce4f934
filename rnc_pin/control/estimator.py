"""Estimator of unknown constraint parameters, updated once per sample. Paper (20), Lemma 4."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.control.controller import Description, elapsed_time, listed
from rnc_pin.control.estimation import AdaptedModel, Regressor, adapt
from rnc_pin.errors import ConfigurationError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.printing import ReprMixin

Bound = float | Sequence[float] | np.ndarray
Bounds = tuple[Bound, Bound]

BOUNDS = (0.05, 20.0)
"""Default lowest and highest estimate."""


class EstimatorState(NamedTuple):
    """State of the estimator: time of the last sample, and parameter estimates."""

    time: float | None
    p: Float[Array, " s"]
    """Parameter estimates."""


class Estimator(ReprMixin):
    """``phat_dot = alpha Y^T E`` with ``E = y - Y phat``, paper (20), at the measured q and v.

    Args:
        reduced: the system; the true values of its unknown parameters are never read.
        regressor: model of the unknown parameters, e.g. ``MomentumRegressor`` or ``WheelRegressor``.
        initial: first estimates (s,), in the regressor's units.
        bounds: lowest and highest values, positive; a number or one for each parameter.
        alpha: adaptation gain; 0 switches it off.
        dead_zone: prediction error below which estimates do not change; a number or one for each entry.

    Attributes:
        model: the model with the estimates of the last step; at first with ``initial``. Use it for every controller
            that needs a model, and for gains that are scaled to an inertia. Its evaluations never change.

    Raises:
        ConfigurationError: estimates are outside the bounds or of the wrong number, or the momentum is not zero.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> regressor = rnc.control.MomentumRegressor(robot, "platform", [rnc.control.UnknownMass("joint_3")])
        >>> estimator = rnc.control.Estimator(reduced, regressor, initial=[15.0], bounds=(1.0, 50.0), alpha=1e9)
        >>> moving = reduced.at(robot.configuration({"joint_2": 1.8}), [0.1, 0.2, 0.3]).measure()
        >>> state, error = estimator.step(0.0, moving, estimator.initial_state())
        >>> state, error = estimator.step(1.0, moving, state)
        >>> state.p.round(2)  # one sample with a large gain finds the mass
        array([10.])
    """

    def __init__(
        self,
        reduced: ReducedModel,
        regressor: Regressor,
        initial: Sequence[float] | np.ndarray,
        bounds: Bounds = BOUNDS,
        alpha: float = 1.0,
        dead_zone: float | np.ndarray = 0.0,
    ) -> None:
        self.regressor, self.alpha, self.dead_zone = regressor, alpha, dead_zone
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
            raise ConfigurationError("estimation assumes A v = 0 (zero momentum), but the momentum is not zero")
        self._estimated = regressor.estimated(reduced)
        self._p = self.initial  # parameters of ``model``
        self.model = AdaptedModel(self._estimated.at(self._p))

    def describe(self) -> Description:
        """Return the gain, the first estimates by name, and the bounds."""
        return {
            "alpha": self.alpha,
            "dead_zone": listed(self.dead_zone),
            "initial": dict(zip(self.regressor.names, self.initial.tolist(), strict=True)),
            "bounds": [listed(self._low), listed(self._high)],
        }

    def initial_state(self) -> EstimatorState:
        """Return the first estimates; ``model`` has them too."""
        self._use(self.initial)
        return EstimatorState(None, self.initial)

    def step(self, t: float, measurement: Measurement, state: EstimatorState) -> tuple[EstimatorState, np.ndarray]:
        """Update the estimates and ``model``; also return the prediction error E (e,) of the previous estimates.

        Reads from the measurement: ``q, v``.

        Raises:
            InputError: time runs backwards.
        """
        elapsed = elapsed_time(t, state.time)
        y, Y = self.regressor.regress(measurement.q, measurement.v)
        error = y - Y @ state.p
        p = state.p
        if self.alpha > 0:
            p = adapt(p, Y, error, self.alpha, elapsed, self._low, self._high, self.dead_zone)
        self._use(p)
        return EstimatorState(t, p), error

    def _use(self, p: np.ndarray) -> None:
        """Let ``model`` have parameters p."""
        if not np.array_equal(p, self._p):
            self.model.use(self._estimated.at(p))
            self._p = p

    def _settings(self) -> dict[str, object]:
        return {"unknown": list(self.regressor.names), "initial": self.initial, "alpha": self.alpha}


def with_estimated_kinematics(measurement: Measurement, estimate: StateEvaluation) -> Measurement:
    """Return a measurement with the kinematics of an estimated model instead of the true kinematics."""
    seen = measurement._replace(A_star=estimate.A_star, A_star_dot=estimate.A_star_dot, residual=None)
    if seen.input_deficit is None:
        return seen
    return seen._replace(force_deficit=apply(estimate.input_matrix, seen.input_deficit))


def _one_each(bound: Bound, size: int) -> np.ndarray:
    values = np.asarray(bound, dtype=float)
    if values.shape not in ((), (size,)):
        raise ConfigurationError(f"bounds of estimates: {values.size} values for {size} unknown parameters")
    return np.broadcast_to(values, (size,))
