"""Class 1 with unknown constraint parameters: certainty equivalence. Paper (14)-(21), Lemma 4."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rnc_pin.control.controller import Description, VelocityTarget
from rnc_pin.control.estimation import Regressor
from rnc_pin.control.estimator import BOUNDS, Bounds, Estimator, EstimatorState, with_estimated_kinematics
from rnc_pin.control.redundancy import RedundancyController
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import ReprMixin


class UncertainRedundancyController(ReprMixin):
    """(16): ``v22d = A4hat^-1 (x1d_dot + k3 (x1d - x1) - A3hat v21d)`` with estimates from (20).

    Constraints are affine in the unknown parameters, ``A_known v + Y p = 0``. With ``y = -A_known v`` and Y at the
    measured velocity, the prediction error is exactly ``E = y - Y phat = Y (p - phat)``. Then
    ``phat_dot = alpha Y^T E`` gives ``Vdot = -alpha |E|^2`` for ``V = |p - phat|^2 / 2``. For momentum, y and Y are the
    paper's ``x1dot - W0`` and W. The controller has its own model with the estimates. It never reads the true values of
    unknown parameters from the given system. It does not allocate forces to actuators; ``UncertainController`` does,
    also with the estimates.

    Reads from the measurement: ``q, v, v1, v2, x1, x2``. One state at a time.

    Args:
        reduced: the system.
        controller: the class-1 controller to feed with estimated kinematics.
        regressor: model of the unknown parameters, e.g. ``MomentumRegressor`` or ``WheelRegressor``.
        initial: first estimates (s,), in the regressor's units.
        bounds: lowest and highest values, positive; a number or one for each parameter.
        alpha: adaptation gain; 0 switches it off.
        dead_zone: prediction error below which estimates do not change, as large as its noise; a number or one for
            each entry.

    Raises:
        ConfigurationError: estimates are outside the bounds or of the wrong number, or the momentum is not zero.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(
        ...     [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")])
        >>> task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
        >>> regressor = rnc.control.MomentumRegressor(robot, "platform", [rnc.control.UnknownMass("joint_3")])
        >>> law = rnc.control.RedundancyController(task, rnc.planning.Hold([1.5, 0.5]), rnc.planning.Hold([0.1]))
        >>> controller = rnc.control.UncertainRedundancyController(reduced, law, regressor, [15.0], bounds=(1.0, 50.0))
        >>> measurement = reduced.at(robot.configuration({"joint_2": 1.8}), np.zeros(3)).measure()
        >>> target, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> target.estimates
        array([15.])
    """

    def __init__(
        self,
        reduced: ReducedModel,
        controller: RedundancyController,
        regressor: Regressor,
        initial: Sequence[float] | np.ndarray,
        bounds: Bounds = BOUNDS,
        alpha: float = 1.0,
        dead_zone: float | np.ndarray = 0.0,
    ) -> None:
        self.controller = controller
        self.estimator = Estimator(reduced, regressor, initial, bounds, alpha, dead_zone)

    def describe(self) -> Description:
        """Return the gains of the class-1 controller, and the estimator's alpha, first estimates by name and bounds."""
        return {**self.controller.describe(), "type": type(self).__name__, **self.estimator.describe()}

    def initial_state(self, measurement: Measurement) -> EstimatorState:
        """Return the first estimates."""
        return self.estimator.initial_state()

    def step(self, t: float, measurement: Measurement, state: EstimatorState) -> tuple[VelocityTarget, EstimatorState]:
        state, error = self.estimator.step(t, measurement, state)
        seen = with_estimated_kinematics(measurement, self.estimator.model.at(measurement.q, measurement.v2))
        target, _ = self.controller.step(t, seen, None)
        return target._replace(estimates=state.p, prediction_error=error), state
