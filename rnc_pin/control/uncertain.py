"""Controllers under unknown constraints: kinematics and allocation use the estimates. Paper (14)-(21), Lemma 4."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rnc_pin.control.controller import Command, Controller, Description, State, VelocityTarget, describe
from rnc_pin.control.estimation import BOUNDS, Bounds, Estimator, EstimatorState, Regressor, with_estimated_kinematics
from rnc_pin.control.redundancy import RedundancyController
from rnc_pin.model.reduced_kinematics import Measurement
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


class UncertainState(NamedTuple):
    """States of the estimator and of the inner controller."""

    estimator: EstimatorState
    controller: State


class UncertainController(ReprMixin):
    """Certainty equivalence: the inner controller and the allocation use the estimated kinematics.

    Each sample has three steps. The estimator updates the estimates by (20). The controller receives ``A_star`` and its
    rate from the estimated constraints. The estimated ``R^T B`` allocates its reduced force F to the actuators. Under a
    momentum constraint ``R^T B`` depends on the unknown masses through R. So an allocation by the true matrix would use
    the unknown masses. With (12) this is (16). Any other controller of this package works too: for class 2 the same
    law, for class 2s ``SteeringController``, for class 3 a ``SplitController``.

    No input depends on the true values of unknown parameters, under one condition: models for the inner controller, and
    gains that are scaled to an inertia, come from ``estimator.model``.

    Reads from the measurement: ``q, v, v2``, and the quantities that its controller reads. One state at a time.

    Args:
        estimator: estimator of the unknown parameters.
        controller: controller that computes the reduced force.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> unknown = rnc.control.MomentumRegressor(robot, "platform", [rnc.control.UnknownMass("joint_3")])
        >>> estimator = rnc.control.Estimator(reduced, unknown, initial=[14.0])
        >>> swing = rnc.planning.MinimumJerk(np.zeros(3), [0.5, 0.0, 0.0], duration=1.0)
        >>> target = rnc.control.ReducingOutputController(estimator.model, swing)
        >>> controller = rnc.control.UncertainController(estimator, rnc.control.VelocityTracker(target))
        >>> rnc.simulate(reduced, controller, robot.configuration(), duration=0.1, dt=0.01).estimates.shape
        (11, 1)
    """

    def __init__(self, estimator: Estimator, controller: Controller) -> None:
        self.estimator, self.controller = estimator, controller

    def describe(self) -> Description:
        """Return gain, first estimates and bounds of the estimator, and the inner controller."""
        return {
            "type": type(self).__name__,
            **self.estimator.describe(),
            "controller": describe(self.controller),
        }

    def initial_state(self, measurement: Measurement) -> UncertainState:
        """Return the first estimates, and the initial state of the controller under them."""
        state = self.estimator.initial_state()
        seen = with_estimated_kinematics(measurement, self.estimator.model.at(measurement.q, measurement.v2))
        return UncertainState(state, self.controller.initial_state(seen))

    def step(self, t: float, measurement: Measurement, state: UncertainState) -> tuple[Command, UncertainState]:
        learnt, error = self.estimator.step(t, measurement, state.estimator)
        estimate = self.estimator.model.at(measurement.q, measurement.v2)
        command, inner = self.controller.step(t, with_estimated_kinematics(measurement, estimate), state.controller)
        if command.F is not None:
            command = command._replace(F=None, T=estimate.allocate(command.F))
        return command._replace(estimates=learnt.p, prediction_error=error), UncertainState(learnt, inner)
